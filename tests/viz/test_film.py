"""Films show robots at the poses of the trajectory, with the requested number of pictures."""

from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
from commands import invoke, run_python
from PIL import Image, ImageSequence

import omni_mj as om
from omni_mj.viz.film import load_tracks

SIDE = 480  # pixels
MARGIN_M = 0.35  # around the route


def film(*arguments: object) -> None:
    done = run_python("-m omni_mj.cli.main film", *arguments)
    if "MuJoCo cannot draw here" in done.stderr:
        pytest.skip("there is no EGL (libegl1, libgl1-mesa-dri)")
    assert done.returncode == 0, done.stderr


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run of two controllers along 0.8 m forward and 0.4 m to the left."""
    folder = tmp_path_factory.mktemp("film") / "run"
    options = "--plant kinematic --set reference.waypoints=[[0,0],[0.8,0],[0.8,0.4]] --quiet"
    controllers = "--controller flc --controller comp-flc --no-record --no-figures"
    assert invoke("run --scenario rect", options, controllers, "--out", folder) == 0
    return folder


def cover_center(picture: Image.Image) -> np.ndarray:
    """Return the center of the pixels in the cover's hue, pixels from the left and the top."""
    colors = np.asarray(picture.convert("RGB"), float)[SIDE // 10 : -SIDE // 10]  # without the text
    hue = colors / np.maximum(colors.max(2, keepdims=True), 60)
    orange = (hue[..., 0] == 1) & (hue[..., 2] < 0.6) & (np.abs(hue[..., 1] - 0.6) < 0.3)
    for axis in (0, 1):  # the path is orange too, but thin
        orange &= np.roll(orange, 4, axis) & np.roll(orange, -4, axis)
    rows, columns = np.nonzero(orange)
    return np.array([columns.mean(), rows.mean() + SIDE // 10])


def test_robots_are_where_the_trajectory_says(folder: Path, tmp_path: Path) -> None:
    """A pinhole camera looks straight down; the route and a margin fill its view of 45 degrees.

    Its target is 5 cm above the carpet; the cover's top is 14.5 cm high.
    """
    out = tmp_path / "plan.webp"
    times = "--from 0.5 --to 2.5 --fps 1"
    film(folder, out, "--controller flc --view plan", times, "--size", f"{SIDE}x{SIDE}")
    rows = pq.read_table(
        folder / "trajectory.parquet", filters=[("controller", "=", "flc")]
    ).to_pydict()
    half = np.tan(np.deg2rad(45 / 2))
    scale = SIDE / 2 / half / ((0.8 + 2 * MARGIN_M) / 2 / half + 0.05 - 0.145)
    with Image.open(out) as pictures:
        assert pictures.n_frames == 2
        for number in range(2):
            pictures.seek(number)
            frame = 30 + 60 * number
            away = np.array([rows["x_m"][frame] - 0.4, rows["y_m"][frame] - 0.2])
            # The dots of the league's pattern are not symmetric, and the cover has a visible side.
            np.testing.assert_allclose(
                cover_center(pictures), SIDE / 2 + scale * away * [1, -1], atol=0.02 * scale
            )
            assert pictures.info["duration"] == 1000  # ms


class Breaks(om.Controller):
    """Commands zero, and NaN for its first robot from frame 30 on."""

    def command(self, frame: int, observation: om.Observation) -> np.ndarray:
        command = np.zeros((len(observation.pose), 3))
        command[: frame >= 30] = np.nan
        return command


def test_a_failed_robot_keeps_its_pose_and_others_continue(tmp_path: Path) -> None:
    places = {"start_poses": [[0, 0, 0], [0.2, 1, 0]]}
    route = {"waypoints": [[0, 0], [0.4, 0.2]]}
    om.run(
        om.load_scenario("rect", plant="kinematic", reference=route, world=places), [Breaks], [0]
    ).save(tmp_path)
    _, (track,) = load_tracks(tmp_path, ())
    rows = pq.read_table(tmp_path / "trajectory.parquet", filters=[("slot", "=", 1)]).to_pydict()
    np.testing.assert_array_equal(track.references[:, 1, 0], rows["ref_x_m"])
    assert len(rows["ref_x_m"]) > 60
    assert (track.references[30:, 0] == track.references[29, 0]).all()


def test_a_gif_contains_the_pictures_in_order(folder: Path, tmp_path: Path) -> None:
    """The reference moves, so pictures at different times differ."""
    out = tmp_path / "film.gif"
    film(folder, out, "--fps 5 --to 1 --size 160x80")
    assert list(tmp_path.iterdir()) == [out]  # no temporary file is left
    with Image.open(out) as whole:
        pictures = [np.asarray(picture.convert("RGB")) for picture in ImageSequence.Iterator(whole)]
        assert whole.info["duration"] == 200  # ms
    assert [picture.shape for picture in pictures] == [(80, 160, 3)] * 5
    first, *_, last = (picture.astype(int) for picture in pictures)
    assert np.abs(first - last).mean() > 1


def test_bad_input_is_one_message(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for arguments, words in (
        ([tmp_path], "holds no run"),
        ([folder, tmp_path / "film.avi"], "the name of a film must end in .gif, .webp"),
        ([folder, "--controller", "p"], "has no controller 'p'; it has flc, comp-flc"),
        ([folder, "--from", 1000], "must be before the film's end"),
        ([folder, "--size", "1x1"], "--size must be WIDTHxHEIGHT"),
    ):
        assert invoke("film", *arguments) == 2
        assert words in capsys.readouterr().err
