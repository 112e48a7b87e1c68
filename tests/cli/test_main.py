"""`omni-mj` itself: its commands, what it lists, and what it does not import to say so."""

import json
import subprocess
import sys
from pathlib import Path

import pytest
from commands import invoke, strict
from omni_mj.scenarios.nested import plain

import omni_mj as om
from omni_mj.cli import folders
from omni_mj.cli.main import COMMANDS
from omni_mj.scenarios import robots
from omni_mj.scenarios.settings import every_setting
from omni_mj.show import listing
from omni_mj.studies import alpha, conditions
from omni_mj.studies.slip import checks, study
from omni_mj.studies.slip.moves import straight

HEAVY = ("mujoco", "scipy", "pyarrow", "rerun", "matplotlib", "jinja2", "numpy", "pydantic")
FAST = ("--set", "wheels.model=two-rollers", "--set", "physics.kernel=numpy")
SMALL = {"charge": (0.15, 1.0), "speed_m_s": (1.0,)}


def test_help_version_list_and_schema_import_nothing_heavy() -> None:
    """Which is what they may take 0.4 s of CPU for; each in a process that has imported nothing yet."""
    code = (
        "import sys\nfrom omni_mj.cli import main\n"
        f"try: main.main()\nfinally: print('heavy:', *[m for m in {HEAVY} if m in sys.modules])"
    )
    light = ("--help", "--version", "--list", "list")  # which read files alone
    for words in ("--help", "--version", "--list", "list", "schema", "run --help", "compare --help"):
        command = [sys.executable, "-c", code, *words.split()]
        done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
        assert (done.returncode, done.stderr) == (0, ""), words
        found = done.stdout.splitlines()[-1].split()
        assert found == ["heavy:"] or (words not in light and set(found) <= {"heavy:", "numpy", "pydantic"}), words


def test_what_is_listed_of_settings_is_what_is_declared_of_them() -> None:
    """The list reads a file, which is written from the declarations."""
    declared = [[s.full, listing.short(plain(s.default)), s.unit, s.allowed, s.doc] for s in every_setting()]
    assert listing.settings() == declared


def test_help_names_every_command_and_version_is_that_of_the_package(capsys: pytest.CaptureFixture[str]) -> None:
    assert invoke("--help") == 0
    out = capsys.readouterr().out
    assert invoke() == 0
    assert capsys.readouterr().out == out
    assert all(f"\n  {name} " in out for name in COMMANDS)
    assert invoke("--version") == 0
    assert capsys.readouterr().out == f"omni-mj {om.__version__}\n"
    assert invoke("comapre") == 2
    assert "there is no command 'comapre'; did you mean 'compare'?" in capsys.readouterr().err


def test_list_names_what_there_is_however_it_is_asked(capsys: pytest.CaptureFixture[str]) -> None:
    printed = set()
    for words in (["--list"], ["list"], ["run", "--list"]):
        assert invoke(*words) == 0
        printed.add(capsys.readouterr().out)
    (listed,) = printed
    for name in ("rect-noise", "comp-flc", "kinematic", "tigers-v2016", "radio.delay_frames", "V s/rad", "0.826"):
        assert name in listed
    assert max(map(len, listed.splitlines())) <= 140


def test_schema_is_json(capsys: pytest.CaptureFixture[str]) -> None:
    assert invoke("schema") == 0
    schema = json.loads(capsys.readouterr().out)
    assert schema["properties"]["radio"]["properties"]["delay_frames"]["maximum"] == 600


def test_the_alpha_study_is_a_command(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """With fewer conditions than a user gets, on the faster wheels."""
    assert invoke("alpha", "--set", "radio.delay=1") == 2
    assert "did you mean 'radio.delay_frames'" in capsys.readouterr().err
    monkeypatch.setattr(alpha, "CONDITIONS", SMALL)
    monkeypatch.setattr(alpha, "TASKS", ())
    monkeypatch.delitem(conditions.CAUSES, "heat")
    monkeypatch.delitem(conditions.CAUSES, "battery")
    assert invoke("alpha", "--robot", "nobody") == 2
    assert "unknown robot 'nobody'" in capsys.readouterr().err
    assert invoke("alpha", "--robot", "tigers-v2016", *FAST, "--out", tmp_path) == 0
    assert "share of creep" in capsys.readouterr().out
    assert {p.name for p in tmp_path.iterdir()} == {"summary.json", "scenario.toml", "alpha.png", *folders.PROVENANCE}
    summary = strict(tmp_path / "summary.json")
    assert summary["alpha"]["changed"]["charge"]["values"] == [0.15, 1.0]
    assert (tmp_path / "alpha.png").stat().st_size > 10_000


def test_the_slip_study_is_a_command(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """With fewer moves than a user gets, and a robot of the user's own, with which nothing published is compared."""
    for words, says in (
        (("--robot", "tigers"), "unknown robot 'tigers'"),
        (("--set", "radio.delay=1"), "did you mean 'radio.delay_frames'"),
        (("--set", "wheels.creep=off"), "wheels.creep = off needs wheels.model = rollers"),
    ):
        assert invoke("slip", *words, "--out", tmp_path / "bad") == 2
        assert says in capsys.readouterr().err
    moves = [straight("forward", 1.5, rolls_out=out) for out in (False, True)]
    monkeypatch.setattr(study, "identification", lambda: moves)
    monkeypatch.setattr(checks, "MOVES", checks.MOVES[4:6])
    own = tmp_path / "own.toml"
    own.write_text(robots.robot_path("tigers-v2016").read_text())
    out = tmp_path / "out"
    assert invoke("slip", "--robot", "tigers-v2016", "--robot", own, *FAST, "--out", out) == 0
    printed = capsys.readouterr().out
    assert "TIGERs Mannheim, Firmware" in printed
    assert "own; nothing published" in printed
    assert "0.75 m/s²" in printed
    assert {p.name for p in out.iterdir()} == {"summary.json", "scenarios", "slip.png", *folders.PROVENANCE}
    found = strict(out / "summary.json")["slip"]["robots"]
    ours, theirs = (found[name]["quantities"]["gain_forward"] for name in ("own", "tigers-v2016"))
    assert ours["measured"] == theirs["measured"]
    assert (ours["published"], theirs["published"]) == (None, 0.9)
    assert (out / "slip.png").stat().st_size > 10_000


@pytest.mark.parametrize(
    ("streams", "code", "out", "err"),
    [
        ("| head -1", 0, "scenarios", ""),
        (">&-", 0, "", ""),
        (">&- 2>&- <&-", 0, "", ""),
        ("> /dev/full", 1, "", "error: standard output: No space left on device\n"),
    ],
)
def test_output_that_goes_nowhere_is_no_fault_and_one_that_is_lost_is_said(
    streams: str, code: int, out: str, err: str
) -> None:
    """A reader that goes, streams that are closed, and a device that is full."""
    command = f"set -o pipefail; {sys.executable} -m omni_mj --list {streams}"
    done = subprocess.run(["bash", "-c", command], capture_output=True, text=True, timeout=60)
    assert (done.returncode, done.stderr) == (code, err)
    assert done.stdout.startswith(out)
