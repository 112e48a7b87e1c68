"""The robots that come with the package: a file each, with every number of it and where that comes from."""

from collections.abc import Mapping
from pathlib import Path

from omni_mj.files import shipped


def builtin() -> Mapping[str, Path]:
    """Their files, by name."""
    return shipped(Path(__file__).parent)
