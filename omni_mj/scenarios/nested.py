"""Values in sections: laid over others, and made plain for TOML and JSON."""

from collections.abc import Mapping
from typing import Any

from omni_mj.scenarios.checking import Checked


def merged(sections: Mapping[str, Any], changes: Mapping[str, Any]) -> dict[str, Any]:
    """`sections` with `changes`, of which a mapping replaces some values of a section, and anything else all of it."""
    return {**sections, **{name: _overlaid(sections.get(name, {}), given) for name, given in changes.items()}}


def _overlaid(section: Any, given: Any) -> Any:
    both = isinstance(section, (Mapping, Checked)) and isinstance(given, Mapping)
    return merged(dict(section), given) if both else given


def plain(value: Any) -> Any:
    """Lists and dictionaries in place of what cannot be changed."""
    if isinstance(value, Mapping):
        return {key: plain(each) for key, each in value.items()}
    return [plain(each) for each in value] if isinstance(value, tuple) else value


def frozen(value: Any) -> Any:
    """Tuples in place of lists."""
    return tuple(frozen(each) for each in value) if isinstance(value, list) else value
