"""`omni-mj compare` on the command line: files, printed tables, failures and signals."""

import signal
from pathlib import Path

import pyarrow.parquet as pq
import pytest
from commands import invoke, signalled, strict
from matplotlib.image import imread

SEEDS, FIRST = 3, 7
CONTROLLERS = ("flc", "comp-flc")
FILES = {
    "summary.json",
    "compare.md",
    "compare.png",
    "compare.svg",
    "provenance.json",
    "sources",
    "scenarios",
}
SCENARIOS = {
    "there": '[reference]\nwaypoints = [[0, 0], [0.2, 0.1]]\nsettle_s = 0.5\n',
    "bend": "[reference]\nwaypoints = [[0, 0], [0.15, 0], [0.15, 0.15]]\n\n"
    "[radio]\ndelay_frames = 4\n",
    "late": "[reference]\nwaypoints = [[0, 0], [0.1, 0]]\n\n[radio]\ndelay_frames = 9\n",
}  # fmt: skip
OWN = """
import omni_mj as om


class Cheat(om.Controller):
    knows_truth = True

    def command(self, frame, observation):
        if self.model.delay_frames == 9:
            raise RuntimeError("no such delay")
        target, feedforward = self.reference.at(frame, observation.pose)
        return feedforward + 4 * (target - observation.pose)
"""


@pytest.fixture
def options(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    """Write scenarios and a controller; return the options of a comparison of them."""
    monkeypatch.chdir(tmp_path)
    for name, text in SCENARIOS.items():
        Path(f"{name}.toml").write_text(text)
    Path("own.py").write_text(OWN)
    controllers = "--controller flc --controller comp-flc --controller own.py:Cheat"
    return f"{controllers} --plant kinematic --seeds {SEEDS} --seed {FIRST} --subject comp-flc"


def test_a_comparison_repeats_and_a_failed_row_is_one_line(
    options: str, capsys: pytest.CaptureFixture[str]
) -> None:
    words = " ".join([f"compare {options}", *(f"--scenario {name}.toml" for name in SCENARIOS)])
    assert invoke(words, "--out first") == 1
    printed, errors = capsys.readouterr()
    assert errors.count("\n") == SEEDS
    assert "Cheat failed in frame 0 (own.py, line 10)" in errors.splitlines()[0]
    assert {path.name for path in Path("first").iterdir()} == FILES
    result = strict(Path("first/summary.json"))
    assert [entry["status"] for entry in result["scenarios"].values()] == ["done"] * 3
    assert "no such delay" in result["scenarios"]["late"]["failures"][0]["cause"]
    assert (result["controllers"], result["privileged"]) == ([*CONTROLLERS, "Cheat"], ["Cheat"])
    assert result["seeds"] == list(range(FIRST, FIRST + SEEDS))
    for text in ("there", "bend", "Cheat (privileged)", "Verdicts on comp-flc"):
        assert text in printed
        assert text in Path("first/compare.md").read_text()
    assert imread("first/compare.png").std() > 0.05

    assert invoke(words, "--quiet --trajectories --out second") == 1
    assert capsys.readouterr() == ("", errors)
    again = strict(Path("second/summary.json"))
    for summary in (result, again):
        for entry in (summary, *summary["scenarios"].values()):
            assert entry.pop("wall_s") > 0
        assert summary.pop("created")
        assert summary.pop("repeat_command")
    assert result == again
    assert Path("first/compare.svg").read_bytes() == Path("second/compare.svg").read_bytes()
    for name, entry in result["scenarios"].items():
        n_rows = SEEDS * (2 if name == "late" else 3)
        assert (
            pq.read_table(f"second/trajectories/{name}.parquet").num_rows
            == n_rows * entry["frames"]
        )


def test_a_signal_keeps_the_finished_scenarios(
    options: str, capsys: pytest.CaptureFixture[str]
) -> None:
    Path("endless.toml").write_text(
        "[reference]\nwaypoints = [[0, 0], [1, 0], [0, 0]]\nlaps = 1000\n"
    )
    with signalled(signal.SIGTERM, Path("out/compare.md")):  # after the first scenario
        scenarios = "--scenario there.toml --scenario endless.toml"
        code = invoke("compare", options, scenarios, "--out out")
    assert code == 143
    assert "1 of 2 scenarios in out" in capsys.readouterr().err.splitlines()[-1]
    result = strict(Path("out/summary.json"))
    assert (result["complete"], result["stopped"]) == (False, "terminated")
    assert [entry["status"] for entry in result["scenarios"].values()] == ["done", "not run"]
