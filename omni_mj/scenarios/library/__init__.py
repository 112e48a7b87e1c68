"""The scenarios that come with the package."""

from collections.abc import Mapping
from functools import cache
from pathlib import Path
from types import MappingProxyType


@cache
def builtin() -> Mapping[str, Path]:
    """Their files, by name."""
    return MappingProxyType({path.stem: path for path in sorted(Path(__file__).parent.glob("*.toml"))})
