"""Films: as many pictures as asked for, of robots where the trajectory says they were; files are whole or not there."""

import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
from click.testing import CliRunner
from PIL import Image, ImageSequence

from omni_control.errors import OmniError
from omni_mj.cli.film import command
from omni_mj.scenarios import scenario
from omni_mj.show import film as films
from omni_mj.studies.run import run

SIDE = 480  # pixels


def film(*arguments: object) -> subprocess.CompletedProcess[str]:
    line = [sys.executable, "-m", "omni_mj.cli.main", "film", *map(str, arguments)]
    done = subprocess.run(line, capture_output=True, text=True, check=False)
    if "MuJoCo cannot draw here" in done.stderr:
        pytest.skip("nothing to draw with: no EGL (libegl1, libgl1-mesa-dri)")
    return done


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A robot drives 0.8 m ahead and 0.4 m to the left; another controller's does so too."""
    base = tmp_path_factory.mktemp("film") / "run"
    way = ["reference.waypoints=[[0, 0], [0.8, 0], [0.8, 0.4]]"]
    run(scenario.load("rect", way, {"plant": "kinematic"}), ["flc", "comp-flc"]).save(base)
    return base


def hat(picture: Image.Image) -> np.ndarray:
    """Centre of what is about as orange as the robot's cover, brightly lit or not, pixels from the left and the top."""
    colours = np.asarray(picture.convert("RGB"), float)[SIDE // 10 : -SIDE // 10]  # without what is written
    hue = colours / np.maximum(colours.max(2, keepdims=True), 60)
    orange = (hue[..., 0] == 1) & (hue[..., 2] < 0.6) & (np.abs(hue[..., 1] - 0.6) < 0.3)
    for axis in (0, 1):  # the trail is orange too, but thin
        orange &= np.roll(orange, 4, axis) & np.roll(orange, -4, axis)
    rows, columns = np.nonzero(orange)
    return np.array([columns.mean(), rows.mean() + SIDE // 10])


def test_robots_are_where_the_trajectory_says(folder: Path, tmp_path: Path) -> None:
    out = tmp_path / "plan.webp"
    times = "--from", 0.5, "--to", 2.5, "--rate", 1
    done = film(folder, out, "--controller", "flc", "--view", "plan", *times, "--size", f"{SIDE}x{SIDE}")
    assert done.returncode == 0, done.stderr
    rows = pq.read_table(folder / "trajectory.parquet", filters=[("controller", "=", "flc")]).to_pydict()
    # A pinhole that looks straight down from where the route and a margin fill its 45 degrees, at a point 5 cm above
    # the carpet; the cover's top is 14.5 cm high.
    distance = (0.8 + 2 * films.MARGIN_M) / 2 / np.tan(np.deg2rad(45 / 2))
    scale = SIDE / 2 / np.tan(np.deg2rad(45 / 2)) / (distance + 0.05 - 0.145)
    with Image.open(out) as pictures:
        assert pictures.n_frames == 2
        for number in range(2):
            pictures.seek(number)
            frame = 30 + 60 * number
            away = np.array([rows["x_m"][frame] - 0.4, rows["y_m"][frame] - 0.2])
            expected = SIDE / 2 + scale * away * [1, -1]
            # The dots of the league's pattern lie ahead and aside, and perspective shows a side of the cover.
            np.testing.assert_allclose(hat(pictures), expected, atol=0.02 * scale)


@pytest.mark.parametrize("kind", films.KINDS)
def test_files_hold_the_pictures_in_their_order(tmp_path: Path, kind: str) -> None:
    """Read back by the libraries that wrote them; compression moves brightness by less than it differs here."""
    levels, out = [0, 128, 255, 64], tmp_path / f"film{kind}"
    films.write((Image.new("RGB", (160, 80), (level,) * 3) for level in levels), out, rate=10)
    assert list(tmp_path.iterdir()) == [out]  # nothing that was begun is left
    if kind in (".mp4", ".webm"):
        with pytest.importorskip("av").open(str(out)) as video:
            pictures = [frame.to_ndarray(format="rgb24") for frame in video.decode(video=0)]
    else:
        with Image.open(out) as whole:
            pictures = [np.asarray(picture.convert("RGB")) for picture in ImageSequence.Iterator(whole)]
            assert whole.info["duration"] == 100  # ms
    assert {picture.shape for picture in pictures} == {(80, 160, 3)}
    np.testing.assert_allclose([picture.mean() for picture in pictures], levels, atol=6)


def test_a_film_that_is_cut_off_leaves_no_file(tmp_path: Path) -> None:
    def broken() -> Iterator[Image.Image]:
        yield Image.new("RGB", (160, 80))
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        films.write(broken(), tmp_path / "film.webm", rate=10)
    assert not list(tmp_path.iterdir())


def test_what_cannot_be_filmed_is_said(folder: Path, tmp_path: Path) -> None:
    for arguments, words in (
        ([tmp_path], "holds no run to film"),
        ([folder, tmp_path / "film.avi"], "a film's name ends in .gif, .webp, .mp4, .webm"),
        ([folder, "--controller", "p"], "has no controller 'p'; it has flc, comp-flc"),
        ([folder, "--from", 1000], "must be before the film's end"),
        ([folder, "--size", "1x1"], "--size must be like 960x320"),
    ):
        refused = CliRunner().invoke(command, list(map(str, arguments)))
        assert isinstance(refused.exception, OmniError), arguments
        assert words in str(refused.exception)
