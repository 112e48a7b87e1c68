"""The pages of the documentation: their commands, programs, links and names.

A block of `sh`, `python`, `toml` or `xml` runs here. The lessons run by `docs/tutorials/run.py`.
An indented block or a block of `text` holds commands that need a network, hardware or minutes;
their options and settings are checked against the code.
"""

import os
import re
import shlex
import subprocess
import sys
import tomllib
from itertools import pairwise
from pathlib import Path

import click
import pytest

from omni_mj.cli.main import cli
from omni_mj.config.settings import list_settings

ROOT = Path(__file__).parents[2]
DATA = ROOT / "docs" / "data"
BLOCK = re.compile(r"^```(sh|toml|python|xml) ?(\S*)\n(.*?)^```", re.MULTILINE | re.DOTALL)
LESSONS = {"dead-time", "alpha-and-slip", "identify"}
PAGES = sorted(
    str(path.relative_to(ROOT))
    for path in [
        ROOT / "CONTRIBUTING.md",
        *ROOT.glob("docs/how-to/*.md"),
        *ROOT.glob("docs/tutorials/*.md"),
        *ROOT.glob("docs/reference/*.md"),
        *ROOT.glob("docs/explanation/*.md"),
    ]
    if path.stem not in LESSONS and BLOCK.search(path.read_text(encoding="utf-8"))
)
# Page -> files that its commands must leave, with a text that they must contain.
EXPECTED = {
    "docs/tutorials/tour.md": {"runs.html": "late", "compared/compare.md": "Gentle"},
    "docs/how-to/use-from-python.md": {"runs/mine/summary.json": "comp-flc"},
    "docs/how-to/add-a-robot.md": {"three/provenance.json": "three.xml"},
    "CONTRIBUTING.md": {"mine/summary.json": "Mine", "toy/summary.json": "toy.py:Toy"},
}
TEXTS = [
    *(path for path in ROOT.glob("*.md") if path.name != "CHANGELOG.md"),
    *ROOT.glob("docs/**/*.md"),
    *(ROOT / name / "README.md" for name in ("control", "models")),
]


@pytest.mark.pages
@pytest.mark.parametrize("page", PAGES)
def test_blocks_of_a_page_run_in_order(page: str, tmp_path: Path) -> None:
    """Blocks with a file name are written to that file, the others run; each must succeed.

    Python files are imported.
    """
    environment = os.environ | {
        "PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    }
    for language, name, text in BLOCK.findall((ROOT / page).read_text(encoding="utf-8")):
        if name:
            (tmp_path / name).write_text(text, encoding="utf-8")
            text = f"import {Path(name).stem}"
        if language in ("toml", "xml"):
            continue
        program = ["bash", "-e", "-c"] if language == "sh" else [sys.executable, "-c"]
        done = subprocess.run(
            [*program, text],
            cwd=tmp_path,
            env=environment,
            capture_output=True,
            text=True,
            timeout=300,
            check=False,
        )
        assert done.returncode == 0, f"{text}\n{done.stderr}"
    for file, content in EXPECTED.get(page, {}).items():
        assert content in (tmp_path / file).read_text(encoding="utf-8"), file


def commands_of(text: str) -> list[list[str]]:
    """Return the words of each `omni-mj` command in a text, in blocks and in inline code."""
    joined = text.replace("\\\n", " ")
    blocks = re.findall(r"^ {4}(omni-mj .*)$", joined, re.MULTILINE)
    for _, _, block in BLOCK.findall(joined):
        blocks += re.findall(r"^(omni-mj .*)$", block, re.MULTILINE)
    inline = re.findall(r"`(omni-mj [^`]*)`", joined.replace("\n", " "))
    words = [shlex.split(command, comments=True) for command in [*blocks, *inline]]
    return [command[1:] for command in words if "COMMAND" not in command]


def options_of(command: click.Command) -> dict[str, bool]:
    """Return each option of a command, and whether it is a flag."""
    return {
        name: parameter.is_flag
        for parameter in command.params
        if isinstance(parameter, click.Option)
        for name in (*parameter.opts, *parameter.secondary_opts)
    }


@pytest.mark.parametrize("path", TEXTS, ids=lambda path: str(path.relative_to(ROOT)))
def test_options_and_settings_of_commands_exist(path: Path) -> None:
    """Every option of every command on a page exists, and so does every setting of `--set`."""
    assert isinstance(cli, click.Group)
    names = {setting.full for setting in list_settings()}
    sources = tomllib.loads((DATA / "sources.toml").read_text(encoding="utf-8"))
    text = path.read_text(encoding="utf-8")
    if path.name == "README.md" and path.parent == DATA:
        text += "".join(f"```sh\n{source['command']}\n```\n" for source in sources.values())
    for words in commands_of(text):
        if not words or words[0].startswith("--"):
            words = ["run", *words]
        assert words[0] in cli.commands, words
        known = options_of(cli.commands[words[0]]) | {"--help": True}
        used = [word.partition("=")[0] for word in words if word.startswith("--")]
        assert set(used) <= known.keys(), (words, set(used) - known.keys())
        for option, value in pairwise(words):
            setting = value.partition("=")[0]
            if option in ("--set", "--vary") and not setting.startswith("controller."):
                assert setting in names, (words, setting)


@pytest.mark.parametrize("path", TEXTS, ids=lambda path: str(path.relative_to(ROOT)))
def test_settings_in_a_text_exist(path: Path) -> None:
    """Inline code of the form `section.field` names a setting, if it begins with a section."""
    names = {setting.full for setting in list_settings()}
    sections = {name.partition(".")[0] for name in names} | {"drive"}
    text = path.read_text(encoding="utf-8")
    if path.parent == DATA:
        text += "".join(file.read_text(encoding="utf-8") for file in DATA.glob("*.csv"))
    for name in re.findall(r"`([a-z]+\.[a-z0-9_]+)(?:[ =][^`]*)?`", text):
        if name.partition(".")[0] in sections and not name.endswith((".py", ".toml", ".xml")):
            assert name in names, name


@pytest.mark.parametrize("path", TEXTS, ids=lambda path: str(path.relative_to(ROOT)))
def test_lines_are_short(path: Path) -> None:
    """Prose and code have at most 100 columns. Tables and links can be longer."""
    lines = path.read_text(encoding="utf-8").splitlines()
    long_lines = [
        line for line in lines if len(line) > 100 and "|" not in line and "](" not in line
    ]
    assert not long_lines
    assert path != ROOT / "README.md" or len(lines) <= 150


def test_links_and_files_of_the_pages_exist() -> None:
    """Files of the repository that a page links or names exist."""
    for path in TEXTS:
        text = path.read_text(encoding="utf-8")
        linked = [
            target
            for target in re.findall(r"\]\(([^)#:]+)(?:#[^)]*)?\)", text)
            if "://" not in target
        ]
        missing = [target for target in linked if not (path.parent / target).exists()]
        assert not missing, (path, missing)
        named = re.findall(r"`((?:omni_mj|control|tests|models|docs|examples)/[^`\s]*\.\w+)`", text)
        missing = [target for target in named if not (ROOT / target).exists()]
        assert not missing, (path, missing)


def test_data_has_a_source_and_a_page() -> None:
    """Every CSV file in docs/data has a title and a command, and a page shows it."""
    sources = tomllib.loads((DATA / "sources.toml").read_text(encoding="utf-8"))
    assert sources.keys() == {path.stem for path in DATA.glob("*.csv")}
    assert all(source["title"] and source["command"] for source in sources.values())
    pages = "".join(path.read_text(encoding="utf-8") for path in TEXTS)
    for name in sources:
        assert re.search(rf"^\[[^\]]*\]\([^)]*data/{name}\.csv\)$", pages, re.MULTILINE), name


@pytest.mark.pages
@pytest.mark.parametrize("example", sorted(ROOT.glob("examples/*.py")), ids=lambda path: path.stem)
def test_examples_are_short_and_run(example: Path, tmp_path: Path) -> None:
    """At most 30 lines each; what it prints is not checked, but it prints something."""
    assert len(example.read_text(encoding="utf-8").splitlines()) <= 30
    done = subprocess.run(
        [sys.executable, example],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout
