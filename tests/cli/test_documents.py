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
from commands import run_python

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
        ROOT / "README.md",
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
SOURCES = tomllib.loads((DATA / "sources.toml").read_text(encoding="utf-8"))
TEXTS = {
    path.relative_to(ROOT): path.read_text(encoding="utf-8")
    for pattern in ("README.md", "CONTRIBUTING.md", "*/README.md", "docs/**/*.md")
    for path in ROOT.glob(pattern)
    if "runs" not in path.parts
}
ALL_DATA = "".join(path.read_text(encoding="utf-8") for path in DATA.glob("*.csv"))
SETTINGS = {setting.full_name for setting in list_settings()}


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
    commands = re.findall(r"^ {4}(omni-mj .*)$", joined, re.MULTILINE)
    for _, _, block in BLOCK.findall(joined):
        commands += re.findall(r"^(omni-mj .*)$", block, re.MULTILINE)
    commands += re.findall(r"`(omni-mj [^`]*)`", joined.replace("\n", " "))
    return [shlex.split(command, comments=True)[1:] for command in commands]


@pytest.mark.parametrize("page", TEXTS, ids=str)
def test_options_and_settings_of_commands_exist(page: Path) -> None:
    """Every option of a command exists, and so does every setting of `--set` and `--vary`."""
    assert isinstance(cli, click.Group)
    text = TEXTS[page]
    if page.parent == Path("docs/data"):
        text += "".join(f"```sh\n{source['command']}\n```\n" for source in SOURCES.values())
    for command in commands_of(text):
        words = ["run", *command] if not command or command[0].startswith("-") else command
        if words[0] == "COMMAND":
            continue
        options = {name for parameter in cli.commands[words[0]].params for name in parameter.opts}
        options |= {f"--no-{name[2:]}" for name in options} | {"--help"}
        assert {word for word in words if word.startswith("--")} <= options, words
        for option, value in pairwise(words):
            setting = value.partition("=")[0]
            if option in ("--set", "--vary") and not setting.startswith("controller."):
                assert setting in SETTINGS, words


def test_pages_can_be_followed_in_one_folder() -> None:
    """No two pages write to the same `--out`, which must be empty."""
    folders = [
        folder
        for text in TEXTS.values()
        for folder in {
            folder
            for language, _, block in BLOCK.findall(text)
            if language == "sh"
            for folder in re.findall(r"--out (\S+)", block)
        }
    ]
    assert len(folders) == len(set(folders)), sorted(folders)


@pytest.mark.parametrize("page", TEXTS, ids=str)
def test_settings_in_a_text_exist(page: Path) -> None:
    """Inline code of the form `section.field` names a setting, if it begins with a section."""
    sections = {name.partition(".")[0] for name in SETTINGS}
    text = TEXTS[page] + ALL_DATA
    for name in re.findall(r"`([a-z]+\.[a-z0-9_]+)(?:[ =][^`]*)?`", text):
        is_file = name.endswith((".py", ".toml", ".xml"))
        assert name in SETTINGS or is_file or name.partition(".")[0] not in sections, name


@pytest.mark.parametrize("page", TEXTS, ids=str)
def test_links_and_files_of_a_page_exist(page: Path) -> None:
    """Files of the repository that a page links or names exist."""
    links = re.findall(r"\]\(([^)#:]+)(?:#[^)]*)?\)", TEXTS[page])
    names = re.findall(
        r"`((?:omni_mj|control|tests|models|docs|examples)/[^`\s]*\.\w+)`", TEXTS[page]
    )
    paths = [*(ROOT / page.parent / link for link in links), *(ROOT / name for name in names)]
    assert not [path for path in paths if not path.exists()]


def test_data_has_a_source_and_a_page() -> None:
    """Every CSV file in docs/data has a title and a command, and a page shows it."""
    assert SOURCES.keys() == {path.stem for path in DATA.glob("*.csv")}
    for name, source in SOURCES.items():
        assert source["title"], name
        assert source["command"], name
        link = re.compile(rf"^\[[^\]]*\]\([^)]*data/{name}\.csv\)$", re.MULTILINE)
        assert any(map(link.search, TEXTS.values())), name


@pytest.mark.pages
@pytest.mark.parametrize("example", sorted(ROOT.glob("examples/*.py")), ids=lambda path: path.stem)
def test_examples_are_short_and_run(example: Path, tmp_path: Path) -> None:
    """At most 30 lines each; what it prints is not checked, but it prints something."""
    assert len(example.read_text(encoding="utf-8").splitlines()) <= 30
    done = run_python(example, cwd=tmp_path, timeout=120)
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout
