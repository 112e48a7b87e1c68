"""What --list shows: scenarios, controllers, and every setting with unit, default and range."""

import json
import sys
import tomllib
from typing import Any

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from omni_control.controllers import CONTROLLERS
from omni_mj.scenarios import scenario
from omni_mj.scenarios.settings import every_setting


def show() -> None:
    """Print the lists."""
    console = Console(width=None if sys.stdout.isatty() else 140)
    scenarios = {name: tomllib.loads(path.read_text(encoding="utf-8")) for name, path in scenario.builtin().items()}
    _print(console, "scenarios (--scenario)", [[name, data.get("description", "")] for name, data in scenarios.items()])
    trackers = [[name, (tracker.__doc__ or "").splitlines()[0]] for name, tracker in CONTROLLERS.items()]
    _print(console, "controllers (--controller)", trackers)
    rows = [[each.full, short(each.default), each.unit, each.allowed, each.doc] for each in every_setting()]
    _print(console, "settings (--set section.field=value)", rows, ["setting", "default", "unit", "allowed", "meaning"])


def short(value: Any) -> str:
    """A setting's value as in a scenario file, but for the quotes of a string."""
    return value if isinstance(value, str) else json.dumps(value)


def _print(console: Console, title: str, rows: list[list[str]], headings: list[str] | None = None) -> None:
    table = Table(title=title, title_justify="left", title_style="bold", box=None, show_header=headings is not None)
    for i in range(len(rows[0])):
        table.add_column(headings[i] if headings else "", no_wrap=i == 0)
    for row in rows:
        table.add_row(*map(escape, row))
    console.print(table)
    console.print()
