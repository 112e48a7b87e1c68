"""The scenarios that come with the package."""

from collections.abc import Mapping
from pathlib import Path

from omni_mj.files import shipped


def builtin() -> Mapping[str, Path]:
    """Their files, by name."""
    return shipped(Path(__file__).parent)
