"""What there is to name: scenarios, controllers, plants, robots, and every setting with unit, default and range."""

import json
import tomllib
from typing import Any

from omni_control.controllers import CONTROLLERS, find
from omni_mj.scenarios import robots
from omni_mj.scenarios.plants import PLANTS
from omni_mj.scenarios.scenario import builtin
from omni_mj.scenarios.settings import every_setting
from omni_mj.show import terminal

HEADINGS = ["setting", "default", "unit", "allowed", "meaning"]
WIDEST = [None, 20, 10, 24]  # columns of settings, in characters; the meaning has what is left


def show() -> None:
    """Print the lists."""
    scenarios = {name: tomllib.loads(path.read_text(encoding="utf-8")) for name, path in builtin().items()}
    settings = [[s.full, short(s.default), s.unit, s.allowed, s.doc] for s in every_setting()]
    for title, rows, widest in (
        ("scenarios (--scenario)", [[name, data.get("description", "")] for name, data in scenarios.items()], [None]),
        ("controllers (--controller)", [[name, _first_line(find(name))] for name in CONTROLLERS], [None]),
        ("plants (--plant)", [[name] for name in PLANTS], []),
        ("robots (--robot)", [[name] for name in robots.names()], []),
        ("settings (--set section.field=value)", [HEADINGS, *settings], WIDEST),
    ):
        print(title)
        for line in terminal.wrapped(rows, widest):
            print(f"  {line}")
        print()


def short(value: Any) -> str:
    """A setting's value as in a scenario file, but for the quotes of a string."""
    return value if isinstance(value, str) else json.dumps(value)


def _first_line(kind: type) -> str:
    return (kind.__doc__ or "").split("\n", 1)[0]
