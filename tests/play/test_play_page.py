"""The page of `omni-mj play` in a real browser, and what others may ask of its server."""

import io
import re
import shutil
import signal
import socket
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, NamedTuple
from urllib.request import Request, urlopen

import numpy as np
import pytest
from commands import invoke
from PIL import Image

from omni_control.errors import OmniError
from omni_mj.config.scenario import load_scenario
from omni_mj.viz import style

pytest.importorskip("viser", reason="the extra play is not installed")
import viser

from omni_mj.play.live_plots import LivePlots
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


def test_pages_of_other_sites_are_refused_and_a_signal_frees_the_port(tmp_path: Path) -> None:
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
            for headers in (
                {"Host": "evil.example"},
                {"Host": "[::1"},
                {"Origin": "http://evil.example"},
            ):
                with pytest.raises(OSError, match="403"):
                    urlopen(Request(url, headers=headers), timeout=10)
            process.send_signal(signal.SIGTERM)
            assert process.wait(TIMEOUT_S) == 128 + signal.SIGTERM
            assert process.stderr
            assert "but not a thread of a controller" in process.stderr.read()
    socket.create_server(("127.0.0.1", int(url.rstrip("/").rpartition(":")[2]))).close()


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
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.returncode == 2
    assert "needs the package viser" in done.stderr
    assert "[play]" in done.stderr
