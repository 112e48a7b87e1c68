"""Rerun viewers: start one in a process of its own, find one that listens, save its image."""

import os
import re
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections import defaultdict
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from rerun.experimental import ViewerClient

from omni_control.errors import OmniError
from omni_mj.io.atomic_files import open_atomic

START_TIMEOUT_S, CONNECT_TIMEOUT_S = 60.0, 2.0
DRAW_TIMEOUT_S = 30.0  # for the viewer to load and draw
POLL_S = 0.2  # between two values that must be equal
# Environment of a viewer that connects to no other machine. Its configuration turns off usage
# statistics. Nothing turns off the search for updates and examples, so a proxy address at which
# nothing listens makes it fail.
DEAD_PROXY = "http://127.0.0.1:9"
OFFLINE_ENVIRONMENT = {
    "http_proxy": DEAD_PROXY,
    "https_proxy": DEAD_PROXY,
    "all_proxy": DEAD_PROXY,
    "no_proxy": "127.0.0.1,localhost",
}
OFFLINE_ENVIRONMENT |= {name.upper(): value for name, value in OFFLINE_ENVIRONMENT.items()}
OFFLINE_ENVIRONMENT["XDG_CONFIG_HOME"] = str(Path(__file__).parent / "viewer_config")


class Viewer:
    """A viewer's process. It listens on this machine only and connects to no other.

    Args:
        options: Options of the command `rerun`.
        file: File to read from standard input, together with the option `-`.

    Attributes:
        url: Address at which the viewer listens.

    Raises:
        OmniError: The viewer cannot open its window, or cannot draw without one.
    """

    def __init__(self, *options: str, file: Path | None = None) -> None:
        with socket.create_server(("127.0.0.1", 0)) as free_socket:
            port = str(free_socket.getsockname()[1])
        self.url = f"rerun+http://127.0.0.1:{port}/proxy"
        command = [sys.executable, "-m", "rerun", *options, "--bind", "127.0.0.1", "--port", port]
        # Open as long as the viewer.
        self._output = output = tempfile.TemporaryFile("w+")  # noqa: SIM115
        with open(file or os.devnull, "rb") as stdin:
            # The new session outlives this process, and can be ended as a whole.
            self._process = subprocess.Popen(
                command,
                stdin=stdin,
                stdout=output,
                stderr=output,
                start_new_session=True,
                env=os.environ | OFFLINE_ENVIRONMENT,
            )
        deadline = time.monotonic() + START_TIMEOUT_S
        while not self._is_ready():
            if self._process.poll() is not None or time.monotonic() > deadline:
                self.stop()
                raise OmniError(f"the rerun viewer does not start: {self.error_message()}")
            time.sleep(0.05)

    def error_message(self) -> str:
        """Return the viewer's own error message."""
        self._output.seek(0)
        match = re.search(r"(?:Error: |panicked at ')(.*)", self._output.read())
        return match[1] if match else "it does not answer"

    def stop(self) -> None:
        """End the viewer's process and wait until it has ended."""
        if self._process.poll() is None:
            os.killpg(self._process.pid, signal.SIGTERM)
        self._process.wait()

    def _is_ready(self) -> bool:
        """Return whether the window answers; the server does so earlier."""
        try:
            return bool(ViewerClient.connect(self.url).get_state())
        except (RuntimeError, OSError):
            return False


def is_listening(url: str) -> bool:
    """Return whether a process listens at a URL like rerun+http://127.0.0.1:9876/proxy."""
    address = urlsplit(url)
    try:
        socket.create_connection((address.hostname, address.port), CONNECT_TIMEOUT_S).close()
        return True
    except OSError:
        return False


def validate_url(url: str) -> str:
    """Return `url` if it has the form of a viewer's address.

    Raises:
        OmniError: The URL has another form.
    """
    if not re.fullmatch(r"rerun(\+https?)?://[^/\s:]+:\d{1,5}/proxy", url):
        raise OmniError(
            "--connect needs the address of a rerun viewer, such as "
            f"rerun+http://127.0.0.1:9876/proxy, not {url!r}"
        )
    return url


def open_viewer() -> str:
    """Open a viewer's window, which outlives this process, and return the viewer's address.

    Raises:
        OmniError: There is no display, or the viewer cannot use it.
    """
    has_display = os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
    if sys.platform == "linux" and not has_display:
        raise OmniError(
            "--view needs a display, and there is none;"
            " leave out --view and open the recording on a computer with a display"
        )
    return Viewer("--expect-data-soon").url


def save_screenshot(
    recording: Path, out: Path, size: tuple[int, int], time_s: float, tabs: Sequence[str]
) -> None:
    """Save how a viewer without a display shows a recording.

    Args:
        recording: The .rrd file.
        out: PNG file.
        size: Width and height of the window, pixels.
        time_s: Simulated time to show, s.
        tabs: Tabs to open.

    Raises:
        OmniError: The viewer cannot draw, shows nothing, keeps changing, or lacks a tab.
    """
    # The viewer loads all of a recording from standard input. Of a file that it opens, it loads
    # the visible part only.
    viewer = Viewer("-", "--headless", "--window-size", f"{size[0]}x{size[1]}", file=recording)
    try:
        client = ViewerClient.connect(viewer.url)
        _wait_until_constant(lambda: _loaded_ranges(client))
        client.set_time("time", duration=time_s, play_state="paused")
        if tabs:
            _activate_tabs(client, tabs)
        image = _wait_until_constant(client.take_screenshot)
    except (RuntimeError, OSError):
        raise OmniError(
            f"the rerun viewer cannot draw: {viewer.error_message()}; without a graphics card it "
            "needs Debian's mesa-vulkan-drivers"
        ) from None
    finally:
        viewer.stop()
    with open_atomic(out) as file:
        file.write(image)


def _loaded_ranges(client: ViewerClient) -> list[object]:
    """Return the ends of all timelines that a viewer has loaded so far."""
    recordings = client.get_state().recordings
    return [timeline.end for recording in recordings for timeline in recording.timelines]


def _wait_until_constant(read: Callable[[], Any]) -> Any:
    """Return the value of `read` once two successive values are equal and not empty.

    Raises:
        OmniError: The value is empty or keeps changing until the timeout.
    """
    deadline, previous = time.monotonic() + DRAW_TIMEOUT_S, None
    while not (value := read()) or value != previous:
        if time.monotonic() > deadline:
            raise OmniError(
                "the rerun viewer shows no recording, or one that keeps changing, for "
                f"{DRAW_TIMEOUT_S:.0f} s"
            )
        time.sleep(POLL_S)
        previous = value
    return value


def _activate_tabs(client: ViewerClient, tabs: Sequence[str]) -> None:
    """Open tabs in the viewer.

    Raises:
        OmniError: A tab does not exist.
    """
    blueprint = client.get_blueprint().blueprint
    components = {path: item for path, items in blueprint.items() for item in items.values()}
    locations = defaultdict(list)  # name of a tab -> its path and container
    for container in components.values():
        if container.get("container_kind") == "Tabs":
            for path in container["contents"]:
                locations[components[path]["display_name"]].append((path, container))
    for tab in tabs:
        if tab not in locations:
            raise OmniError(f"there is no tab {tab!r}; choose from {', '.join(sorted(locations))}")
        for path, container in locations[tab]:
            container["active_tab"] = path
    client.set_blueprint(blueprint, of="recording")
