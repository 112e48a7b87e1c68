"""A user's own controller from the command line: it runs like any other, and its mistakes are lines."""

from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from commands import invoke, strict
from rerun.chunk import RrdReader

from omni_control.errors import OmniError
from omni_mj.show.film import Film

FRAME_S = 1 / 60
SHORT = ("--set", "reference.waypoints=[[0, 0, 0], [0.2, 0.1, 0.3]]", "--set", "reference.settle_s=0.1")
RUN = ("run", "--scenario", "rect", "--plant", "kinematic", "--no-figures", "--out", "out", *SHORT)
BESIDE_FLC = (*RUN, "--no-record", "--controller", "flc", "--controller")
GAIN = 5.0
MINE = f'''
"""Controllers of a user."""

from dataclasses import dataclass

import numpy as np

import omni_mj as om


@dataclass
class Memory:
    commands: int = 0


class Mine(om.Controller):
    """Proportional control with feed-forward."""

    gain: float = {GAIN}

    def command(self, frame, seen):
        self.predicted = seen.pose
        target, feed_forward = self.reference.at(frame, seen.pose)
        self.channels = {{"error": target - seen.pose}}
        return feed_forward + self.gain * (target - seen.pose)
'''


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder that a user is in, with a file of controllers in it."""
    (tmp_path / "mine.py").write_text(MINE)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def add(name: str, body: str) -> str:
    """Add a class to the user's file, a Mine with other code in it, and return how it is called."""
    with Path("mine.py").open("a") as file:
        file.write(f"\n\nclass {name}(Mine):\n{body}\n")
    return f"mine.py:{name}"


def test_a_users_controller_runs_beside_the_others(capsys: pytest.CaptureFixture[str]) -> None:
    """Table, Parquet, summary and recording name it after its class; what it sent is what its own law says."""
    given = ("--controller", "flc", "--controller", "mine.py:Mine", "--set", "controller.Mine.gain=4", "--seeds", 2)
    assert invoke(*RUN, *given) == 0
    printed = capsys.readouterr()
    assert printed.err == ""
    assert "Mine" in printed.out
    summary = strict(Path("out/summary.json"))
    assert summary["controllers"] == list(summary["scenarios"]["rect"]["results"]) == ["flc", "Mine"]
    chunks = RrdReader(Path("out/recording.rrd")).stream().to_chunks()
    assert "/world/Mine/robot" in {chunk.entity_path for chunk in chunks}

    table = pq.read_table("out/trajectory.parquet")
    label = table["controller"].cast(pa.string())
    assert label.unique().to_pylist() == ["flc", "Mine"]
    own = table.filter(pa.compute.equal(label, "Mine"))
    for seed in (0, 1):
        rows = own.filter(pa.compute.equal(own["seed"], seed)).sort_by("frame")
        for i, (axis, rate) in enumerate((("x_m", "vx_m_s"), ("y_m", "vy_m_s"), ("heading_rad", "w_rad_s")), 1):
            ref, seen = rows[f"ref_{axis}"].to_numpy(), rows[f"predicted_{axis}"].to_numpy()
            velocity = np.append(np.diff(ref) / FRAME_S, 0.0)
            # Rounding of numbers of size 1; the loop's limits are far away.
            expected = velocity + 4.0 * (ref - seen)
            np.testing.assert_allclose(rows[f"command_{rate}"].to_numpy(), expected, rtol=0, atol=1e-12)
            np.testing.assert_allclose(rows[f"own_error_{i}"].to_numpy(), ref - seen, rtol=0, atol=1e-12)


def test_the_effective_scenario_repeats_a_users_controller_bit_for_bit(folder: Path) -> None:
    assert invoke(*BESIDE_FLC, "mine.py:Mine") == 0
    text = Path("out/scenario.toml").read_text()
    assert 'controllers = ["flc", "mine.py:Mine"]' in text
    Path("out").rename("first")
    with pytest.raises(OmniError, match="--allow-code"):
        Film.of(Path("first"))
    assert len(Film.of(Path("first"), code=True).takes) == 2
    again = ("--scenario", "first/scenario.toml", "--no-record", "--no-figures", "--quiet", "--out", "out")
    assert invoke(*again) == 2, "a scenario runs no code unasked"
    assert not Path("out").exists()
    assert invoke(*again, "--allow-code") == 0
    assert Path("out/scenario.toml").read_text() == text
    first, second = (pq.read_table(folder / name / "trajectory.parquet") for name in ("first", "out"))
    assert first.num_rows > 0
    # Compared as bytes, since what is not a number is not equal to itself.
    assert [c.combine_chunks().buffers()[-1] for c in first.columns[1:]] == [
        c.combine_chunks().buffers()[-1] for c in second.columns[1:]
    ]


def test_every_mistake_is_a_line_on_the_terminal_and_leaves_no_folder(capsys: pytest.CaptureFixture[str]) -> None:
    assert invoke(*BESIDE_FLC, "mine.py:Mime", "--set", "radio.delay_frames=-1") == 2
    stdout, stderr = capsys.readouterr()
    assert stdout == ""
    assert [line.split(" ")[:2] for line in stderr.splitlines()] == [
        ["error:", "mine.py"],
        ["error:", "radio.delay_frames"],
    ]
    assert not Path("out").exists()


FAILS = {
    "raise ValueError('no way')": ("ValueError: no way", "mine.py, line"),
    "np.linalg.inv(np.zeros((2, 2)))": ("LinAlgError", "mine.py, line"),
    "return np.zeros((1, 2))": ("(1, 2)", "(1, 3)"),
    "return None": ("(1, 3)",),
    "return [['fast', 'left', 0]]": ("could not convert", "'fast'"),
    "return seen.pose * np.nan": ("not finite",),
    "return seen.pose + np.inf": ("not finite",),
    "self.alpha_hat = np.ones((1, 2))": ("alpha_hat", "(1, 2)", "(1, 3)"),
}


def test_a_controller_that_fails_is_a_line_and_the_others_go_on(capsys: pytest.CaptureFixture[str]) -> None:
    """Each in frame 9: that many frames of it are kept, and what it was and why is in the summary."""
    for i, (body, says) in enumerate(FAILS.items()):
        code = f"    def command(self, frame, seen):\n        if frame == 9:\n            {body}\n"
        name = add(f"Wrong{i}", f"{code}        return super().command(frame, seen)")
        assert invoke(*BESIDE_FLC, name, "--quiet", "--overwrite") == 1
        stdout, stderr = capsys.readouterr()
        assert stdout == ""
        assert stderr.count("\n") == 1, stderr
        assert stderr.startswith(f"error: Wrong{i}, seed 0: Wrong{i} ")
        assert stderr.endswith(" at 0.150 s\n")
        for words in ("frame 9", *says):
            assert words in stderr
        summary = strict(Path("out/summary.json"))
        entry = summary["scenarios"]["rect"]
        assert (summary["complete"], entry["status"]) == (True, "done")
        (failed,) = entry["failed"]
        assert (failed["controller"], failed["time_s"]) == (f"Wrong{i}", 0.15)
        assert pq.read_table("out/trajectory.parquet").num_rows == entry["frames"] + 9


def test_a_controller_that_fails_at_once_leaves_its_scenario_and_the_reason(
    capsys: pytest.CaptureFixture[str],
) -> None:
    """It raises in its first frame, or when it is made, or forgets its base class; no output trips over that."""
    for i, body in enumerate(
        (
            "    def command(self, frame, seen):\n        return self.missing",
            "    def __init__(self, told, reference, n):\n        return",
            "    def __init__(self, told, reference, n):\n        super().__init__(told, reference, n, 3)",
            "    def __init__(self, told, reference, n):\n        raise KeyError('gain')",
        )
    ):
        name = add(f"Never{i}", body)
        assert invoke(*RUN, "--controller", name, "--overwrite") == 1
        stdout, stderr = capsys.readouterr()
        assert f"Never{i} (failed 1 of 1)" in stdout
        assert stderr.startswith(f"error: Never{i}, seed 0: Never{i} ")
        assert stderr.count("\n") == 1
        assert strict(Path("out/summary.json"))["scenarios"]["rect"]["failed"][0]["time_s"] == 0
        assert Path("out/scenario.toml").exists()
        assert not Path("out/trajectory.parquet").exists()
