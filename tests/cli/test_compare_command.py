"""`omni-mj compare` as a user types it: its files, what it prints, what ends it."""

import signal
import subprocess
import sys
from pathlib import Path

import pyarrow.parquet as pq
import pytest
from commands import appears, invoke, signalled, strict
from matplotlib.image import imread

COMPARE = [sys.executable, "-m", "omni_mj", "compare"]
SEEDS, FIRST = 3, 7
CONTROLLERS = ("flc", "comp-flc")
FILES = {"summary.json", "compare.md", "compare.png", "compare.svg", "provenance.json", "sources"}
SCENARIOS = {
    "there": '[reference]\nwaypoints = [[0, 0], [0.2, 0.1]]\nsettle_s = 0.5\n',
    "bend": '[reference]\nwaypoints = [[0, 0], [0.15, 0], [0.15, 0.15]]\n\n[radio]\ndelay_frames = 4\n',
}  # fmt: skip
OWN = """
import omni_mj as om


class Cheat(om.Controller):
    knows_truth = True

    def command(self, frame, seen):
        if self.told.delay_frames == 9:
            raise RuntimeError("no such delay")
        target, feed_forward = self.reference.at(frame, seen.pose)
        return feed_forward + 4 * (target - seen.pose)
"""


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
    given += [("--plant", "kinematic"), ("--seeds", str(SEEDS)), ("--seed", str(FIRST)), ("--subject", "comp-flc")]
    return [word for pair in given for word in pair]


@pytest.fixture(scope="module")
def done(options: list[str], tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str]:
    """A comparison's folder, and what it printed."""
    folder = tmp_path_factory.mktemp("compared")
    command = [*COMPARE, *options, "--out", str(folder)]
    process = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
    assert (process.returncode, process.stderr) == (0, "")
    return folder, process.stdout


@pytest.fixture
def undrawn(monkeypatch: pytest.MonkeyPatch) -> None:
    """No figure, which takes longer than the comparison."""
    monkeypatch.setattr("omni_mj.show.figures.save_comparison", lambda *_: None)


def test_it_leaves_a_summary_markdown_and_a_figure_and_prints_the_table(done: tuple[Path, str]) -> None:
    folder, printed = done
    assert {p.name for p in folder.iterdir()} == FILES | {"scenarios"}
    result = strict(folder / "summary.json")
    assert result["complete"]
    assert [entry["status"] for entry in result["scenarios"].values()] == ["done", "done"]
    assert (result["controllers"], result["informed"]) == ([*CONTROLLERS, "Cheat"], ["Cheat"])
    assert result["seeds"] == list(range(FIRST, FIRST + SEEDS))
    markdown = (folder / "compare.md").read_text()
    for text in ("there", "bend", "Cheat (informed)", "Verdicts on comp-flc"):
        assert text in printed
        assert text in markdown
    assert f"results in {folder}/ (summary.json, " in printed
    assert imread(folder / "compare.png").std() > 0.05
    assert "<svg" in (folder / "compare.svg").read_text()


def test_the_same_command_gives_the_same_numbers_and_figure_and_keeps_frames_when_asked(
    options: list[str], done: tuple[Path, str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert invoke("compare", *options, "--quiet", "--trajectories", "--out", tmp_path) == 0
    assert capsys.readouterr() == ("", "")
    first, second = (strict(folder / "summary.json") for folder in (done[0], tmp_path))
    for result in (first, second):
        for entry in (result, *result["scenarios"].values()):
            assert entry.pop("wall_s") > 0
        assert result.pop("created")
    assert first == second
    for name in ("compare.png", "compare.svg"):
        assert (done[0] / name).read_bytes() == (tmp_path / name).read_bytes()
    for name, entry in first["scenarios"].items():
        table = pq.read_table(tmp_path / "trajectories" / f"{name}.parquet")
        assert table.num_rows == SEEDS * 3 * entry["frames"]
        assert (tmp_path / "scenarios" / f"{name}.toml").exists()


def test_one_seed_has_no_interval_and_says_so(
    files: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], undrawn: None
) -> None:
    one = ("--scenario", files / "there.toml", "--plant", "kinematic", "--seeds", 1, "--out", tmp_path)
    assert invoke("compare", *one, "--set", "radio.delay_frames=2", "--subject", "lqr") == 0
    assert "seed 0" in capsys.readouterr().out
    result = strict(tmp_path / "summary.json")
    assert result["repeat"].endswith("--set radio.delay_frames=2 --half-width 0.05 --subject lqr")
    assert {*CONTROLLERS, "lqr", "smith"} < set(result["controllers"]), "all that there are"
    entry = result["scenarios"]["there"]
    assert entry["settings"]["radio"]["delay_frames"] == 2
    assert entry["results"]["flc"]["effort_m_s2"]["plus_minus"] is None
    pairs = entry["verdict"]["errors"]["max"]["against"]
    assert {pair["beyond_chance"] for pair in pairs.values()} == {None}


def test_rows_that_fail_are_noted_and_the_others_go_on(
    options: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str], undrawn: None
) -> None:
    (tmp_path / "late.toml").write_text("[radio]\ndelay_frames = 9\n")
    assert invoke("compare", "--scenario", tmp_path / "late.toml", *options, "--out", tmp_path / "out") == 1
    errors = capsys.readouterr().err.splitlines()
    assert len(errors) == SEEDS
    assert errors[0].startswith(f"error: late: Cheat, seed {FIRST}: Cheat failed in frame 0 (own.py, line 10)")
    result = strict(tmp_path / "out" / "summary.json")
    assert [entry["status"] for entry in result["scenarios"].values()] == ["done"] * 3
    assert "no such delay" in result["scenarios"]["late"]["failed"][0]["cause"]
    assert f"- late: Cheat, seed {FIRST}: Cheat failed" in (tmp_path / "out" / "compare.md").read_text()


def test_a_signal_leaves_what_was_done(
    files: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], undrawn: None
) -> None:
    """One in a process of its own, as in a terminal, the other in this one, where nothing is drawn."""
    (tmp_path / "endless.toml").write_text("[reference]\nwaypoints = [[0, 0], [1, 0], [0, 0]]\nlaps = 1000\n")
    given = ["--scenario", str(files / "there.toml"), "--scenario", str(tmp_path / "endless.toml")]
    given += ["--plant", "kinematic", *(word for name in CONTROLLERS for word in ("--controller", name))]
    given += ["--seeds", "2", "--out"]

    def left(reason: str, code: int, number: int, stderr: str, files: set[str]) -> None:
        out = tmp_path / reason
        assert code == 128 + number, stderr
        assert stderr.splitlines()[-1] == f"error: {reason}; 1 of 2 scenarios are in {out}"
        result = strict(out / "summary.json")
        assert (result["complete"], result["stopped"]) == (False, reason)
        assert [entry["status"] for entry in result["scenarios"].values()] == ["done", "not run"]
        assert f"- endless: not run: {reason}" in (out / "compare.md").read_text()
        assert {p.name for p in out.iterdir()} == files | {"scenarios"}

    process = subprocess.Popen(
        [*COMPARE, *given, str(tmp_path / "interrupted")],
        stderr=subprocess.PIPE,
        stdout=subprocess.DEVNULL,
        text=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),  # a background job ignores it
    )
    assert appears(tmp_path / "interrupted" / "compare.md")  # after the first scenario
    process.send_signal(signal.SIGINT)
    _, stderr = process.communicate(timeout=60)
    left("interrupted", process.returncode, signal.SIGINT, stderr, FILES)

    with signalled(signal.SIGTERM, tmp_path / "terminated" / "compare.md"):
        code = invoke("compare", *given, tmp_path / "terminated")
    left("terminated", code, signal.SIGTERM, capsys.readouterr().err, FILES - {"compare.png", "compare.svg"})


def test_bad_input_is_a_line_that_says_what_is_allowed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for arguments, says in (
        ("--scenario rekt", "did you mean 'rect'"),
        ("--scenario rect --scenario rect", "two scenarios are called 'rect'"),
        ("--controller comp-fcl", "did you mean 'comp-flc'"),
        ("--subject comp-fcl", "did you mean 'comp-flc'"),
        ("--controller flc --controller flc", "named twice"),
        ("--plant mujocco", "did you mean 'mujoco'"),
        ("--seeds 0", "1 to 100000"),
        ("--half-width -1", "a share of the mean such as 0.05"),
        ("--half-width few", "not a valid float"),
        ("--limits nowhere", "holds no run"),
        ("--seed -1", "from 0 to"),
        ("--set radio.delay=3", "did you mean 'radio.delay_frames'"),
        ("--sead 3", "--seed"),
    ):
        assert invoke("compare", *arguments.split(), "--out", tmp_path / "out") == 2
        printed = capsys.readouterr()
        assert printed.out == ""
        assert printed.err.count("\n") == 1, printed.err
        assert says in printed.err
        assert not (tmp_path / "out").exists(), "bad input must not leave a folder"
