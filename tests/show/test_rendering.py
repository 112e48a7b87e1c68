"""The recording as a viewer shows it: the scene, the robots where they are, and every plot drawn."""

import sys
from collections.abc import Callable, Iterator
from io import BytesIO
from pathlib import Path

import numpy as np
import pytest
from benches.recording import record, simulated
from matplotlib.image import imread
from numpy.typing import NDArray
from rerun.experimental import ViewerClient

from omni_control.errors import OmniError
from omni_mj.cli import picture
from omni_mj.show.recording.viewer import Viewer

DRIVERS = [*Path("/usr/share/vulkan/icd.d").glob("*.json"), *Path("/etc/vulkan/icd.d").glob("*.json")]
pytestmark = pytest.mark.skipif(
    sys.platform == "linux" and not DRIVERS, reason="nothing to draw with: no Vulkan driver (mesa-vulkan-drivers)"
)
WIDTH, HEIGHT = 1600, 900
CARPET, ORANGE, BLUE, WHITE = (33, 66, 45), (0xD5, 0x5E, 0x00), (0x00, 0x72, 0xB2), (240, 240, 240)
# Where the default layout has them, their title bars left out: rows, columns.
FIELD, PLAN, CLOSE = np.s_[70:400, 0:790], np.s_[440:690, 0:395], np.s_[440:690, 405:795]
PLOTS = np.s_[70:860, 810:1590]

Shot = Callable[..., NDArray]


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A robot drives 1 m ahead, then 0.8 m to the left."""
    path = tmp_path_factory.mktemp("rendering") / "recording.rrd"
    way = ["reference.waypoints=[[0, 0], [1, 0], [1, 0.8]]", "wheels.model=two-rollers", "physics.kernel=numpy"]
    record(simulated(["flc", "comp-flc"], *way, plant="mujoco"), path)
    return path


@pytest.fixture(scope="module")
def viewer(recording: Path) -> Iterator[ViewerClient]:
    started = Viewer("-", "--headless", "--window-size", f"{WIDTH}x{HEIGHT}", file=recording)
    yield ViewerClient.connect(started.url)
    started.stop()


@pytest.fixture(scope="module")
def shot(viewer: ViewerClient) -> Shot:
    """Pictures (rows, columns, 3) at a time, with tabs; no view may complain."""

    def take(time_s: float, *tabs: str) -> NDArray:
        image = imread(BytesIO(picture.take(viewer, time_s, tabs)))
        assert [report for view in viewer.get_state().views for report in view.reports] == []
        assert image.shape[:2] == (HEIGHT, WIDTH)
        return (255 * image[..., :3]).round().astype(int)

    return take


def count(image: NDArray, colour: tuple[int, int, int], within: int = 12) -> int:
    return int((np.abs(image - colour).max(-1) <= within).sum())


def hue(image: NDArray, colour: tuple[int, int, int]) -> NDArray:
    """Where pixels have the direction of a colour, lit or shaded, (rows, columns)."""
    size = np.maximum(np.linalg.norm(image, axis=-1), 60)
    return (image @ np.array(colour) / size / np.linalg.norm(colour)) > 0.985


def test_the_scene_shows_carpet_lines_reference_and_robots(shot: Shot) -> None:
    image = shot(0.0)
    assert hue(image[FIELD], CARPET).sum() > 100_000
    assert hue(image[PLAN], CARPET).sum() > 50_000
    assert count(image[PLAN], WHITE, 30) > 200  # the reference, 1.8 m at some 150 pixels a metre
    assert hue(image[CLOSE], BLUE).sum() > 5_000  # the cover of the robot beside which the view is
    assert hue(image[FIELD], ORANGE).sum() > 30
    assert all(count(image[PLOTS], colour) > 300 for colour in (ORANGE, BLUE))


def test_the_robot_drives_along_the_plan_and_leaves_its_path(shot: Shot) -> None:
    """To the right, then up: the plan's x leads to the right and its y up."""
    images = [shot(time_s)[PLAN] for time_s in (0.0, 1.5, 2.2, 5.4)]
    driven = [int((hue(image, ORANGE) | hue(image, BLUE)).sum()) for image in images]
    assert driven[0] < driven[1] < driven[2] < driven[3]
    # What differs from the picture before is where the robot was and is, and the path between.
    rows, columns = np.nonzero(np.abs(images[1] - images[0]).sum(-1) > 60)
    assert np.ptp(columns) > 2 * np.ptp(rows)
    rows, columns = np.nonzero(np.abs(images[3] - images[2]).sum(-1) > 60)
    assert np.ptp(rows) > np.ptp(columns)
    assert rows.min() < 80 < 170 < rows.max()


def test_rollers_are_seen_to_turn(shot: Shot) -> None:
    """The view beside the robot turns with it: what changes near the floor are its wheels, and the floor."""
    one, other = (shot(time_s)[CLOSE] for time_s in (1.0, 1.05))
    wheels = np.s_[120:220, 130:260]
    grey = np.ptp(one[wheels], axis=-1) < 12  # rubber and aluminium
    changed = np.abs(one[wheels] - other[wheels]).max(-1) > 40
    assert (grey & changed).sum() > 100


@pytest.mark.parametrize("tab", ["tracking", "velocity", "why", "heat"])
def test_every_tab_draws_the_lines_of_both_controllers(shot: Shot, tab: str) -> None:
    image = shot(3.0, tab)[PLOTS]
    for colour in (ORANGE, BLUE):
        assert count(image, colour) > 300, tab


@pytest.mark.parametrize("tab", ["summary", "events", "settings"])
def test_texts_are_shown(shot: Shot, tab: str) -> None:
    text = shot(3.0, tab)[730:860, 0:790]
    assert (text.max(-1) > 120).sum() > 500


def test_an_unknown_tab_is_named(viewer: ViewerClient) -> None:
    with pytest.raises(OmniError, match="no tab 'wheel'; there are alpha, comp-flc, events"):
        picture.take(viewer, 0.0, ("wheel",))
