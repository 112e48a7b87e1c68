"""Lists of everything that can be named: scenarios, controllers, plants, robots, settings and faults."""

import ast
import json
import re
import tomllib
from collections.abc import Callable, Mapping
from difflib import get_close_matches
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

from omni_control.errors import OmniError
from omni_control.registry import CONTROLLERS, missing
from omni_mj.scenarios import robots
from omni_mj.scenarios.classes import PLANTS
from omni_mj.scenarios.toml_files import builtin
from omni_mj.show import tables

if TYPE_CHECKING:
    from omni_mj.scenarios.checking import Setting

HEADINGS = ["setting", "default", "unit", "allowed", "meaning"]
WIDTHS = [48, 20, 10, 24]  # of columns at most, but of the last, in characters
TITLES = {  # of the lists, and how each is used
    "scenarios": "--scenario",
    "controllers": "--controller",
    "plants": "--plant",
    "robots": "--robot",
    "settings": "--set section.field=value",
    "faults": "what happens in a run: [[fault]] in a scenario's file",
}


def show(only: str | None = None, word: str | None = None) -> None:
    """Print the lists.

    Args:
        only: Title of one of them. [all]
        word: Text that lines must contain, in any case. [all lines]

    Raises:
        OmniError: No line contains the word.
    """
    titles = [only] if only else list(TITLES)
    lists = {title: rows(title) if word is None else _matching(word, rows(title)) for title in titles}
    if not any(lists.values()):
        names = [row[0] for title in titles for row in rows(title)]
        words = {part for name in (*names, *TITLES) for part in (name, *re.findall(r"[a-z]+", name))}
        near = get_close_matches(word or "", sorted(words), n=1)
        hint = f"did you mean {near[0]!r}?" if near else "omni-mj list prints all that there is"
        raise OmniError(f"there is no {word!r} in the {only or 'lists'}; {hint}")
    for title, lines in lists.items():
        if lines:
            print(f"{title} ({TITLES[title]})")
            _print([HEADINGS, *lines] if len(lines[0]) > 2 else lines)
            print()


def rows(title: str) -> list[list[str]]:
    """Return the lines of the list called `title`: a name first, its meaning last."""
    lists: dict[str, Callable[[], list[list[str]]]] = {
        "scenarios": lambda: _descriptions(builtin()),
        "controllers": lambda: [[name, _first_line(where) + _remark(name)] for name, where in CONTROLLERS.items()],
        "plants": lambda: [[name, _first_line(where)] for name, where in PLANTS.items()],
        "robots": lambda: _descriptions(robots.builtin()),
        "settings": settings,
        "faults": faults,
    }
    return lists[title]()


def settings() -> list[list[str]]:
    """Return name, default, unit, range and meaning of every setting."""
    from omni_mj.scenarios.settings import every_setting

    return [_row(declared) for declared in every_setting()]


def faults() -> list[list[str]]:
    """Return the fields of all faults, then each kind of fault and its further fields."""
    from omni_mj.scenarios.faults import KINDS, Fault

    lines = [_row(declared) for declared in Fault.declared().values()]
    for name, kind in KINDS.items():
        plants = f"plants {', '.join(kind.plants)}: " if kind.plants else ""
        lines.append([f"kind = {name}", "", "", "", plants + (kind.__doc__ or "").split("\n")[0]])
        for name, *cells in map(_row, list(kind.declared().values())[len(Fault.model_fields) :]):
            lines.append([f"  {name}", *cells])
    return lines


def short(value: Any) -> str:
    """Return a setting's value as in a scenario file, without the quotes of a string."""
    return value if isinstance(value, str) else json.dumps(value)


def _row(setting: "Setting") -> list[str]:
    default = "" if setting.default is None else short(setting.default)
    return [setting.full, default, setting.unit, setting.allowed, setting.doc]


def _matching(word: str, lines: list[list[str]]) -> list[list[str]]:
    """Return the lines that contain a word, and all that are indented below one that does."""
    matching, is_below = [], False
    for line in lines:
        has_word = any(word.casefold() in cell.casefold() for cell in line)
        is_below = has_word or (is_below and line[0].startswith(" "))
        if is_below:
            matching.append(line)
    return matching


def _print(lines: list[list[str]]) -> None:
    """Print lines in columns, their cells wrapped."""
    from rich.console import Console  # not needed to complete names in a shell
    from rich.padding import Padding
    from rich.table import Table
    from rich.text import Text

    grid = Table.grid(padding=(0, 2))
    for limit in (*WIDTHS[: len(lines[0]) - 1], None):
        grid.add_column(max_width=limit)
    for line in lines:
        grid.add_row(*map(Text, line))
    Console(width=tables.width()).print(Padding(grid, (0, 0, 0, 2)))


def _remark(controller: str) -> str:
    package = missing(controller)
    return f" (needs {package}: pip install 'omni-mj[{controller}]')" if package else ""


def _descriptions(files: Mapping[str, Path]) -> list[list[str]]:
    """Return names and descriptions of TOML files."""
    texts = {name: path.read_text(encoding="utf-8") for name, path in files.items()}
    return [[name, tomllib.loads(text).get("description", "")] for name, text in texts.items()]


def _first_line(where: str) -> str:
    """Return the first line of the docstring of a class named `module:Class`, which is not imported."""
    module, _, name = where.partition(":")
    top, *rest = module.split(".")
    spec = find_spec(top)
    assert spec is not None, "its own package"
    assert spec.submodule_search_locations is not None, "its own package"
    file = Path(spec.submodule_search_locations[0]).joinpath(*rest).with_suffix(".py")
    nodes = ast.parse(file.read_text(encoding="utf-8")).body
    kind = next(node for node in nodes if isinstance(node, ast.ClassDef) and node.name == name)
    return (ast.get_docstring(kind) or "").split("\n", 1)[0]
