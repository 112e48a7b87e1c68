"""What a newcomer meets first: commands by name, files to begin with, what is listed and shown, completion."""

import os
import re
import shlex
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
from commands import invoke, strict

import omni_mj as om
from omni_control.registry import CONTROLLERS
from omni_mj.cli import complete, picture
from omni_mj.cli.main import COMMANDS, EXAMPLES, cli
from omni_mj.robots import builtin as robots_here
from omni_mj.scenarios import robots
from omni_mj.scenarios.library import builtin as scenarios_here
from omni_mj.scenarios.scenario import load
from omni_mj.scenarios.settings import Settings, every_setting
from omni_mj.show import full
from omni_mj.show.recording import tabs

ROOT = Path(__file__).parents[2]
SHORT = ("--set", "reference.waypoints=[[0, 0, 0], [0.2, 0.1, 0.3]]", "--set", "reference.settle_s=0.1")


def test_every_file_of_a_command_is_named_and_described() -> None:
    files = {path.stem for path in (ROOT / "omni_mj" / "cli").glob("*.py") if "\ndef command(" in path.read_text()}
    assert files == set(COMMANDS)


def test_examples_are_commands_that_parse() -> None:
    """Up to their options; what they name is what there is, or what the example before writes."""
    for example in EXAMPLES:
        program, *words = shlex.split(example)
        assert program == "omni-mj"
        context = cli.make_context(program, list(words))
        command = cli.get_command(context, words[0])
        assert command is not None
        given = command.make_context(words[0], words[1:], parent=context).params
        scenarios = given.get("names") or ((given["name"],) if words[0] == "run" else ())
        assert set(scenarios) <= set(scenarios_here())
        assert set(given.get("controllers") or ()) <= {*CONTROLLERS, "mine.py:Mine"}


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["comapre"], "there is no command 'comapre'; did you mean 'compare'?"),
        (["rect"], "there is no command 'rect'; did you mean omni-mj run --scenario rect?"),
        (["run", "rect"], "unexpected extra argument (rect); see omni-mj run --help"),
        (["run", "--scenrio", "rect"], "did you mean '--scenario'?; see omni-mj run --help"),
        (["show", "tigers-v2061"], "there is nothing called 'tigers-v2061'; did you mean 'tigers-v2016'?"),
        (["show", "nowhere.toml"], "there is no file nowhere.toml"),
        (["show", "lqr", "--set", "radio.delay_frames=1"], "lqr is a controller"),
        (["list", "fricton"], "there is no 'fricton' in the lists; did you mean 'friction'?"),
        (["list", "robot", "tiger2016"], "there is no 'tiger2016' in the robots; did you mean 'tigers-v2016'?"),
        (["list", "scenarois", "rect"], "did you mean 'scenarios'?"),
        (["new", "robt", "mine"], "'robt' is not one of"),
        (["new", "robot", "2nd"], "unlike '2nd'"),
        (["new", "scenario", "no/where"], "there is no folder no"),
        (["completion", "tcsh"], "'tcsh' is not one of"),
    ],
)
def test_what_is_mistyped_is_told_in_a_line(words: list[str], says: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert invoke(*words) == 2
    out, err = capsys.readouterr()
    assert (out, err.count("\n")) == ("", 1)
    assert says.casefold() in err.casefold()


def test_a_word_finds_the_settings_that_have_it(capsys: pytest.CaptureFixture[str]) -> None:
    """Those whose name, default, unit, range or meaning it is part of; names are the first words of lines."""
    assert invoke("list", "settings", "FRICTION") == 0
    lines = capsys.readouterr().out.splitlines()
    cells = {s.full: f"{s.full} {s.unit} {s.allowed} {s.doc}" for s in every_setting()}
    wanted = [name for name, text in cells.items() if "friction" in text.casefold()]
    assert [word for line in lines[2:] if (word := line[2:].split(" ")[0])] == wanted


def test_a_kind_of_fault_is_found_with_what_it_has(capsys: pytest.CaptureFixture[str]) -> None:
    assert invoke("list", "faults", "push") == 0
    assert [line.split()[:3] for line in capsys.readouterr().out.splitlines()[2:] if line] == [
        ["kind", "=", "push"], ["force_n", "N", "0"], ["direction_deg", "0.0", "deg"]
    ]  # fmt: skip


@pytest.mark.parametrize("name", scenarios_here())
def test_a_scenario_that_is_shown_is_the_scenario(name: str, tmp_path: Path) -> None:
    """Read back it is equal; every setting in it has its meaning behind it, and no other has a note of its default."""
    text = full.text(name)
    (tmp_path / "shown.toml").write_text(text)
    assert load(str(tmp_path / "shown.toml")) == load(name)
    assert full.text(str(tmp_path / "shown.toml")) == text
    sections = [each for each in tomllib.loads(scenarios_here()[name].read_text()).values() if isinstance(each, dict)]
    sparse = {key for section in sections for key in section}
    noted = {line.split(" = ")[0] for line in text.splitlines() if re.search(r"# .*\((default |not the default)", line)}
    assert noted <= sparse


def test_a_scenario_is_shown_with_changes(capsys: pytest.CaptureFixture[str]) -> None:
    assert invoke("show", "rect", "--robot", "ssl-a-team", "--set", "radio.delay_frames=9") == 0
    out = capsys.readouterr().out
    assert 'robot = "ssl-a-team"' in out
    assert re.search(r"^delay_frames = 9 +# \(default 6\) \[frames\] ", out, re.MULTILINE)
    assert re.search(r"^mass_kg = [\d.]+ +# \[kg\] mass$", out, re.MULTILINE)


@pytest.mark.parametrize("name", robots_here())
def test_a_robot_that_is_shown_is_the_robot(name: str, tmp_path: Path) -> None:
    file = str(tmp_path / "shown.toml")
    Path(file).write_text(full.text(name))
    assert Settings(**robots.completed({}, file)) == Settings(**robots.completed({}, name))
    assert robots.description(file) == robots.description(name)
    assert full.text(file) == full.text(name)


def test_controllers_are_shown_with_their_parameters(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    for name in CONTROLLERS:
        assert full.text(name).splitlines()[0]
    assert invoke("new", "controller", "mine") == 0
    assert "--set controller.Mine.gain=4.0\n" in full.text("mine.py:Mine")


def test_the_starter_of_a_scenario_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert invoke("new", "scenario", "track.toml") == 0
    assert invoke("run", "--scenario", "track.toml", "--plant", "kinematic", "--no-figures", "--out", "out") == 0
    run = strict(tmp_path / "out" / "summary.json")["scenarios"]["track"]
    assert set(run["results"]) == {"flc", "comp-flc"}
    # What is commented out is right as well.
    text = re.sub(r"^# (?=\w+ = |\[)", "", Path("track.toml").read_text(), flags=re.MULTILINE)
    Path("all.toml").write_text(text.replace('plant = "kinematic"', "").replace(', "mine.py:Mine"', ""))
    scenario = om.scenario("all.toml")
    assert (scenario.robot, scenario.seeds, scenario.settings.reference.shape) == ("tigers-v2020", 5, "circle")
    assert [fault.kind for fault in scenario.settings.fault] == ["push"]


def test_the_starter_of_a_controller_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """By the command that it names itself, on a shorter way."""
    monkeypatch.chdir(tmp_path)
    assert invoke("new", "controller", "my_first-one") == 0
    drive = capsys.readouterr().out.partition("omni-mj ")[2].split()
    assert " ".join(drive) in Path("my_first-one.py").read_text()
    assert invoke(*drive, *SHORT, "--plant", "kinematic", "--no-figures", "--no-record", "--out", "out") == 0
    found = strict(tmp_path / "out" / "summary.json")["scenarios"]["rect"]["results"]["MyFirstOne"]
    assert 0 < found["error_m"]["distance"]["max"]["mean"] < 0.2  # m: it follows a way of 0.22 m


def test_the_starter_of_a_robot_is_the_default_robot(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """With its numbers it drives as that does; it is built, by `om.robot`."""
    monkeypatch.chdir(tmp_path)
    assert invoke("new", "robot", "mine") == 0
    assert robots.DEFAULT in Path("mine.toml").read_text()
    assert om.robot("mine.toml").settings == om.robot(robots.DEFAULT).settings
    assert invoke("new", "robot", "mine") == 2
    assert "there is a file mine.toml" in capsys.readouterr().err
    assert invoke("new", "robot", "mine", "--overwrite", "--quiet") == 0
    assert capsys.readouterr().out == ""


def _completed(words: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> set[str]:
    """What is offered for the last of the words, by the protocol of click's script for fish."""
    *before, last = words.split(" ")
    monkeypatch.setenv("_OMNI_MJ_COMPLETE", "fish_complete")
    monkeypatch.setenv("COMP_WORDS", shlex.join(before))
    monkeypatch.setenv("COMP_CWORD", last)
    assert invoke() == 0
    offered = capsys.readouterr().out.split("\n")
    return {item.partition("\t")[0].partition(",")[2] for item in offered if item.startswith("plain,")} or {
        offered[0].partition(",")[0]
    }


@pytest.mark.parametrize(
    ("words", "offered"),
    [
        ("omni-mj l", {"limit", "loop", "list"}),
        ("omni-mj run --scenario rec", {"rect", "rect-noise"}),
        ("omni-mj --scenario rec", {"rect", "rect-noise"}),
        ("omni-mj --scen", {"--scenario"}),
        ("omni-mj run --controller comp", {"comp-flc", "comp-flc-lag"}),
        ("omni-mj compare --plant k", {"kinematic"}),
        ("omni-mj slip --robot tigers-v2020", {"tigers-v2020", "tigers-v2020-planetary"}),
        ("omni-mj drive --robot u", {"ubc-thunderbots"}),
        ("omni-mj run --set radio.d", {"radio.delay_frames="}),
        ("omni-mj limit league", {"league", "league-smooth"}),
        ("omni-mj show r", {"rect", "rect-noise", "robojackets", "roboteam-twente"}),
        ("omni-mj list s", {"scenarios", "settings"}),
        ("omni-mj new c", {"controller"}),
        ("omni-mj picture a.rrd b.png --tab s", {"summary", "settings"}),
        ("omni-mj run --model m", {"file"}),
    ],
)
def test_names_are_completed(
    words: str, offered: set[str], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert _completed(words, monkeypatch, capsys) == offered


@pytest.mark.parametrize("word", ["mine.p", "rect"])
def test_where_files_are_allowed_the_shell_offers_them_too(word: str) -> None:
    items = complete.offered(word, [("rect", "")], files=True)
    assert [item.type for item in items] == ["file", "plain"][: 1 + (word == "rect")]


def test_bash_completes_by_the_script_that_is_printed() -> None:
    """A real bash, which has read nothing else, asked for the words after a prefix."""
    ask = "COMP_WORDS=(omni-mj new s); COMP_CWORD=2; _omni_mj_completion omni-mj; echo ${COMPREPLY[@]}"
    environment = os.environ | {"PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"}
    script = f'eval "$(omni-mj completion bash)"\n{ask}'
    done = subprocess.run(
        ["bash", "--norc", "-c", script], env=environment, capture_output=True, text=True, timeout=60, check=False
    )
    assert (done.returncode, done.stdout, done.stderr) == (0, "scenario\n", "")


def test_the_help_of_picture_names_the_tabs_that_there_are() -> None:
    wheels = om.scenario("rect").settings.wheels.kinematics
    assert set(picture.TABS) == {*tabs.tabs(wheels, set()), "summary", "events", "settings"}
