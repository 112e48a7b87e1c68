"""`omni-mj screenshot`: an image of the rerun viewer that shows a recording, without a display."""

import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

import click

from omni_control.errors import OmniError
from omni_mj.cli.film import parse_size

if TYPE_CHECKING:
    from rerun.experimental import ViewerClient

TIMEOUT_S = 30.0  # for the viewer to load and draw
POLL_S = 0.2  # between two values that must be equal
T = TypeVar("T")


@click.command("screenshot")
@click.argument("recording", type=click.Path(exists=True, dir_okay=False, path_type=Path))
@click.argument("out", type=click.Path(path_type=Path))
@click.option(
    "--time",
    "time_s",
    default=0.0,
    metavar="S",
    help="Simulated time to show, s. Default: 0.",
)
@click.option(
    "--tab",
    "tabs",
    multiple=True,
    metavar="NAME",
    help="Tab to open, such as wheels; may be repeated. Default: those of the recording.",
)
@click.option(
    "--size",
    default="1600x900",
    callback=parse_size,
    metavar="WxH",
    help="Width and height of the window, pixels. Default: 1600x900.",
)
def command(
    recording: Path, out: Path, time_s: float, tabs: tuple[str, ...], size: tuple[int, int]
) -> None:
    """Save how the rerun viewer shows RECORDING.rrd as OUT.png.

    No display is needed, but a Vulkan driver is: Debian's mesa-vulkan-drivers suffices.
    """
    from rerun.experimental import ViewerClient

    from omni_mj.files import open_atomic
    from omni_mj.viz.recording.viewer import Viewer

    # The viewer loads all of a recording from standard input. Of a file that it opens, it loads
    # the visible part only.
    viewer = Viewer("-", "--headless", "--window-size", f"{size[0]}x{size[1]}", file=recording)
    try:
        image = _take_screenshot(ViewerClient.connect(viewer.url), time_s, tabs)
    except (RuntimeError, OSError):
        reason = f"the rerun viewer cannot draw: {viewer.error_message()}"
        raise OmniError(
            f"{reason}; without a graphics card it needs Debian's mesa-vulkan-drivers"
        ) from None
    finally:
        viewer.stop()
    with open_atomic(out) as file:
        file.write(image)


def _take_screenshot(viewer: "ViewerClient", time_s: float, tabs: tuple[str, ...]) -> bytes:
    """Return a PNG of a viewer's window after the recording is loaded and drawn.

    Raises:
        OmniError: A tab does not exist, or the image keeps changing.
    """

    def loaded_ranges() -> list[object]:
        recordings = viewer.get_state().recordings
        return [timeline.end for recording in recordings for timeline in recording.timelines]

    _wait_until_constant(loaded_ranges)
    viewer.set_time("time", duration=time_s, play_state="paused")
    if tabs:
        _activate_tabs(viewer, tabs)
    return _wait_until_constant(viewer.take_screenshot)


def _wait_until_constant(read: Callable[[], T]) -> T:
    """Return the value of `read` once two successive values are equal and not empty.

    Raises:
        OmniError: The value is empty or keeps changing until the timeout.
    """
    deadline, previous = time.monotonic() + TIMEOUT_S, None
    while not (value := read()) or value != previous:
        if time.monotonic() > deadline:
            raise OmniError(
                "the rerun viewer shows no recording, or one that keeps changing, for "
                f"{TIMEOUT_S:.0f} s"
            )
        time.sleep(POLL_S)
        previous = value
    return value


def _activate_tabs(viewer: "ViewerClient", tabs: tuple[str, ...]) -> None:
    """Open tabs in the viewer.

    Raises:
        OmniError: A tab does not exist.
    """
    blueprint = viewer.get_blueprint().blueprint
    components = {path: item for path, items in blueprint.items() for item in items.values()}
    containers = [item for item in components.values() if item.get("container_kind") == "Tabs"]
    names = [
        (components[path]["display_name"], path, container)
        for container in containers
        for path in container["contents"]
    ]
    known = sorted({name for name, _, _ in names})
    for tab in tabs:
        if tab not in known:
            raise OmniError(f"there is no tab {tab!r}; choose from {', '.join(known)}")
        for name, path, container in names:
            if name == tab:
                container["active_tab"] = path
    viewer.set_blueprint(blueprint, of="recording")
