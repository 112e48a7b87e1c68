"""Helpers of the tests of the command line: run commands, send signals, read strict JSON."""

import io
import json
import os
import re
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stdout
from pathlib import Path
from typing import Any

import click
import pytest

from omni_mj.cli import console
from omni_mj.cli.main import cli

WORD = re.compile(r"(?:\[\[.*?\]\]|[\[{].*?[\]}]|\S)+")
# Options of short runs, and of those that leave out pictures
SHORT = "--set reference.waypoints=[[0,0,0],[0.2,0.1,0.3]] --set reference.settle_s=0.1"
BARE = "--no-record --no-figures --quiet"


def split_words(*args: object) -> list[str]:
    """Return the words of a command line.

    Text is split at spaces, except for those in brackets. Words in a list remain as they are, and
    anything else, such as a path, is one word.
    """
    words: list[str] = []
    for arg in args:
        texts = arg if isinstance(arg, list) else [str(arg)]
        words += WORD.findall(arg) if isinstance(arg, str) else texts
    return words


def invoke(*args: object, command: click.Command = cli) -> int:
    """Run a command in this process, and return its exit code; see `split_words`."""
    with pytest.raises(SystemExit) as end:
        console.invoke_command(command, split_words(*args))
    assert isinstance(end.value.code, int)
    return end.value.code


def run_python(
    *args: object, code: str | None = None, **options: Any
) -> subprocess.CompletedProcess[str]:
    """Run Python in another process, and return what it printed.

    Args:
        *args: Its arguments; see `split_words`.
        code: Program, in place of a file or module among the arguments.
        **options: Options of `subprocess.run`.
    """
    words = split_words(*args) if code is None else ["-c", code, *split_words(*args)]
    options = {"text": True, "timeout": 60, "check": False} | options
    return subprocess.run([sys.executable, *words], capture_output=True, **options)


def list_names(title: str) -> list[str]:
    """Return the names in a list of `omni-mj list`, such as scenarios or robots."""
    out = io.StringIO()
    with redirect_stdout(out):
        assert invoke("list", title) == 0
    lines = out.getvalue().splitlines()[1:]
    return [
        line.split()[0] for line in lines if line.startswith("  ") and not line.startswith("   ")
    ]


def appears(path: Path) -> bool:
    """Wait for a file, and return whether it appears."""
    deadline = time.monotonic() + 60
    while not path.exists() and time.monotonic() < deadline:
        time.sleep(0.05)
    return path.exists()


@contextmanager
def signalled(number: int, path: Path) -> Iterator[None]:
    """Send this process a signal once a file exists."""

    def send() -> None:
        if appears(path):
            os.kill(os.getpid(), number)

    sender = threading.Thread(target=send)
    sender.start()
    try:
        yield
    finally:
        sender.join()


def strict(path: Path) -> Any:
    """Return the content of a JSON file; fail on NaN and infinity."""
    return json.loads(
        path.read_text(), parse_constant=lambda name: pytest.fail(f"{name} in {path}")
    )
