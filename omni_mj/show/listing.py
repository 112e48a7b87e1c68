"""What there is to name: scenarios, controllers, plants, robots, and every setting with unit, default and range."""

import json
import tomllib
from typing import TYPE_CHECKING, Any

from omni_control.controllers import CONTROLLERS, find
from omni_mj.scenarios import robots
from omni_mj.scenarios.plants import PLANTS
from omni_mj.scenarios.scenario import builtin
from omni_mj.scenarios.settings import every_setting
from omni_mj.show import terminal

if TYPE_CHECKING:
    from rich.console import Console

PIPE_WIDTH = 140  # columns, where the output is no terminal


def show() -> None:
    """Print the lists."""
    console = terminal.console(PIPE_WIDTH)
    scenarios = {name: tomllib.loads(path.read_text(encoding="utf-8")) for name, path in builtin().items()}
    _print(console, "scenarios (--scenario)", [[name, data.get("description", "")] for name, data in scenarios.items()])
    _print(console, "controllers (--controller)", [[name, _first_line(find(name))] for name in CONTROLLERS])
    _print(console, "plants (--plant)", [[name] for name in PLANTS])
    _print(console, "robots (--robot)", [[name] for name in robots.names()])
    rows = [[s.full, short(s.default), s.unit, s.allowed, s.doc] for s in every_setting()]
    _print(console, "settings (--set section.field=value)", rows, ["setting", "default", "unit", "allowed", "meaning"])


def short(value: Any) -> str:
    """A setting's value as in a scenario file, but for the quotes of a string."""
    return value if isinstance(value, str) else json.dumps(value)


def _first_line(kind: type) -> str:
    return (kind.__doc__ or "").split("\n", 1)[0]


def _print(console: "Console", title: str, rows: list[list[str]], headings: list[str] | None = None) -> None:
    from rich.markup import escape
    from rich.table import Table

    table = Table(title=title, title_justify="left", title_style="bold", box=None, show_header=headings is not None)
    for i in range(len(rows[0])):
        table.add_column(headings[i] if headings else "", no_wrap=i == 0)
    for row in rows:
        table.add_row(*map(escape, row))
    console.print(table)
    console.print()
