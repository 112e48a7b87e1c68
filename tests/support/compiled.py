"""What tests set that need no particular kernel: that of short runs."""

from collections.abc import Iterable

from omni_mj.scenarios.settings import Settings

NUMBA = {"kernel": "numpy"}


def once(plant: str) -> None:
    """Nothing is to be compiled."""


def ready(plant: str, settings: Iterable[Settings]) -> None:
    """Nothing is to be compiled."""
