"""What the tests of the command line share: commands in this process, and strict JSON."""

import json
from pathlib import Path
from typing import Any

import click
import pytest

from omni_mj.cli import console
from omni_mj.cli.main import cli


def invoke(*args: object, command: click.Command = cli) -> int:
    """The exit code of a command in this process, which is quicker than one of its own."""
    with pytest.raises(SystemExit) as end:
        console.invoke(command, list(map(str, args)))
    assert isinstance(end.value.code, int)
    return end.value.code


def strict(path: Path) -> Any:
    """JSON without NaN and its like."""
    return json.loads(path.read_text(), parse_constant=lambda name: pytest.fail(f"{name} in {path}"))
