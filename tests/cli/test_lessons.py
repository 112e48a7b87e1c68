"""What `make lessons` runs: pages whose programs run, and whose text is what they print."""

import subprocess
import sys
from pathlib import Path

LESSONS = Path(__file__).parents[2] / "docs" / "lessons"
RUN = [sys.executable, str(LESSONS / "run.py")]


def lesson(folder: Path, *words: str) -> "subprocess.CompletedProcess[str]":
    return subprocess.run([*RUN, *words], cwd=folder, capture_output=True, text=True, timeout=300, check=False)


def test_a_page_that_says_something_else_is_told_and_written_anew(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    said = "one\n\n```python\na = 2\nprint(a)\n```\n\n```text\n{}\n```\n\n```python\nprint(a + 1)\n```\n{}two\n"
    page.write_text(said.format(3, ""))
    done = lesson(tmp_path, str(page))
    assert done.returncode == 1
    assert "page.md does not say what its program prints" in done.stderr
    assert lesson(tmp_path, "--write", str(page)).returncode == 0
    assert page.read_text() == said.format(2, "\n```text\n3\n```\n")
    assert lesson(tmp_path, str(page)).returncode == 0
