"""`omni-mj picture`: what the rerun viewer shows of a recording, without a display."""

import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

import click

from omni_control.errors import OmniError
from omni_mj.cli.film import pixels

if TYPE_CHECKING:
    from rerun.experimental import ViewerClient

PATIENCE_S = 30.0  # for a viewer to load and draw
STILL_S = 0.2  # between two looks that find no change
T = TypeVar("T")


@click.command("picture")
@click.argument("recording", type=click.Path(exists=True, dir_okay=False, path_type=Path))
@click.argument("out", type=click.Path(path_type=Path))
@click.option(
    "--time", "time_s", default=0.0, metavar="S", help="Where the time cursor stands. [0]"
)
@click.option(
    "--tab",
    "tabs",
    multiple=True,
    metavar="NAME",
    help="A tab to show, such as wheels; may be repeated.",
)
@click.option(
    "--size", default="1600x900", callback=pixels, metavar="WxH", help="Of the window. [1600x900]"
)
def command(
    recording: Path, out: Path, time_s: float, tabs: tuple[str, ...], size: tuple[int, int]
) -> None:
    """Draw RECORDING.rrd as the viewer shows it, and save the picture as OUT.png.

    It needs no display, but something that Vulkan draws with: Debian's mesa-vulkan-drivers will do.
    """
    from rerun.experimental import ViewerClient

    from omni_mj.files import open_atomic
    from omni_mj.viz.recording.viewer import Viewer

    # From its standard input a viewer loads all of a recording; of a file that it opens, only what
    # is in sight.
    viewer = Viewer("-", "--headless", "--window-size", f"{size[0]}x{size[1]}", file=recording)
    try:
        image = _take(ViewerClient.connect(viewer.url), time_s, tabs)
    except (RuntimeError, OSError):
        reason = f"the rerun viewer cannot draw: {viewer.error_message()}"
        raise OmniError(
            f"{reason}; without a graphics card it needs Debian's mesa-vulkan-drivers"
        ) from None
    finally:
        viewer.stop()
    with open_atomic(out) as file:
        file.write(image)


def _take(viewer: "ViewerClient", time_s: float, tabs: tuple[str, ...]) -> bytes:
    """Return a PNG of a viewer's window, once it has loaded its recording and no longer changes.

    Raises:
        OmniError: There is no such tab, or the picture keeps changing.
    """
    _still(
        lambda: [
            line.end for recording in viewer.get_state().recordings for line in recording.timelines
        ]
    )
    viewer.set_time("time", duration=time_s, play_state="paused")
    if tabs:
        _show(viewer, tabs)
    return _still(viewer.take_screenshot)


def _still(look: Callable[[], T]) -> T:
    """Look until there is something that looks the same again after a while."""
    deadline, before = time.monotonic() + PATIENCE_S, None
    while not (now := look()) or now != before:
        if time.monotonic() > deadline:
            raise OmniError(
                f"the rerun viewer shows no recording, or one that never rests, for {PATIENCE_S:.0f} s"
            )
        time.sleep(STILL_S)
        before = now
    return now


def _show(viewer: "ViewerClient", tabs: tuple[str, ...]) -> None:
    """Make `tabs` the active ones of their containers, in the viewer's blueprint."""
    blueprint = viewer.get_blueprint().blueprint
    parts = {path: part for path, archetypes in blueprint.items() for part in archetypes.values()}
    containers = [part for part in parts.values() if part.get("container_kind") == "Tabs"]
    names = [
        (parts[path]["display_name"], path, container)
        for container in containers
        for path in container["contents"]
    ]
    for tab in tabs:
        if tab not in (known := {name for name, _, _ in names}):
            raise OmniError(f"there is no tab {tab!r}; there are {', '.join(sorted(known))}")
        for name, path, container in names:
            if name == tab:
                container["active_tab"] = path
    viewer.set_blueprint(blueprint, of="recording")
