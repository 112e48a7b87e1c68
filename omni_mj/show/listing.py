"""What there is to name: scenarios, controllers, plants, robots, and every setting with unit, default and range."""

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
from omni_mj import robots
from omni_mj.scenarios.library import builtin
from omni_mj.scenarios.plants import PLANTS
from omni_mj.show import terminal

if TYPE_CHECKING:
    from omni_mj.scenarios.checking import Setting

HEADINGS = ["setting", "default", "unit", "allowed", "meaning"]
WIDEST = [None, 20, 10, 24]  # columns of settings, in characters; the meaning has what is left


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
        only: the title of one of them, or None for all.
        word: what must be in a line, of any case, or None for all lines.

    Raises:
        OmniError: the word is in no line.
    """
    found = {title: _with(word, rows(title)) for title in ([only] if only else TITLES)}
    if not any(found.values()):
        raise OmniError(f"there is no {word!r} in the {only or 'lists'}{_like(word or '', only)}")
    for title, lines in found.items():
        if lines:
            print(f"{title} ({TITLES[title]})")
            whole = [HEADINGS, *lines] if len(lines[0]) > 2 else lines
            for line in terminal.wrapped(whole, WIDEST if len(lines[0]) > 2 else [None]):
                print(f"  {line}")
            print()


def rows(title: str) -> list[list[str]]:
    """The lines of the list called `title`: a name first, its meaning last."""
    lists: dict[str, Callable[[], list[list[str]]]] = {
        "scenarios": lambda: _described(builtin()),
        "controllers": _controllers,
        "plants": lambda: [[name, _first_line(where)] for name, where in PLANTS.items()],
        "robots": lambda: _described(robots.builtin()),
        "settings": settings,
        "faults": faults,
    }
    return lists[title]()


def _with(word: str | None, lines: list[list[str]]) -> list[list[str]]:
    """The lines with a word in them; of faults, those of a kind with the word, or below their kind."""
    if word is None:
        return lines
    kept: list[list[str]] = []
    kind: list[str] = []
    for line in lines:
        kind = line if not line[0].startswith(" ") else kind
        below = line is not kind
        if _has(line, word) or (below and _has(kind, word)):
            kept += [kind] if below and kind not in kept else []
            kept.append(line)
    return kept


def _has(line: list[str], word: str) -> bool:
    return any(word.casefold() in cell.casefold() for cell in line)


def _like(word: str, only: str | None) -> str:
    """A question whether another word was meant, of those in the first column."""
    names = [line[0] for title in ([only] if only else TITLES) for line in rows(title)]
    words = {part for name in (*names, *TITLES) for part in (name, *re.findall(r"[a-z]+", name))}
    near = get_close_matches(word.casefold(), sorted(words), n=1)
    return f"; did you mean {near[0]!r}?" if near else "; omni-mj list prints all that there is"


def _controllers() -> list[list[str]]:
    """Names and first lines of the controllers, with a remark on those that cannot be made here."""
    remarks = {
        name: f" (needs {package}: pip install 'omni-mj[{name}]')" for name in CONTROLLERS if (package := missing(name))
    }
    return [[name, _first_line(where) + remarks.get(name, "")] for name, where in CONTROLLERS.items()]


def _described(files: Mapping[str, Path]) -> list[list[str]]:
    """Names and descriptions of TOML files."""
    read = {name: tomllib.loads(path.read_text(encoding="utf-8")) for name, path in files.items()}
    return [[name, data.get("description", "")] for name, data in read.items()]


def settings() -> list[list[str]]:
    """Name, default, unit, range and meaning of every setting."""
    from omni_mj.scenarios.settings import every_setting

    return [_line(declared) for declared in every_setting()]


def faults() -> list[list[str]]:
    """The same of every kind of fault: what all have, then each kind and what it has besides."""
    from omni_mj.scenarios.faults import KINDS, Fault

    common = [each for each in Fault.declared() if each.name != "kind"]
    lines = [_line(each) for each in common]
    for name, kind in KINDS.items():
        plants = f"plants {', '.join(kind.plants)}: " if kind.plants else ""
        lines.append([f"kind = {name}", "", "", "", plants + (kind.__doc__ or "").split("\n")[0]])
        own = kind.declared()[len(Fault.model_fields) :]
        lines += [["  " + line[0], *line[1:]] for line in map(_line, own)]
    return lines


def _line(setting: "Setting") -> list[str]:
    default = "" if setting.default is None else short(setting.default)
    return [setting.full, default, setting.unit, setting.allowed, setting.doc]


def short(value: Any) -> str:
    """A setting's value as in a scenario file, but for the quotes of a string."""
    return value if isinstance(value, str) else json.dumps(value)


def _first_line(where: str) -> str:
    """That of the docstring of a class named `module:Class`, which is not imported."""
    module, _, name = where.partition(":")
    top, *rest = module.split(".")
    spec = find_spec(top)
    assert spec is not None, "its own package"
    assert spec.submodule_search_locations is not None
    file = Path(spec.submodule_search_locations[0]).joinpath(*rest).with_suffix(".py")
    tree = ast.parse(file.read_text(encoding="utf-8"))
    kind = next(node for node in tree.body if isinstance(node, ast.ClassDef) and node.name == name)
    return (ast.get_docstring(kind) or "").split("\n", 1)[0]
