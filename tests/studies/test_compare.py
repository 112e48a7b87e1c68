"""`omni-mj compare` as a user types it: its files, their numbers, what ends it."""

import json
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import click
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import scipy.stats
from matplotlib.image import imread

from omni_mj.cli import console
from omni_mj.cli.main import cli
from omni_mj.cli.run import run
from omni_mj.scenarios import scenario

COMPARE = [sys.executable, "-m", "omni_mj.compare"]
SEEDS, FIRST = 3, 7
CONTROLLERS = ("flc", "comp-flc", "adaptive-comp-flc")
SCENARIOS = {
    "there": '[reference]\nwaypoints = [[0, 0], [0.2, 0.1]]\nsettle_s = 0.5\n',
    "bend": '[reference]\nwaypoints = [[0, 0], [0.15, 0], [0.15, 0.15]]\n\n[radio]\ndelay_frames = 4\n',
}  # fmt: skip
OWN = """
from omni_control.controllers.base import Controller


class Cheat(Controller):
    knows_truth = True

    def command(self, frame, observed, sent):
        if self.settings.delay_frames == 9:
            raise RuntimeError("no such delay")
        target, feed_forward = self.reference.at(frame, observed.pose)
        return feed_forward + 4 * (target - observed.pose)
"""


def invoke(command: click.Command, *args: object) -> int:
    """The exit code of a command in this process, which is quicker than one of its own."""
    with pytest.raises(SystemExit) as end:
        console.invoke(command, list(map(str, args)))
    assert isinstance(end.value.code, int)
    return end.value.code


def strict(path: Path) -> Any:
    """JSON without NaN and its like."""
    return json.loads(path.read_text(), parse_constant=lambda name: pytest.fail(f"{name} in {path}"))


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The scenarios, and a user's controller that is given the truth."""
    folder = tmp_path_factory.mktemp("given")
    for name, text in SCENARIOS.items():
        (folder / f"{name}.toml").write_text(text)
    (folder / "own.py").write_text(OWN)
    return folder


@pytest.fixture(scope="module")
def options(files: Path) -> list[str]:
    given = [("--scenario", str(files / f"{name}.toml")) for name in SCENARIOS]
    given += [("--controller", name) for name in (*CONTROLLERS, f"{files / 'own.py'}:Cheat")]
    given += [("--plant", "kinematic"), ("--seeds", str(SEEDS)), ("--seed", str(FIRST))]
    return [word for pair in given for word in pair]


@pytest.fixture(scope="module")
def done(options: list[str], tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str]:
    """A comparison's folder, and what it printed."""
    folder = tmp_path_factory.mktemp("compared")
    command = [*COMPARE, *options, "--out", str(folder)]
    process = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
    assert (process.returncode, process.stderr) == (0, "")
    return folder, process.stdout


def test_it_leaves_json_markdown_and_a_figure_and_prints_the_table(done: tuple[Path, str]) -> None:
    folder, printed = done
    assert {p.name for p in folder.iterdir()} == {"compare.json", "compare.md", "compare.png", "compare.svg"}
    result = strict(folder / "compare.json")
    assert result["complete"]
    assert [entry["status"] for entry in result["scenarios"].values()] == ["done", "done"]
    assert (result["controllers"], result["limits"]) == ([*CONTROLLERS, "Cheat"], ["Cheat"])
    markdown = (folder / "compare.md").read_text()
    for text in ("there", "bend", "Cheat (limit)", "Verdicts on adaptive-comp-flc"):
        assert text in printed
        assert text in markdown
    assert str(folder / "compare.json") in printed
    image = imread(folder / "compare.png")
    assert image.std() > 0.05
    assert "<svg" in (folder / "compare.svg").read_text()


@pytest.mark.parametrize("name", SCENARIOS)
def test_every_number_can_be_recomputed_from_a_run(
    name: str, files: Path, options: list[str], done: tuple[Path, str], tmp_path: Path
) -> None:
    """The trajectories of `omni_mj.run` with the same options give each seed's numbers and, with scipy, the intervals.

    Sums over frames may be made in another order: 1e-12 is allowed.
    """
    same = ("--scenario", files / f"{name}.toml", *options[options.index("--controller") :])
    assert invoke(run, *same, "--quiet", "--no-record", "--no-figures", "--out", tmp_path) == 0
    table = pq.read_table(tmp_path / "trajectory.parquet")
    results = strict(done[0] / "compare.json")["scenarios"][name]["results"]
    assert list(results) == [*CONTROLLERS, "Cheat"]
    for controller, result in results.items():
        numbers = [of_a_seed(rows(table, controller, seed)) for seed in range(FIRST, FIRST + SEEDS)]
        for key in numbers[0]:
            spread = result
            for part in key.split("."):
                spread = spread[part]
            values = [each[key] for each in numbers]
            assert spread["seeds"] == pytest.approx(values, abs=1e-12), key
            assert spread["mean"] == pytest.approx(sum(values) / SEEDS, abs=1e-12)
            half = scipy.stats.t.ppf(0.975, SEEDS - 1) * np.std(values, ddof=1) / SEEDS**0.5
            assert spread["plus_minus"] == pytest.approx(half, abs=1e-9)


def rows(table: pa.Table, controller: str, seed: int) -> dict[str, np.ndarray]:
    chosen = table.filter(
        pa.compute.and_(
            pa.compute.equal(table["controller"].cast(pa.string()), controller), pa.compute.equal(table["seed"], seed)
        )
    ).sort_by("frame")
    return {column: chosen[column].to_numpy() for column in chosen.column_names if column != "controller"}


def of_a_seed(row: dict[str, np.ndarray]) -> dict[str, float]:
    """The statistics, straight from their definitions; these runs all settle."""
    ex, ey = abs(row["x_m"] - row["ref_x_m"]), abs(row["y_m"] - row["ref_y_m"])
    errors = {"position": (ex**2 + ey**2) ** 0.5, "x": ex, "y": ey}
    ax, ay = (np.diff(row[f"command_v{axis}_m_s"], prepend=0) * 60 for axis in "xy")
    at_rest = (row["ref_x_m"] == row["ref_x_m"][-1]) & (row["ref_y_m"] == row["ref_y_m"][-1])
    settled = [k for k in np.flatnonzero(at_rest) if (errors["position"][k:] < 0.01).all()]
    return {
        **{f"error_m.{name}.max": error.max() for name, error in errors.items()},
        **{f"error_m.{name}.mean": error.sum() / len(error) for name, error in errors.items()},
        "effort_m_s2": float(np.mean(ax**2 + ay**2)) ** 0.5,
        "settle_s": (settled[0] - np.flatnonzero(at_rest)[0]) / 60,
        "greatest_at_s": row["time_s"][errors["position"].argmax()],
    }


def test_the_same_command_gives_the_same_numbers_and_figure(
    options: list[str], done: tuple[Path, str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert invoke(cli, "compare", *options, "--quiet", "--out", tmp_path) == 0
    assert capsys.readouterr() == ("", "")
    first, second = (strict(folder / "compare.json") for folder in (done[0], tmp_path))
    for result in (first, second):
        for entry in (result, *result["scenarios"].values()):
            assert entry.pop("wall_s") > 0
        assert result.pop("created")
    assert first == second
    for name in ("compare.png", "compare.svg"):
        assert (done[0] / name).read_bytes() == (tmp_path / name).read_bytes()


def test_one_seed_has_no_interval_and_says_so(files: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    one = ("--scenario", files / "there.toml", "--plant", "kinematic", "--seeds", 1, "--out", tmp_path)
    assert invoke(cli, "compare", *one, "--set", "radio.delay_frames=2") == 0
    assert "seed 0, no intervals" in capsys.readouterr().out
    result = strict(tmp_path / "compare.json")
    assert result["overrides"] == ["radio.delay_frames=2"]
    assert result["controllers"] == list(CONTROLLERS), "all of them"
    entry = result["scenarios"]["there"]
    assert entry["settings"]["radio"]["delay_frames"] == 2
    assert entry["results"]["flc"]["effort_m_s2"]["plus_minus"] is None
    pairs = entry["verdict"]["errors"]["max"]["against"]
    assert {pair["beyond_chance"] for pair in pairs.values()} == {None}


def test_a_scenario_that_fails_is_noted_and_the_others_go_on(
    options: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "late.toml").write_text("[radio]\ndelay_frames = 9\n")
    assert invoke(cli, "compare", "--scenario", tmp_path / "late.toml", *options, "--out", tmp_path / "out") == 1
    error = capsys.readouterr().err
    assert error.startswith("error: 1 of 3 scenarios failed; late: Cheat failed in frame 0")
    assert error.count("\n") == 1
    result = strict(tmp_path / "out" / "compare.json")
    assert [entry["status"] for entry in result["scenarios"].values()] == ["failed", "done", "done"]
    assert "no such delay" in result["scenarios"]["late"]["reason"]
    assert "- late: failed: Cheat failed" in (tmp_path / "out" / "compare.md").read_text()
    assert (tmp_path / "out" / "compare.png").exists()


@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_a_signal_leaves_what_was_done(number: int, code: int, files: Path, tmp_path: Path) -> None:
    (tmp_path / "endless.toml").write_text("[reference]\nlaps = 1000\n")
    out = tmp_path / "out"
    given = ("--scenario", files / "there.toml", "--scenario", tmp_path / "endless.toml", "--out", out)
    process = subprocess.Popen(
        [*COMPARE, *map(str, given), "--plant", "kinematic", "--seeds", "2"],
        stderr=subprocess.PIPE,
        stdout=subprocess.DEVNULL,
        text=True,
        preexec_fn=lambda: signal.signal(number, signal.SIG_DFL),  # a background job's children ignore SIGINT
    )
    deadline = time.monotonic() + 60
    while not (out / "compare.json").exists() or '"done"' not in (out / "compare.json").read_text():
        assert time.monotonic() < deadline
        time.sleep(0.05)
    process.send_signal(number)
    _, stderr = process.communicate(timeout=60)
    assert process.returncode == code, stderr
    reason = "interrupted" if number == signal.SIGINT else "terminated"
    assert stderr.splitlines()[-1] == f"error: {reason}; 1 of 2 scenarios are in {out}"
    result = strict(out / "compare.json")
    assert (result["complete"], result["stopped"]) == (False, reason)
    assert [entry["status"] for entry in result["scenarios"].values()] == ["done", "not run"]
    assert f"- endless: not run: {reason}" in (out / "compare.md").read_text()
    assert {p.name for p in out.iterdir()} == {"compare.json", "compare.md", "compare.png", "compare.svg"}


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["--scenario", "rekt"], "did you mean 'rect'"),
        (["--scenario", "rect", "--scenario", "rect"], "two scenarios are called 'rect'"),
        (["--controller", "comp-fcl"], "did you mean 'comp-flc'"),
        (["--controller", "flc", "--controller", "flc"], "named twice"),
        (["--plant", "mujocco"], "did you mean 'mujoco'"),
        (["--seeds", "0"], "1 to 100000"),
        (["--seed", "-1"], "from 0"),
        (["--set", "radio.delay=3"], "did you mean 'radio.delay_frames'"),
        (["--sead", "3"], "--seed"),
    ],
)
def test_bad_input_is_one_line_that_says_what_is_allowed(
    arguments: list[str], says: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert invoke(cli, "compare", *arguments, "--out", tmp_path / "out") == 2
    printed = capsys.readouterr()
    assert printed.out == ""
    assert printed.err.count("\n") == 1
    assert says in printed.err
    assert not (tmp_path / "out").exists(), "bad input must not leave a folder"


def test_help_says_that_the_long_scenario_must_be_named(capsys: pytest.CaptureFixture[str]) -> None:
    assert invoke(cli, "compare", "--help") == 0
    assert "but for the long heat" in " ".join(capsys.readouterr().out.split())
    assert "heat" in scenario.builtin()
