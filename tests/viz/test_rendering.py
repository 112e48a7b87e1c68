"""Pictures of a recording show the field, the robots and the plots."""

import sys
from pathlib import Path

import numpy as np
import pytest
from commands import invoke
from matplotlib.image import imread
from numpy.typing import NDArray

DRIVERS = [
    *Path("/usr/share/vulkan/icd.d").glob("*.json"),
    *Path("/etc/vulkan/icd.d").glob("*.json"),
]
pytestmark = pytest.mark.skipif(
    sys.platform == "linux" and not DRIVERS,
    reason="there is no Vulkan driver (mesa-vulkan-drivers)",
)
CARPET, ORANGE, BLUE = (33, 66, 45), (0xD5, 0x5E, 0x00), (0x00, 0x72, 0xB2)
# Rows and columns of the views in a window of 1600x900, without title bars.
FIELD, CLOSE_UP = np.s_[70:400, 0:790], np.s_[440:690, 0:795]
PLOTS = np.s_[70:860, 810:1590]


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A recording of robots that drive 1 m forward, then 0.8 m to the left."""
    folder = tmp_path_factory.mktemp("rendering") / "run"
    route = "--set reference.waypoints=[[0,0],[1,0],[1,0.8]] --set reference.settle_s=0.1"
    run = "run --scenario rect --plant kinematic --controller flc --controller comp-flc"
    assert invoke(run, route, "--no-figures --quiet --out", folder) == 0
    return folder / "recording.rrd"


def count_pixels(image: NDArray, color: tuple[int, int, int]) -> int:
    """Return the number of pixels with the hue of a color, lit or shaded."""
    size = np.maximum(np.linalg.norm(image, axis=-1), 60)
    return int(((image @ np.array(color) / size / np.linalg.norm(color)) > 0.985).sum())


def test_a_picture_shows_field_robots_and_plots(recording: Path, tmp_path: Path) -> None:
    """Robots have moved on the field; the picture shows the named tab."""
    out = tmp_path / "picture.png"
    assert invoke("screenshot", recording, out, "--time 3.0 --tab velocity") == 0
    image = 255 * imread(out)[..., :3]
    assert image.shape == (900, 1600, 3)
    assert count_pixels(image[FIELD], CARPET) > 100_000
    assert count_pixels(image[CLOSE_UP], BLUE) > 5_000
    # At the start, where one robot hides the other, there are 1300.
    assert sum(count_pixels(image[FIELD], color) for color in (ORANGE, BLUE)) > 2_300
    assert all(count_pixels(image[PLOTS], color) > 300 for color in (ORANGE, BLUE))


def test_an_unknown_tab_is_reported(
    recording: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert invoke("screenshot", recording, tmp_path / "x.png", "--tab wheel") == 2
    assert "no tab 'wheel'; choose from alpha, comp-flc, events" in capsys.readouterr().err
