"""The page of `omni-mj play` in a real browser, and what others may ask of its server."""

import gc
import io
import os
import re
import shutil
import signal
import socket
import subprocess
import sys
import time
import weakref
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager, suppress
from pathlib import Path
from typing import Any, NamedTuple
from urllib.request import urlopen

import numpy as np
import pytest
from commands import invoke, run_python
from PIL import Image

from omni_control.errors import OmniError
from omni_mj.config.scenario import load_scenario
from omni_mj.studies.run_scenario import StoppedError
from omni_mj.viz import style

pytest.importorskip("viser", reason="the extra play is not installed")
import viser

from omni_mj.play.live_plots import LivePlots
from omni_mj.play.play_server import PlayServer
from omni_mj.play.play_session import PlaySession
from omni_mj.play.state_links import format_link, load_link

CHROMIUM = next(
    filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None
)
TIMEOUT_S = 90  # WebGL without a graphics card is slow next to other tests
FLAGS = "--no-sandbox --use-gl=angle --use-angle=swiftshader --enable-unsafe-swiftshader"
FLAGS += " --disable-gpu-compositing"


CONTROLLER = """
import omni_mj as om
class Mine(om.Controller):
    def command(self, frame, observation):
        {line}
        return observation.predicted_pose * 0.0
"""


@contextmanager
def play(*args: str, port: str = "--port=0") -> Iterator[tuple[str, subprocess.Popen[str]]]:
    """Play, and yield the first line after "playing at ", the address, and the process."""
    command = [sys.executable, "-m", "omni_mj", "play", "--no-open", *port.split(), *args]
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout
        try:
            yield process.stdout.readline()[len("playing at ") :].strip(), process
        finally:
            process.kill()


# Draw one picture per second, because one takes 0.2 s without a graphics card.
SLOW_PICTURES = "requestAnimationFrame = draw => setTimeout(() => draw(performance.now()), 1000)"


@contextmanager
def browse(url: str) -> Iterator[Any]:
    sync_api = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    if CHROMIUM is None:
        pytest.skip("no chromium on the PATH")
    with sync_api.sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=FLAGS.split())
        page = browser.new_page(viewport={"width": 900, "height": 500})
        page.add_init_script(SLOW_PICTURES)
        page.set_default_timeout(TIMEOUT_S * 1e3)
        page.goto(url)
        yield page
        browser.close()


class Browser(NamedTuple):
    """A page, opened by a link to the controller p, that may play that of the file `mine.py`.

    Attributes:
        page: The page.
        url: Its address, to which links are appended.
        mine: The file.
    """

    page: Any
    url: str
    mine: Path


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    mine = tmp_path_factory.mktemp("browser") / "mine.py"
    mine.write_text(CONTROLLER.format(line="pass"))
    with play("--plant", "kinematic", "--controller", f"{mine}:Mine") as (url, process):
        with browse(f"{url}?plant=kinematic&controllers=p") as page:
            yield Browser(page, url, mine)
        # The last page is closed.
        assert process.wait(TIMEOUT_S) == 0


def errors_cm(page: Any) -> list[float]:
    """Return the present error, and the root mean square of the window."""
    row = page.locator("tr", has_text="p").last
    return [float(text) for text in row.locator("td").all_inner_texts()[1:]]


def wait_until(page: Any, is_reached: Callable[[], bool]) -> None:
    for _ in range(10 * TIMEOUT_S):
        if is_reached():
            return
        page.wait_for_timeout(100)
    raise AssertionError(page.locator("table").inner_text())


HANG = """
import time
print("running", flush=True)
while True:
    try: time.sleep(9)
    except Exception: pass
"""


def play_p(browser: Browser) -> None:
    """Play the controller p, by a link that the browser need not load."""
    urlopen(f"{browser.url}?plant=kinematic&controllers=p").close()
    browser.page.locator("tr", has_text=re.compile(r" p\d")).last.wait_for()


def choose(page: Any, label: str, option: str) -> None:
    page.get_by_label(label, exact=True).first.click()
    page.get_by_role("option", name=option, exact=True).click()


def count_pixels(page: Any, controller: str) -> int:
    """Count pixels of the 3-D view in the color of a controller."""
    color = style.rgb(style.color(style.style_indices([controller])[controller]))
    png = page.screenshot(clip={"x": 345, "y": 150, "width": 210, "height": 340})
    pixels = np.asarray(Image.open(io.BytesIO(png)).convert("RGB"), int)
    return int((np.abs(pixels - color).max(axis=2) < 40).sum())


def test_links_bring_more_robots_but_not_too_many_controllers(browser: Browser) -> None:
    poses = "world.start_poses=[[0,0,0],[1,0,0]]"
    urlopen(f"{browser.url}?plant=kinematic&controllers=p&{poses}").close()
    browser.page.locator("td", has_text="p/1").wait_for()
    urlopen(f"{browser.url}?controllers=p,flc,comp-flc,inverse-flc").close()
    browser.page.get_by_text("at most 3 controllers, got 4").wait_for()


def test_a_saved_file_that_hangs_is_named_until_it_is_saved_again(browser: Browser) -> None:
    """Then its robot drives again, and the page is not paused."""
    page, _, mine = browser
    message = "longer than 3 s"
    choose(page, "Controller 1", f"{mine}:Mine")
    page.get_by_text("Mine").first.wait_for()
    page.wait_for_timeout(600)
    mine.write_text(CONTROLLER.format(line="exec(HANG)") + f"HANG = {HANG!r}")
    page.get_by_text(message).first.wait_for()
    page.get_by_text("s paused").wait_for()
    mine.write_text(CONTROLLER.format(line="pass"))
    page.get_by_text(message).first.wait_for(state="detached")
    page.get_by_text("s paused").wait_for(state="detached")


def test_controls_change_only_what_they_say(browser: Browser) -> None:
    """Arrows on a slider do not drive, and another scenario keeps the plant and is in view."""
    page = browser.page
    play_p(browser)
    page.locator("tr", has_text="p").last.wait_for()
    page.get_by_role("slider").first.focus()
    page.keyboard.press("ArrowRight")
    page.wait_for_timeout(500)
    assert len(errors_cm(page)) == 2
    page.keyboard.press("i")
    page.locator("td", has_text=re.compile("^$")).nth(1).wait_for(state="attached")
    choose(page, "Controller 1", "none")
    page.get_by_text("choose at least one controller").wait_for()
    assert page.get_by_label("Controller 1", exact=True).first.input_value() == "p"
    loss = page.get_by_role("textbox").nth(1)
    loss.fill("97")
    page.get_by_text("Radio loss, % must be 0 to 95, got 97").wait_for()
    choose(page, "Scenario", "league")
    page.get_by_text("The settings are those of the scenario league again").wait_for()
    assert page.get_by_label("Plant", exact=True).first.input_value() == "kinematic"
    wait_until(page, lambda: count_pixels(page, "p") > 20)


def test_a_slider_makes_a_robot_oscillate_and_a_click_lets_it_arrive(browser: Browser) -> None:
    """It follows with little error, with more after more dead time, and drives to a click."""
    page = browser.page
    play_p(browser)
    page.wait_for_timeout(1500)
    before = errors_cm(page)[1]
    dead_time = page.get_by_role("textbox").first
    dead_time.fill("0.3")
    dead_time.press("Enter")
    wait_until(page, lambda: errors_cm(page)[1] > 2 * before)
    page.reload()
    page.get_by_text("Dead time, s").wait_for()
    assert page.get_by_role("textbox").first.input_value() == "0.3"
    page.get_by_role("textbox").first.fill("0.05")
    page.mouse.click(460, 300)
    wait_until(page, lambda: errors_cm(page)[0] > 20)
    wait_until(page, lambda: errors_cm(page)[0] < 2)


def test_a_signal_ends_a_file_that_hangs_whatever_it_catches(tmp_path: Path) -> None:
    mine = tmp_path / "mine.py"
    mine.write_text(HANG.replace("Exception", "BaseException"))
    with play("--controller", f"{mine}:Mine") as (_, process):
        process.send_signal(signal.SIGHUP)
        assert process.wait(TIMEOUT_S) == 128 + signal.SIGHUP
        assert process.stderr
        assert "of mine.py hangs and could not be stopped" in process.stderr.read()


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_signal_during_the_start_ends_it_in_one_line(number: int, tmp_path: Path) -> None:
    mine = tmp_path / "mine.py"
    mine.write_text("import time\nprint('importing', flush=True)\ntime.sleep(99)\n")
    with play("--controller", f"{mine}:Mine") as (_, process):
        process.send_signal(number)
        assert process.wait(TIMEOUT_S) == 128 + number
        assert process.stderr
        assert re.fullmatch("error: .*; the session has ended\n", process.stderr.read())


def test_a_signal_frees_the_port(tmp_path: Path) -> None:
    """Also if a thread of a controller runs on. The first line says why links do not work."""
    mine = tmp_path / "mine.py"
    thread = "import threading, time\nthreading.Thread(target=time.sleep, args=(99,)).start()\n"
    mine.write_text(thread + CONTROLLER.format(line="pass"))
    with socket.socket() as occupied:
        with suppress(OSError):  # then another program occupies it
            occupied.bind(("127.0.0.1", 8642))
            occupied.listen()
        with play("--controller", f"{mine}:Mine", port="") as (line, process):
            url, note = line.split(maxsplit=1)
            assert "8642, which links in the lessons need, is in use" in note
            assert b"<html" in urlopen(url, timeout=10).read()
            process.send_signal(signal.SIGTERM)
            assert process.wait(TIMEOUT_S) == 128 + signal.SIGTERM
            assert process.stderr
            assert "but not a thread of a controller" in process.stderr.read()
    socket.create_server(("127.0.0.1", int(url.rstrip("/").rpartition(":")[2]))).close()


NAVIGATION = {"Sec-Fetch-Mode": "navigate", "Sec-Fetch-Dest": "document"}
OTHER_SITE = {"Sec-Fetch-Site": "cross-site"}
OWN_SITE = {"Sec-Fetch-Site": "same-origin"}
IMAGE = {"Sec-Fetch-Mode": "no-cors", "Sec-Fetch-Dest": "image"}
WEBSOCKET = {
    "Upgrade": "websocket",
    "Connection": "Upgrade",
    "Sec-WebSocket-Key": "dGhlIHNhbXBsZSBub25jZQ==",
    "Sec-WebSocket-Version": "13",
}
# Headers, and the status of the page and of a link
REQUESTS: list[tuple[dict[str, str], int, int]] = [
    ({}, 200, 303),
    ({"Host": "localhost"}, 200, 303),
    ({"hOST": "evil.example"}, 403, 403),
    ({"Host": "127.0.0.1.evil.example"}, 403, 403),
    ({"Host": "[::1"}, 403, 403),
    ({"Host": "127.0.0.1:80\r\nHost: evil.example"}, 403, 403),
    ({"Origin": "http://evil.example"}, 403, 403),
    ({"Origin": "null"}, 403, 403),
    (WEBSOCKET | {"Origin": "http://evil.example"}, 403, 403),
    (WEBSOCKET | {"Host": "evil.example:1", "Origin": "http://evil.example:1"}, 403, 403),
    (NAVIGATION | OTHER_SITE, 200, 303),
    (NAVIGATION | {"Sec-Fetch-Site": "none"}, 200, 303),
    (NAVIGATION | OTHER_SITE | {"Sec-Fetch-Dest": "iframe"}, 403, 403),
    (NAVIGATION | OTHER_SITE | {"Sec-Purpose": "prefetch;prerender"}, 403, 403),
    (IMAGE | OTHER_SITE, 403, 403),
    (IMAGE | {"Sec-Fetch-Site": "same-site"}, 403, 403),
    (IMAGE | OWN_SITE, 200, 403),
]


@pytest.fixture(scope="module")
def served() -> Iterator[tuple[int, int]]:
    """Port and process of a page."""
    with play("--plant", "kinematic") as (url, process):
        yield int(url.rstrip("/").rpartition(":")[2]), process.pid


def send(port: int, path: str, headers: dict[str, str]) -> bytes:
    """Return the first line of the answer to a request, by a socket of its own."""
    lines = [f"GET {path} HTTP/1.1", *map(": ".join, headers.items())]
    if "host" not in map(str.lower, headers):
        lines.append(f"Host: 127.0.0.1:{port}")
    with socket.create_connection(("127.0.0.1", port), timeout=10) as connection:
        connection.sendall("\r\n".join([*lines, "", ""]).encode())
        return connection.recv(4096).partition(b"\r\n")[0]


@pytest.mark.parametrize(("headers", "page_status", "link_status"), REQUESTS)
def test_pages_of_other_sites_may_only_lead_to_the_page(
    headers: dict[str, str], page_status: int, link_status: int, served: tuple[int, int]
) -> None:
    port, _ = served
    assert str(page_status).encode() in send(port, "/", headers)
    assert str(link_status).encode() in send(port, "/?seed=3", headers)


def test_there_is_no_other_port_and_idle_connections_end(served: tuple[int, int]) -> None:
    """Whether they send nothing, or a request byte by byte."""
    port, pid = served
    inodes = {os.readlink(link) for link in Path(f"/proc/{pid}/fd").iterdir()}
    rows = [line.split() for line in Path("/proc/net/tcp").read_text().splitlines()[1:]]
    listening = [row[1] for row in rows if row[3] == "0A" and f"socket:[{row[9]}]" in inodes]
    assert listening == [f"0100007F:{port:04X}"]
    idle, slow = (socket.create_connection(("127.0.0.1", port), timeout=9) for _ in range(2))
    with idle, slow:
        for byte in b"GET / HTTP":
            slow.sendall(bytes([byte]))
            time.sleep(0.05)
        assert idle.recv(1) == slow.recv(1) == b""


def test_restarts_leave_no_garbage() -> None:
    """A restart leaves cycles of objects, which the server removes at once."""
    servers, old_simulations = list[PlayServer](), list[Any]()

    def restart() -> None:
        old_simulations.append(weakref.ref(servers[0].session.simulation))
        servers[0].session.restart()

    def check_stop() -> None:
        if len(old_simulations) > 3:
            raise StoppedError("enough")
        for server in servers:
            server.request("restart", restart)

    scenario = load_scenario("rect", plant="kinematic")
    servers.append(PlayServer(lambda *_: scenario, check_stop, print, port=0))
    gc.disable()
    with closing(servers[0]), pytest.raises(StoppedError):
        servers[0].run()
    gc.enable()
    gc.unfreeze()
    assert [ref() for ref in old_simulations[1:3]] == [None, None]


@pytest.mark.parametrize(
    ("path", "message"),
    [
        ("x.txt", "x.txt must be a file whose name ends in .rrd"),
        ("/proc/x.rrd", "/proc/x.rrd cannot be written"),
    ],
)
def test_a_recording_is_refused_at_the_start(
    path: str, message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert invoke("play", "--record", path) == 2
    assert message in capsys.readouterr().err


def test_values_of_a_plot_are_equal_or_differ_enough_for_axes() -> None:
    """Browsers fail to draw ticks that differ by less than 1e-6, as of windings at the start."""
    played = PlaySession(load_scenario("rect", plant="planar"), ("flc",))
    web = viser.ViserServer("127.0.0.1", port=0, verbose=False)
    plots = LivePlots(web.gui, played)
    for _ in range(20):
        plots.add(played.advance())
    plots.send()
    web.stop()
    for handle in plots.handles:
        for values in handle.data:
            assert (np.diff(np.unique(values[np.isfinite(values)])) > 1e-6).all()


def test_a_link_holds_the_state() -> None:
    scenario = load_scenario("slippery", plant="planar", controllers=["p"], seed=3)
    changes = {"radio": {"delay_frames": 9}, "carpet": {"friction": 0.5}}
    scenario = scenario.replace(settings=scenario.settings.replace(**changes))
    assert load_link(format_link(scenario)) == scenario


@pytest.mark.parametrize(
    "query",
    [
        "controllers=evil.py:Evil",
        "plant=evil.py:Evil",
        "robot=/etc/passwd",
        "model.file=a.xml",
        "+model.file=a.xml",
        "%09model.file=a.xml",
        "%E3%80%80model.file=a.xml",
        "%22model%22.file=a.xml",
        "MODEL.file=a.xml",
        "model.file%3Da.xml",
        "model=%7Bfile%3D'a.xml'%7D",
        ".model.file=a.xml",
        "settings.model.file=a.xml",
        "+fault.kind=push",
        "seed=" + 5000 * "9",
        "radio.delay_frames=" + 3000 * "[",
        "scenario=../a.toml",
        "radio.delay_frames=-1",
        "seed=x",
        "nonsense=1",
        "name=x&scenario=league",
        "seeds=3",
        "radio.=",
        "%ff=%00",
    ],
)
def test_a_link_names_no_files_and_only_allowed_values(query: str) -> None:
    with pytest.raises(OmniError, match=re.compile("link|must|unknown|cannot", re.I)):
        load_link(query)


def test_without_the_extra_it_says_how_to_install_it() -> None:
    code = "import sys; sys.modules['viser'] = None; sys.argv = ['omni-mj', 'play']\n"
    code += "from omni_mj.cli.main import main; main()"
    done = run_python(code=code)
    assert done.returncode == 2
    assert "needs the package viser" in done.stderr
    assert "[play]" in done.stderr
