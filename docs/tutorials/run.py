"""Runs lessons: the Python of a page from top to bottom, as one program, in the folder one is in.

    python docs/lessons/run.py [--write] PAGE.md...

What a block prints must be what the block of text behind it says; with --write it is written there. Figures are left in
that folder. `make lessons` does the first, `make lessons WRITE=--write` the second, and puts figures beside the pages.
"""

import io
import re
import sys
from collections.abc import Sequence
from contextlib import redirect_stdout
from pathlib import Path
from typing import Any

BLOCK = re.compile(r"^```python\n(.*?)^```\n(?:\n```text\n(.*?)^```\n)?", re.MULTILINE | re.DOTALL)


def run(page: str) -> str:
    """A page with what its blocks print now."""
    names: dict[str, Any] = {"__name__": "lesson"}

    def again(block: re.Match[str]) -> str:
        with redirect_stdout(io.StringIO()) as printed:
            exec(compile(block[1], "lesson", "exec"), names)
        text = "".join(line.rstrip() + "\n" for line in printed.getvalue().splitlines())
        return f"```python\n{block[1]}```\n" + (f"\n```text\n{text}```\n" if text else "")

    return BLOCK.sub(again, page)


def main(words: Sequence[str]) -> int:
    """Run the pages named; return how many say something else than their programs."""
    differ = 0
    for path in (Path(word) for word in words if word != "--write"):
        before = path.read_text(encoding="utf-8")
        after = run(before)
        if "--write" in words:
            path.write_text(after, encoding="utf-8")
        elif after != before:
            differ += 1
            print(
                f"{path} does not say what its program prints; see docs/lessons/run.py",
                file=sys.stderr,
            )
    return differ


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
