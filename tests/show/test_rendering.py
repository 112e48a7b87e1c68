"""The viewer draws of a recording the field, the robots where they are, and the plots."""

import sys
import time
from collections.abc import Iterator
from io import BytesIO
from pathlib import Path

import numpy as np
import pytest
from benches.recording import Listener
from commands import invoke
from matplotlib.image import imread
from numpy.typing import NDArray
from rerun.experimental import ViewerClient

DRIVERS = [*Path("/usr/share/vulkan/icd.d").glob("*.json"), *Path("/etc/vulkan/icd.d").glob("*.json")]
pytestmark = pytest.mark.skipif(
    sys.platform == "linux" and not DRIVERS, reason="nothing to draw with: no Vulkan driver (mesa-vulkan-drivers)"
)
CARPET, ORANGE, BLUE = (33, 66, 45), (0xD5, 0x5E, 0x00), (0x00, 0x72, 0xB2)
# Parts of a window of 1600x900 without their title bars: rows, columns.
FIELD, CLOSE_UP = np.s_[70:400, 0:790], np.s_[440:690, 0:795]
PLOTS = np.s_[70:860, 810:1590]


@pytest.fixture(scope="module")
def viewer(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ViewerClient]:
    """A viewer of robots that drive 1 m ahead, then 0.8 m to the left."""
    folder = tmp_path_factory.mktemp("rendering") / "run"
    options = ("--set", "reference.waypoints=[[0, 0], [1, 0], [1, 0.8]]", "--plant", "planar", "--no-figures")
    controllers = ("--controller", "flc", "--controller", "comp-flc")
    assert invoke("run", "--scenario", "rect", *options, *controllers, "--quiet", "--out", folder) == 0
    listener = Listener("-", "--headless", "--window-size", "1600x900", file=folder / "recording.rrd")
    viewer = ViewerClient.connect(listener.url)
    while not any(recording.timelines for recording in viewer.get_state().recordings):
        time.sleep(0.2)
    yield viewer
    listener.end()


def drawn(viewer: ViewerClient, time_s: float) -> NDArray:
    """Return what the viewer draws at a time, once that no longer changes."""
    viewer.set_time("time", duration=time_s, play_state="paused")
    before = b""
    while (now := viewer.take_screenshot()) != before:
        time.sleep(0.5)
        before = now
    return 255 * imread(BytesIO(now))[..., :3]


def count(image: NDArray, colour: tuple[int, int, int]) -> int:
    """Return the number of pixels that have the direction of a colour, lit or shaded."""
    size = np.maximum(np.linalg.norm(image, axis=-1), 60)
    return int(((image @ np.array(colour) / size / np.linalg.norm(colour)) > 0.985).sum())


def test_the_viewer_shows_field_robots_and_plots(viewer: ViewerClient) -> None:
    """Robots move on the field, and leave paths there."""
    start, later = drawn(viewer, 0.0), drawn(viewer, 3.0)
    assert start.shape == (900, 1600, 3)
    assert count(start[FIELD], CARPET) > 100_000
    assert count(start[CLOSE_UP], BLUE) > 5_000
    assert (np.abs(later[FIELD] - start[FIELD]).max(-1) > 60).sum() > 2_000
    assert all(count(later[PLOTS], colour) > 300 for colour in (ORANGE, BLUE))
