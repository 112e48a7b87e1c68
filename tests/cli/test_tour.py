"""The tour, docs/tour.md, as a newcomer takes it: all its commands and code, in order, in an empty folder."""

import os
import re
import subprocess
import sys
from pathlib import Path

TOUR = Path(__file__).parents[2] / "docs" / "tour.md"
BLOCK = re.compile(r"^```(sh|toml|python) ?(\S*)\n(.*?)^```", re.MULTILINE | re.DOTALL)


def test_every_command_of_the_tour_works(tmp_path: Path) -> None:
    """Blocks with a file's name are written to it, the others run; each must succeed."""
    environment = os.environ | {"PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"}
    blocks = BLOCK.findall(TOUR.read_text(encoding="utf-8"))
    assert {language for language, _, _ in blocks} == {"sh", "toml", "python"}
    for language, name, text in blocks:
        if name:
            (tmp_path / name).write_text(text, encoding="utf-8")
            continue
        program = ["bash", "-e", "-c"] if language == "sh" else [sys.executable, "-c"]
        done = subprocess.run(
            [*program, text], cwd=tmp_path, env=environment, capture_output=True, text=True, timeout=300, check=False
        )
        assert done.returncode == 0, f"{text}\n{done.stderr}"
    assert (tmp_path / "runs.html").stat().st_size > 10_000
    assert "Gentle" in (tmp_path / "compared" / "compare.md").read_text(encoding="utf-8")


def test_files_that_the_tour_names_exist() -> None:
    """Files of the repository that the text names are there; those of a run begin with a folder of the tour."""
    for target in re.findall(r"`([^`\s]+/[^`\s]+\.(?:py|html))`", TOUR.read_text(encoding="utf-8")):
        assert target.startswith(("first/", "triangle/", "compared/")) or (TOUR.parents[1] / target).is_file(), target
