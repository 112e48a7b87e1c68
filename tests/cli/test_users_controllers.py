"""A controller of the user runs like a built-in one; its errors give one line each."""

from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from commands import BARE, SHORT, invoke, strict
from rerun.chunk import RrdReader

import omni_mj as om

FRAME_S = 1 / 60
RUN = f"run --scenario rect --plant kinematic --no-figures --out out {SHORT}"
WITH_FLC = f"{RUN} --no-record --controller flc --controller"
MINE = '''
import numpy as np

import omni_mj as om


class Mine(om.Controller):
    """Proportional control with feed-forward."""

    gain: float = 5.0

    def command(self, frame, observation):
        self.predicted_pose = observation.pose
        target, feedforward = self.reference.at(frame, observation.pose)
        self.channels = {"error": target - observation.pose}
        return feedforward + self.gain * (target - observation.pose)
'''


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Change to a folder with a file of controllers, and return it."""
    (tmp_path / "mine.py").write_text(MINE)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def add(name: str, body: str) -> str:
    """Add a class to the user's file, a Mine with other code in it, and return its name."""
    with Path("mine.py").open("a") as file:
        file.write(f"\n\nclass {name}(Mine):\n{body}\n")
    return f"mine.py:{name}"


def test_a_users_controller_runs_with_the_others_and_repeats_if_its_code_is_allowed(
    capsys: pytest.CaptureFixture[str],
) -> None:
    """Table, summary, recording and scenario name it; its commands follow its control law."""
    arguments = "--controller flc --controller mine.py:Mine --set controller.Mine.gain=4 --seeds 2"
    assert invoke(RUN, arguments) == 0
    assert "Mine" in capsys.readouterr().out
    assert list(strict(Path("out/summary.json"))["scenarios"]["rect"]["results"]) == ["flc", "Mine"]
    chunks = RrdReader(Path("out/recording.rrd")).stream().to_chunks()
    assert "/world/Mine/robot" in {chunk.entity_path for chunk in chunks}
    frames = pq.read_table("out/trajectory.parquet")
    frames_of_mine = frames.filter(pa.compute.equal(frames["controller"].cast(pa.string()), "Mine"))
    for seed in (0, 1):
        rows = frames_of_mine.filter(pa.compute.equal(frames_of_mine["seed"], seed)).sort_by(
            "frame"
        )
        for i, (axis, rate) in enumerate(
            (("x_m", "vx_m_s"), ("y_m", "vy_m_s"), ("heading_rad", "w_rad_s")), 1
        ):
            ref, predicted = rows[f"ref_{axis}"].to_numpy(), rows[f"predicted_{axis}"].to_numpy()
            expected = np.append(np.diff(ref) / FRAME_S, 0.0) + 4.0 * (ref - predicted)
            # Rounding of numbers of size 1; the loop's limits are far away.
            np.testing.assert_allclose(
                rows[f"command_{rate}"].to_numpy(), expected, rtol=0, atol=1e-12
            )
            np.testing.assert_allclose(
                rows[f"channel_error_{i}"].to_numpy(), ref - predicted, rtol=0, atol=1e-12
            )

    Path("out").rename("first")
    again = f"--scenario first/scenario.toml {BARE} --out out"
    assert invoke(again) == 2, "a scenario runs no code unasked"
    assert "--allow-code" in capsys.readouterr().err
    assert not Path("out").exists()
    with pytest.raises(om.OmniError, match="not run without permission"):
        om.load_scenario("first/scenario.toml")
    assert om.load_scenario("first/scenario.toml", allow_code=True).labels == ("flc", "Mine")
    assert invoke(again, "--allow-code") == 0
    assert Path("out/scenario.toml").read_text() == Path("first/scenario.toml").read_text()
    np.testing.assert_array_equal(pq.read_table("out/trajectory.parquet")["x_m"], frames["x_m"])


FAILS = {
    "raise ValueError('no\\n way')": ("ValueError: no way", "mine.py, line"),
    "np.linalg.inv(np.zeros((2, 2)))": ("LinAlgError",),
    "return np.zeros((1, 2))": ("(1, 2)", "(1, 3)"),
    "return None": ("(1, 3)",),
    "return [['fast', 'left', 0]]": ("could not convert", "'fast'"),
    "return observation.pose * np.nan": ("not finite",),
    "self.alpha_hat = np.ones((1, 2))": ("alpha_hat", "(1, 2)", "(1, 3)"),
}


@pytest.mark.parametrize("body", FAILS)
def test_a_failing_controller_is_one_line_and_the_others_continue(
    body: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """It fails in frame 9: the earlier frames are saved, and the summary has the cause."""
    code = (
        f"    def command(self, frame, observation):\n        if frame == 9:\n            {body}\n"
    )
    name = add("Wrong", f"{code}        return super().command(frame, observation)")
    assert invoke(WITH_FLC, name, "--quiet") == 1
    stdout, stderr = capsys.readouterr()
    assert (stdout, stderr.count("\n")) == ("", 1)
    for words in ("error: Wrong, seed 0: ", "frame 9", " at 0.150 s", *FAILS[body]):
        assert words in stderr
    entry = strict(Path("out/summary.json"))["scenarios"]["rect"]
    (failed,) = entry["failures"]
    assert (failed["controller"], failed["time_s"]) == ("Wrong", 0.15)
    assert pq.read_table("out/trajectory.parquet").num_rows == entry["frames"] + 9


@pytest.mark.parametrize(
    "body",
    [
        "    def command(self, frame, observation):\n        return self.missing",
        "    def __init__(self, model, reference, n):\n        return",
        "    def __init__(self, model, reference, n):\n        raise KeyError('gain')",
    ],
)
def test_a_controller_that_fails_at_the_start_leaves_scenario_and_cause(
    body: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert invoke(RUN, "--controller", add("Never", body)) == 1
    stdout, stderr = capsys.readouterr()
    assert "Never (failed 1 of 1)" in stdout
    assert stderr.startswith("error: Never, seed 0: Never ")
    assert stderr.count("\n") == 1
    assert strict(Path("out/summary.json"))["scenarios"]["rect"]["failures"][0]["time_s"] == 0
    assert Path("out/scenario.toml").exists()
    assert not Path("out/trajectory.parquet").exists()


def test_a_failing_plant_is_one_line_with_its_place_in_the_code(
    capsys: pytest.CaptureFixture[str],
) -> None:
    start = "    def __init__(self, rows, start):\n        raise ValueError('stuck')\n"
    Path("plant.py").write_text(
        f"class Bad:\n    pose = twist = advance = telemetry = None\n\n{start}"
    )
    assert invoke("run --scenario rect --plant plant.py:Bad --quiet") == 2
    assert capsys.readouterr().err == "error: the plant Bad (plant.py, line 5): ValueError: stuck\n"


def test_wrong_names_and_files_are_one_line_and_leave_no_folder(
    capsys: pytest.CaptureFixture[str],
) -> None:
    Path("broken.py").write_text("import nothing_there\n")
    for kind, expected_error in (
        ("mine.py:Mime", "it has Mine"),
        ("nowhere.py:Mine", "there is no file nowhere.py"),
        ("broken.py:Mine", "cannot be run: ModuleNotFoundError"),
        ("mine.py", "file.py:Class"),
    ):
        assert invoke(WITH_FLC, kind, "--set radio.delay_frames=-1") == 2
        stdout, stderr = capsys.readouterr()
        assert stdout == ""
        assert len(stderr.splitlines()) == 2, "the delay as well"
        assert expected_error in stderr
        assert not Path("out").exists()
    Path("toy.py").write_text("class Toy:\n    pass\n")
    assert invoke(RUN, "--plant toy.py:Toy") == 2
    assert "pose, twist, advance, telemetry" in capsys.readouterr().err
