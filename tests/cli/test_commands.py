"""Help, lists, starter files and wrong input of the command line."""

import os
import re
import shlex
import signal
import subprocess
import sys
from itertools import pairwise
from pathlib import Path

import pytest
from commands import BARE, SHORT, invoke, list_names, run_python, strict

import omni_mj as om

ROOT = Path(__file__).parents[2]
HEAVY = ("mujoco", "scipy", "pyarrow", "rerun", "matplotlib", "jinja2", "numpy", "pydantic")


def printed(capsys: pytest.CaptureFixture[str], *words: object) -> str:
    capsys.readouterr()
    assert invoke(*words) == 0
    return capsys.readouterr().out


def test_help_version_and_lists_import_nothing_heavy() -> None:
    """Each in a new process."""
    code = (
        "import sys\nfrom omni_mj.cli import main\n"
        f"try: main.main()\nfinally: print('heavy:', *[m for m in {HEAVY} if m in sys.modules])"
    )
    for words, allowed in (
        ("--help", set()),
        ("--version", set()),
        ("list scenarios", set()),
        ("run --help", set()),
        ("list", {"numpy", "pydantic"}),
        ("schema", {"numpy", "pydantic", "scipy"}),
    ):
        done = run_python(words, code=code)
        assert (done.returncode, done.stderr) == (0, ""), words
        assert set(done.stdout.splitlines()[-1].split()[1:]) <= allowed, words


def test_an_interrupt_during_an_import_is_an_interrupt(tmp_path: Path) -> None:
    """Libraries in C may replace it by an ImportError; Python's own traceback is of no use."""
    interrupt = "import os, signal\nos.kill(os.getpid(), signal.SIGINT)\n"
    replaced = "try:\n    {}\nexcept KeyboardInterrupt:\n    raise ImportError from None\n".format(
        interrupt.rstrip().replace("\n", "\n    ")
    )
    for module, text, code, message in (
        ("click", interrupt, -signal.SIGINT, ""),
        ("numpy", replaced, 130, "error: interrupted\n"),
    ):
        (tmp_path / module).mkdir()
        (tmp_path / module / f"{module}.py").write_text(text)
        done = run_python(
            "-m omni_mj list",
            env=os.environ | {"PYTHONPATH": str(tmp_path / module)},
            preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
        )
        assert (done.returncode, done.stderr) == (code, message)


FOREIGN = {
    "MPLBACKEND": "module://matplotlib_inline.backend_inline",  # of notebooks
    "MUJOCO_GL": "none-that-exists",
    "RERUN": "off",
    "_RERUN_TEST_FORCE_SAVE": "/nowhere/file",
}
LIBRARY_CALL = """
import os
from pathlib import Path

import matplotlib as mpl

before = dict(os.environ), dict(mpl.rcParams)
import omni_mj as om
from omni_mj.viz.figure_helpers import figure_file

om.run(om.load_scenario("rect", plant="planar", reference={"waypoints": [[0, 0], [0.1, 0]]}), "p")
with figure_file(Path("a")) as figure:
    figure.subplots()
assert (dict(os.environ), dict(mpl.rcParams)) == before
"""


def test_settings_of_other_programs_neither_end_a_run_nor_change(tmp_path: Path) -> None:
    """Notebooks set MPLBACKEND for all programs that they start; LaTeX may not be installed."""
    (tmp_path / "matplotlibrc").write_text("backend: module://nowhere\ntext.usetex: True\n")
    run = f"-m omni_mj run --scenario rect --plant planar {SHORT} --quiet"
    environment = os.environ | FOREIGN
    for done in (
        run_python(run, "--controller p --out out", cwd=tmp_path, env=environment),
        run_python(code=LIBRARY_CALL, cwd=tmp_path, env=environment | {"MPLBACKEND": "tkagg"}),
    ):
        assert (done.returncode, done.stderr) == (0, "")
    for name in ("recording.rrd", "report.html", "figures/path.png"):
        assert (tmp_path / "out" / name).stat().st_size > 1000


def test_help_names_every_command_and_its_examples_parse(
    capsys: pytest.CaptureFixture[str],
) -> None:
    """Each command has help. The names in examples exist, or an earlier example writes them."""
    out = printed(capsys, "--help")
    assert printed(capsys) == out
    assert printed(capsys, "--version") == f"omni-mj {om.__version__}\n"
    commands = re.findall(r"^  ([a-z]+)  ", out, re.MULTILINE)
    known = "run compare sweep limit identify serve drive verify list"
    assert set(known.split()) <= set(commands)
    for name in commands:
        assert printed(capsys, name, "--help").startswith(f"Usage: omni-mj {name}")
    examples = re.findall(r"^  (omni-mj [a-z]+ .*)$", out, re.MULTILINE)
    assert len(examples) >= 5
    names = {
        *list_names("scenarios"),
        *list_names("controllers"),
        *list_names("robots"),
        "mine.py:Mine",
    }
    for example in examples:
        words = shlex.split(example)
        options = printed(capsys, words[1], "--help")
        for option, value in pairwise(words):
            assert not option.startswith("--") or option in options
            assert option not in ("--scenario", "--controller", "--robot") or value in names


@pytest.mark.parametrize(
    ("words", "expected_error"),
    [
        ("comapre", "did you mean 'compare'?"),
        ("rect", "no such command 'rect'"),
        ("run rect", "unexpected extra argument (rect); see omni-mj run --help"),
        ("run --scenrio rect", "did you mean '--scenario'?"),
        ("show tigers-v2061", "did you mean 'tigers-v2016'?"),
        ("show nowhere.toml", "nowhere.toml cannot be read"),
        ("show lqr --set radio.delay_frames=1", "lqr is a controller"),
        ("list fricton", "did you mean 'friction'"),
        ("list robot tiger2016", "did you mean 'tigers-v2016'?"),
        ("list scenarois rect", "did you mean 'scenarios'?"),
        ("new robt mine", "'robt' is not one of"),
        ("new robot 2nd", "got '2nd'"),
        ("new scenario no/where", "cannot write no"),
    ],
)
def test_mistyped_words_give_one_line(
    words: str, expected_error: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert invoke(words) == 2
    out, err = capsys.readouterr()
    assert (out, err.count("\n")) == ("", 1)
    assert expected_error.casefold() in err.casefold()


def test_a_word_finds_the_lines_of_a_list(capsys: pytest.CaptureFixture[str]) -> None:
    all_lists = printed(capsys, "list")
    names = "rect-noise,comp-flc,kinematic,tigers-v2016,radio.delay_frames,V s/rad,0.826"
    for name in names.split(","):
        assert name in all_lists
    assert max(map(len, all_lists.splitlines())) <= 140
    matching_lines = printed(capsys, "list settings FRICTION")
    assert {"carpet.friction", "carpet.patches", "reference.assumed_friction"} <= set(
        re.findall(r"^  (\S+)", matching_lines, re.MULTILINE)
    )
    assert "radio.delay_frames" not in matching_lines
    kinds = [
        line.split()[:3]
        for line in printed(capsys, "list faults push").splitlines()[1:]
        if line.strip()
    ]
    assert ["kind", "=", "push"] in kinds
    assert "push.force_n" in (name for name, *_ in kinds)


@pytest.mark.parametrize("name", ["rect", "fault-all", "league-smooth"])
def test_a_scenario_that_is_shown_is_the_scenario(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "shown.toml").write_text(text := printed(capsys, "show", name))
    assert om.load_scenario(tmp_path / "shown.toml") == om.load_scenario(name)
    assert printed(capsys, "show", str(tmp_path / "shown.toml")) == text


def test_robots_changes_and_controllers_are_shown(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in list_names("robots"):
        (tmp_path / "shown.toml").write_text(text := printed(capsys, "show", name))
        assert om.load_robot(tmp_path / "shown.toml").settings == om.load_robot(name).settings
        assert om.load_robot(tmp_path / "shown.toml").description == om.load_robot(name).description
        assert printed(capsys, "show", str(tmp_path / "shown.toml")) == text
    out = printed(capsys, "show rect --robot ssl-a-team --set radio.delay_frames=9")
    assert 'robot = "ssl-a-team"' in out
    assert re.search(r"^delay_frames = 9 +# \(default 6\) \[frames\] ", out, re.MULTILINE)
    assert re.search(r"^mass_kg = [\d.]+ +# \[kg\] mass$", out, re.MULTILINE)
    for name in list_names("controllers"):
        assert printed(capsys, "show", name).splitlines()[0]


def test_starters_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """New scenarios, also with their commented lines, controllers and robots can be run."""
    monkeypatch.chdir(tmp_path)
    bare = f"--plant kinematic {BARE}"
    assert invoke("new scenario track.toml") == 0
    assert invoke("run --scenario track.toml", bare, "--out track") == 0
    text = re.sub(r"^# (?=\w+ = |\[)", "", Path("track.toml").read_text(), flags=re.MULTILINE)
    Path("all.toml").write_text(
        text.replace('plant = "kinematic"', "").replace(', "mine.py:Mine"', "")
    )
    scenario = om.load_scenario("all.toml")
    assert (scenario.robot, scenario.seeds, scenario.settings.reference.shape) == (
        "tigers-v2020",
        5,
        "circle",
    )
    assert [fault.kind for fault in scenario.settings.fault] == ["push"]

    drive = printed(capsys, "new controller my_first-one").partition("omni-mj ")[2].strip()
    assert drive in Path("my_first-one.py").read_text()
    assert "--set controller.MyFirstOne.gain=4.0\n" in printed(
        capsys, "show my_first-one.py:MyFirstOne"
    )
    assert invoke(drive, SHORT, bare, "--out out") == 0
    results = strict(tmp_path / "out" / "summary.json")["scenarios"]["rect"]["results"]
    error = results["MyFirstOne"]["error_m"]["position"]["max"]["mean"]
    assert 0 < error < 0.2  # m: it follows a route of 0.22 m

    assert invoke("new robot mine") == 0
    assert om.load_robot("mine.toml").settings == om.load_robot("tigers-v2016").settings
    assert invoke("new robot mine") == 2
    assert "mine.toml exists" in capsys.readouterr().err
    assert invoke("new robot mine --overwrite") == 0


@pytest.mark.parametrize(
    ("streams", "code", "err"),
    [
        (">&0", 1, ""),
        (">&-", 0, ""),
        ("> /dev/full", 1, "error: standard output: No space left on device\n"),
    ],
)
def test_closed_output_is_no_error_and_lost_output_is(streams: str, code: int, err: str) -> None:
    """Cases: the reader of a pipe has ended, streams are closed, the device is full."""
    read, write = os.pipe()
    os.close(read)
    command = f"{sys.executable} -m omni_mj list scenarios {streams}"
    with os.fdopen(write) as pipe:  # as standard input, to which commands may redirect their output
        done = subprocess.run(
            ["bash", "-c", command], stdin=pipe, stderr=subprocess.PIPE, text=True, timeout=60
        )
    assert (done.returncode, done.stderr) == (code, err)


@pytest.mark.parametrize(
    ("words", "expected_error"),
    [
        ("alpha --set radio.delay=1", "did you mean 'radio.delay_frames'"),
        ("alpha --robot nobody", "unknown robot 'nobody'"),
        ("slip --robot tigers", "unknown robot 'tigers'"),
        ("loop --controller pp", "unknown controller 'pp'"),
        ("loop --scenario rekt", "unknown scenario 'rekt'"),
        ("compare --scenario rect --scenario rect", "two scenarios are called 'rect'"),
        ("compare --subject comp-fcl", "did you mean 'comp-flc'"),
        ("compare --seeds 0", "1 to 100000"),
    ],
)
def test_invalid_input_of_studies_is_one_line_and_leaves_no_folder(
    words: str, expected_error: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert invoke(words, "--out", tmp_path / "out") == 2
    printed_error = capsys.readouterr().err
    assert expected_error in printed_error
    assert printed_error.count("\n") == 1
    assert not (tmp_path / "out").exists()
