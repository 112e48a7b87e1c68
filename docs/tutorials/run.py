"""Run the Python blocks of a lesson as one program, in the current folder.

    python docs/tutorials/run.py [--write] PAGE.md...

The output of a block must equal the block of text below it. `--write` replaces that text instead.
Figures are saved in the current folder. `make lessons` runs this; `make lessons WRITE=--write` also
copies the figures next to the pages.
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
    """Return a page with the present output of its blocks."""
    namespace: dict[str, Any] = {"__name__": "lesson"}

    def run_block(block: re.Match[str]) -> str:
        with redirect_stdout(io.StringIO()) as stdout:
            exec(compile(block[1], "lesson", "exec"), namespace)
        text = "".join(line.rstrip() + "\n" for line in stdout.getvalue().splitlines())
        return f"```python\n{block[1]}```\n" + (f"\n```text\n{text}```\n" if text else "")

    return BLOCK.sub(run_block, page)


def main(arguments: Sequence[str]) -> int:
    """Run the pages; return how many of them differ from their output."""
    n_differing = 0
    for path in (Path(argument) for argument in arguments if argument != "--write"):
        text = path.read_text(encoding="utf-8")
        updated = run(text)
        if "--write" in arguments:
            path.write_text(updated, encoding="utf-8")
        elif updated != text:
            n_differing += 1
            print(f"{path}: output differs; see docs/tutorials/run.py", file=sys.stderr)
    return n_differing


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
