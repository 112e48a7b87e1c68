"""What logs hold of motors: currents, voltages, and whether they are switched off."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Self

import numpy as np

from omni_control.kinematics import Array

OFF_A = 0.02  # current of motors below which all of them are off


@dataclass(frozen=True)
class Motors:
    """Of one robot's motors, at F lines; what a log lacks is None.

    Attributes:
        current: A, (F, W). voltage: at the terminals, V, (F, W).
        means: whether both are means since the line before, else samples.
        coasting: where none of them carries current, (F,).
    """

    current: Array | None
    voltage: Array | None
    means: bool
    coasting: np.ndarray | None

    @classmethod
    def of(cls, columns: Mapping[str, np.ndarray]) -> Self | None:
        """Of a log's columns; None where they hold nothing of motors."""
        means = "mean_current_1_a" in columns
        current, voltage = (_each(columns, "mean_" * means + name) for name in ("current_{}_a", "voltage_{}_v"))
        coasting: np.ndarray | None = None
        if "coasting" in columns:
            coasting = np.asarray(columns["coasting"].astype(float) > 0.5)
        elif current is not None:
            coasting = np.asarray((np.abs(current) < OFF_A).all(1))
        return (
            None if current is None and voltage is None and coasting is None else cls(current, voltage, means, coasting)
        )


def _each(columns: Mapping[str, np.ndarray], name: str) -> Array | None:
    found = list[np.ndarray]()
    while (title := name.format(len(found) + 1)) in columns:
        found.append(columns[title].astype(float))
    return np.stack(found, 1) if found else None
