"""A user's own controller from the command line: it runs like any other, and its mistakes are lines."""

import json
from contextlib import chdir, redirect_stderr, redirect_stdout
from dataclasses import dataclass
from io import StringIO
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from rerun.chunk import RrdReader

from omni_mj.cli import console
from omni_mj.cli.run import run as command_line

FRAME_S = 1 / 60
SHORT = ["--set", "reference.waypoints=[[0, 0, 0], [0.2, 0.1, 0.3]]", "--set", "reference.settle_s=0.1"]
GAIN = 5.0
MINE = f'''
"""Controllers of a user."""

from dataclasses import dataclass

import numpy as np

from omni_control.controllers.base import Controller


@dataclass
class Memory:
    commands: int = 0


class MyTracker(Controller):
    """Proportional control with feed-forward."""

    def command(self, frame, observed, sent):
        self.predicted = observed.pose
        target, feed_forward = self.reference.at(frame, observed.pose)
        return feed_forward + {GAIN} * (target - observed.pose)


class Stranger:
    """No tracker."""
'''


@pytest.fixture
def user(tmp_path: Path) -> Path:
    """A folder with a file of controllers in it."""
    (tmp_path / "mine.py").write_text(MINE)
    return tmp_path


@dataclass
class Done:
    """What a command ended with."""

    returncode: object
    stdout: str
    stderr: str


def run(folder: Path, *arguments: str) -> Done:
    """The command line as a user types it in `folder`, run in this process; results in `folder`/out."""
    out, err = StringIO(), StringIO()
    with chdir(folder), redirect_stdout(out), redirect_stderr(err), pytest.raises(SystemExit) as end:
        console.invoke(command_line, [*arguments, "--out", "out"])
    return Done(end.value.code, out.getvalue(), err.getvalue())


def beside_flc(name: str) -> list[str]:
    """Arguments of a short run of flc and the controller called `name`."""
    chosen = ["--scenario", "rect", "--plant", "kinematic", "--controller", "flc", "--controller", name]
    return [*chosen, *SHORT, "--no-record", "--no-figures"]


def error_line(capsys: pytest.CaptureFixture[str], code: int, folder: Path, name: str) -> str:
    """What the command line, run in this process, says of a wrong controller: one line on stderr, and `code`."""
    with pytest.raises(SystemExit) as end:
        console.invoke(command_line, [*beside_flc(f"{folder / name}"), "--out", str(folder / "out"), "--quiet"])
    stdout, stderr = capsys.readouterr()
    assert (end.value.code, stdout) == (code, "")
    assert stderr.startswith("error: ")
    assert stderr.count("\n") == 1
    return stderr


def add(folder: Path, body: str) -> None:
    """Add a class Wrong to the user's file: a MyTracker with other code in it."""
    with (folder / "mine.py").open("a") as file:
        file.write(f"\n\nclass Wrong(MyTracker):\n{body}\n")


# --- it runs like any other ---


def test_a_users_tracker_runs_beside_the_others(user: Path) -> None:
    """Table, Parquet, summary and recording name it after its class; what it sent is what its own law says."""
    done = run(
        user, "--scenario", "rect", "--plant", "kinematic", "--seeds", "2",
        "--controller", "flc", "--controller", "mine.py:MyTracker", *SHORT, "--no-figures",
    )  # fmt: skip
    assert (done.returncode, done.stderr) == (0, "")
    assert "MyTracker" in done.stdout
    summary = json.loads((user / "out" / "summary.json").read_text())
    assert summary["controllers"] == list(summary["results"]) == ["flc", "MyTracker"]
    chunks = RrdReader(user / "out" / "recording.rrd").stream().to_chunks()
    assert "/world/MyTracker/robot" in {chunk.entity_path for chunk in chunks}

    table = pq.read_table(user / "out" / "trajectory.parquet")
    label = table["controller"].cast(pa.string())
    assert label.unique().to_pylist() == ["flc", "MyTracker"]
    own = table.filter(pa.compute.equal(label, "MyTracker"))
    for seed in (0, 1):
        rows = own.filter(pa.compute.equal(own["seed"], seed)).sort_by("frame")
        for axis, rate in (("x_m", "vx_m_s"), ("y_m", "vy_m_s"), ("heading_rad", "w_rad_s")):
            ref, seen = rows[f"ref_{axis}"].to_numpy(), rows[f"predicted_{axis}"].to_numpy()
            velocity = np.append(np.diff(ref) / FRAME_S, 0.0)
            # Rounding of numbers of size 1; the loop's limits are far away.
            expected = velocity + GAIN * (ref - seen)
            np.testing.assert_allclose(rows[f"command_{rate}"].to_numpy(), expected, rtol=0, atol=1e-12)


def test_the_effective_scenario_repeats_a_users_controller_bit_for_bit(user: Path) -> None:
    assert run(user, *beside_flc("mine.py:MyTracker")).returncode == 0
    text = (user / "out" / "scenario.toml").read_text()
    assert 'controllers = ["flc", "mine.py:MyTracker"]' in text
    (user / "out").rename(user / "first")
    assert run(user, "--scenario", "first/scenario.toml", "--no-record", "--no-figures").returncode == 0
    assert (user / "out" / "scenario.toml").read_text() == text
    first, second = (pq.read_table(user / name / "trajectory.parquet") for name in ("first", "out"))
    assert first.num_rows > 0
    # Compared as bytes, since what is not a number is not equal to itself.
    assert [c.combine_chunks().buffers()[-1] for c in first.columns[1:]] == [
        c.combine_chunks().buffers()[-1] for c in second.columns[1:]
    ]


def test_every_mistake_is_a_line_on_the_terminal_and_leaves_no_folder(
    user: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    wrong = [*beside_flc(f"{user / 'mine.py'}:MyTraker"), "--set", "radio.delay_frames=-1"]
    with pytest.raises(SystemExit) as end:
        console.invoke(command_line, [*wrong, "--out", str(user / "out")])
    stdout, stderr = capsys.readouterr()
    assert (end.value.code, stdout) == (console.BAD_INPUT, "")
    assert [line.split(" ")[:2] for line in stderr.splitlines()] == [
        ["error:", str(user / "mine.py")],
        ["error:", "radio.delay_frames"],
    ]
    assert not (user / "out").exists()


# --- a controller that fails while it runs ---

NINTH = "    def command(self, frame, observed, sent):\n        if frame == 9:\n            {}\n        "
THEN = "return super().command(frame, observed, sent)"
FAILS = {
    "exception": ("raise ValueError('no way')", ["ValueError: no way", "mine.py, line"]),
    "exception in a library": ("np.linalg.inv(np.zeros((2, 2)))", ["LinAlgError", "mine.py, line"]),
    "wrong shape": ("return np.zeros((1, 2))", ["(1, 2)", "(1, 3)"]),
    "nothing": ("return None", ["(1, 3)"]),
    "not numbers": ("return [['fast', 'left', 0]]", ["could not convert", "'fast'"]),
    "NaN": ("return observed.pose * np.nan", ["not finite"]),
    "infinite": ("return observed.pose + np.inf", ["not finite"]),
    "wrong record": ("self.alpha_hat = np.ones((1, 2))", ["alpha_hat", "(1, 2)", "(1, 3)"]),
}


@pytest.mark.parametrize("mistake", FAILS)
def test_a_controller_that_fails_is_one_line_and_keeps_what_was_recorded(
    user: Path, capsys: pytest.CaptureFixture[str], mistake: str
) -> None:
    body, says = FAILS[mistake]
    add(user, NINTH.format(body) + THEN)
    line = error_line(capsys, console.FAILED, user, "mine.py:Wrong")
    for words in ("Wrong", "frame 9", f"what was recorded until then is in {user / 'out'}", *says):
        assert words in line
    summary = json.loads((user / "out" / "summary.json").read_text())
    assert not summary["complete"]
    assert "frame 9" in summary["stopped"]
    assert summary["frames"] == 9
    assert pq.read_table(user / "out" / "trajectory.parquet").num_rows == 2 * 9


def test_a_controller_that_fails_at_once_leaves_its_scenario_and_the_reason(user: Path) -> None:
    """Nothing was recorded, and no output trips over that."""
    add(user, "    def command(self, frame, observed, sent):\n        return self.missing")
    done = run(user, "--scenario", "rect", "--plant", "kinematic", "--controller", "mine.py:Wrong")
    assert done.returncode == 1
    assert done.stderr.count("\n") == 1
    assert "frame 0" in done.stderr
    assert "missing" in json.loads((user / "out" / "summary.json").read_text())["stopped"]
    assert (user / "out" / "scenario.toml").exists()


@pytest.mark.parametrize("body", ["return", "super().__init__(settings, reference, n, 3)", "raise KeyError('gain')"])
def test_a_controller_that_cannot_be_made_is_one_line(
    user: Path, capsys: pytest.CaptureFixture[str], body: str
) -> None:
    """It raises, or forgets to call its base class."""
    add(user, f"    def __init__(self, settings, reference, n):\n        {body}")
    assert "Wrong" in error_line(capsys, console.FAILED, user, "mine.py:Wrong")
