"""Runs omni-mj in this process and sends it a signal at a moment that repeats: before its n-th event of a kind.

    python at.py KIND N SIGNAL WORD...

Kinds are `import`, a module begins to be imported; `open`, a file is opened; or any text, a file is opened that has it
in its path.
"""

import os
import runpy
import signal
import sys
from collections.abc import Callable


def watch(kind: str, happened: Callable[[int], object]) -> None:
    """Call a function with the number of each event of a kind, from 1 on."""
    seen = 0

    def hook(event: str, args: tuple) -> None:
        nonlocal seen
        if event == kind or (event == "open" and kind not in ("import", "open") and kind in str(args[0])):
            seen += 1
            happened(seen)

    sys.addaudithook(hook)


def send(kind: str, number: int, sent: signal.Signals) -> None:
    """Send this process a signal at an event."""
    watch(kind, lambda seen: os.kill(os.getpid(), sent) if seen == number else None)


if __name__ == "__main__":
    kind, number, name, *words = sys.argv[1:]
    send(kind, int(number), signal.Signals[name])
    sys.argv = ["omni-mj", *words]
    runpy.run_module("omni_mj", run_name="__main__", alter_sys=True)
