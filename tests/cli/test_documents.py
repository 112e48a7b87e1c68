"""The documents as a newcomer takes them: all their commands and code, in order, each document in an empty folder."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
BLOCK = re.compile(r"^```(sh|toml|python|xml) ?(\S*)\n(.*?)^```", re.MULTILINE | re.DOTALL)
# Document -> files that its commands must leave, with something that they must hold.
DOCUMENTS = {
    "docs/tour.md": {"runs.html": "late", "compared/compare.md": "Gentle"},
    "docs/python.md": {"runs/mine/summary.json": "comp-flc"},
    "docs/commands.md": {"late/scenario.toml": "delay_frames = 9", "own/summary.json": "Steady"},
    "docs/robots.md": {"robot.schema.json": "azimuths_deg", "three/provenance.json": "three.xml"},
    "CONTRIBUTING.md": {
        "mine/summary.json": "Mine",
        "toy/summary.json": "toy.py:Toy",
        "three/summary.json": "three.toml",
    },
}


@pytest.mark.pages
@pytest.mark.parametrize("document", DOCUMENTS)
def test_every_block_of_a_document_works(document: str, tmp_path: Path) -> None:
    """Blocks with a file's name are written to it, the others run; each must succeed."""
    environment = os.environ | {
        "PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    }
    blocks = BLOCK.findall((ROOT / document).read_text(encoding="utf-8"))
    for language, name, text in blocks:
        if name:
            (tmp_path / name).write_text(text, encoding="utf-8")
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
    for file, holds in DOCUMENTS[document].items():
        assert holds in (tmp_path / file).read_text(encoding="utf-8"), file


def test_files_that_the_documents_name_exist() -> None:
    """Files of the repository that the texts link or name are there; the change log names those of its time."""
    for path in (
        *(path for path in ROOT.glob("*.md") if path.name != "CHANGELOG.md"),
        *ROOT.glob("docs/*.md"),
        *(ROOT / name / "README.md" for name in ("control", "models")),
    ):
        document = path.relative_to(ROOT)
        text = (ROOT / document).read_text(encoding="utf-8")
        linked = [
            target
            for target in re.findall(r"\]\(([^)#:]+)(?:#[^)]*)?\)", text)
            if "://" not in target
        ]
        assert all(((ROOT / document).parent / target).exists() for target in linked), (
            document,
            linked,
        )
        named = re.findall(r"`((?:omni_mj|control|tests|models|docs|examples)/[^`\s]*\.\w+)`", text)
        assert all((ROOT / target).exists() for target in named), (document, named)


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
