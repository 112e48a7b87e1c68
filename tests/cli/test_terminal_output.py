"""Text on the terminal: complete in any encoding, without control characters, words quoted."""

import json
import os
import shlex
import shutil
import subprocess
import sys
import unicodedata
from pathlib import Path
from typing import Any

import pytest
from commands import SHORT, run_python

import omni_mj as om
from omni_mj.io.printable_text import PrintableOutput, join_words
from omni_mj.results.result_tables import results_table
from omni_mj.results.text_table import format_table

ENCODINGS = ("ascii", "cp1250", "cp1251", "cp1252", "cp437", "cp932", "big5", "gbk", "koi8-r")
HOSTILE = "\x1b]0;title\x07\x9b31m\u202e\x7f"
CONTROLLER = f'''
import omni_mj as om


class Mine(om.Controller):
    """Rest.{HOSTILE}"""

    def command(self, frame, observation):
        if frame == 5:
            raise ValueError("lost {HOSTILE}")
        return 0 * observation.pose
'''
RUN = f"run --scenario rect --plant kinematic {SHORT} --no-figures --no-record"


def program(*words: object, cwd: Path, encoding: str = "utf-8") -> subprocess.CompletedProcess[Any]:
    """Run omni-mj in a process whose standard streams have an encoding."""
    environment = os.environ | {"PYTHONIOENCODING": encoding}
    return run_python("-m omni_mj", *words, cwd=cwd, env=environment, text=False)


@pytest.fixture(scope="module")
def summary() -> dict[str, object]:
    """Return the summary of a run of two controllers and two seeds."""
    reference = {"waypoints": [[0, 0], [0.1, 0]], "settle_s": 0.1}
    scenario = om.load_scenario("rect", plant="kinematic", reference=reference)
    return om.run(scenario, ["flc", "p"], seeds=2).summary()


def test_a_run_is_complete_whatever_the_encoding(tmp_path: Path) -> None:
    """The encoding lacks degrees and dashes. Nothing but the spelling changes."""
    done = program(RUN, "--controller flc --out r", cwd=tmp_path, encoding="ascii")
    assert (done.returncode, done.stderr) == (0, b"")
    assert (tmp_path / "r" / "report.html").exists()
    assert b"deg" in done.stdout


@pytest.mark.parametrize("encoding", ENCODINGS)
def test_columns_of_tables_are_aligned_in_any_encoding(
    encoding: str,
    summary: dict[str, object],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    with (tmp_path / "out").open("wb") as file:
        output = PrintableOutput(file, encoding=encoding)
        monkeypatch.setattr(sys, "stdout", output)
        print(format_table(results_table(summary, effort=True)))
        output.flush()
        output.detach()
    text = (tmp_path / "out").read_bytes().decode(encoding)
    headings, units, *rows = [line for line in text.splitlines() if "  " in line][:4]
    ends = {len(line) for line in (headings, units, *rows) if line.strip()}
    assert "\\u" not in text
    assert len(ends) == 1, text


def test_text_of_files_reaches_the_terminal_without_control_characters(tmp_path: Path) -> None:
    """Docstrings, messages of controllers, names in summaries and models, columns of logs."""
    (tmp_path / "mine.py").write_text(CONTROLLER, encoding="utf-8")
    shown = program("show mine.py:Mine", cwd=tmp_path)
    failed = program(RUN, "--controller mine.py:Mine --out r", cwd=tmp_path)
    record = json.loads((tmp_path / "r" / "provenance.json").read_text("utf-8"))
    record["versions"]["numpy"] = HOSTILE
    (tmp_path / "r" / "provenance.json").write_text(json.dumps(record), encoding="utf-8")
    verified = program("verify r --allow-code", cwd=tmp_path)
    (tmp_path / "robot.xml").write_text(f"<mujoco><{HOSTILE}/></mujoco>", encoding="utf-8")
    model = program("run --scenario rect --model robot.xml", cwd=tmp_path)
    for done, code in ((shown, 0), (failed, 1), (verified, 0), (model, 2)):
        assert done.returncode == code, done.stderr
        for text in (done.stdout.decode(), done.stderr.decode()):
            assert "Traceback" not in text
            assert not {c for c in text if unicodedata.category(c)[0] == "C"} - {"\n"}, text
    assert b"]0;title" in shown.stdout
    assert b"]0;title" in failed.stderr
    assert b"]0;title" in verified.stdout


def test_a_printed_command_is_read_by_the_shell_as_it_was_given(tmp_path: Path) -> None:
    """Spaces, quotes, dollars, globs, line breaks and control characters in paths."""
    names = ("a b", "it's", 'say "$HOME"', "`id`", "*[x]?", "~", "a;b&c|d", "x\ny\x1b[1m\x07", "é")
    for name in names:
        line = join_words(["printf", "%s", name])
        assert line.isprintable()
        bash = shutil.which("bash") or pytest.skip("no bash")
        printed = subprocess.run([bash, "-c", line], capture_output=True, check=True).stdout
        assert printed.decode() == name
    folder = 'it\'s "$HOME" & co'
    done = program(RUN, "--controller p --out", Path(folder), cwd=tmp_path)
    (line,) = (text for text in done.stdout.decode().splitlines() if text.startswith("  repeat"))
    assert shlex.split(line)[1:] == ["omni-mj", "run", "--scenario", f"{folder}/scenario.toml"]
    assert (
        program("new scenario", Path(folder, "mine"), cwd=tmp_path)
        .stdout.decode()
        .endswith(f"--scenario {shlex.quote(f'{folder}/mine.toml')}\n")
    )
