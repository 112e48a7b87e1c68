"""Robots outside of this program, in the place of a plant: they are seen and told, and nothing is known of them."""

from collections.abc import Sequence

import numpy as np

from omni_control.errors import OmniError
from omni_control.kinematics import Array, Kinematics
from omni_mj.link.radio import Received
from omni_mj.plants import Telemetry
from omni_mj.scenarios.rows import Row


class LivePlant:
    """Robots outside of this program, which `omni-mj drive` drives; see `Plant`.

    Their poses are what vision says, brought to the tick, or carried on where it sees nothing: nobody knows the truth.

    Args:
        rows: one per robot.
        start: poses at the start, (n, 3).

    Attributes:
        poses: at this tick, (n, 3).

    Raises:
        OmniError: nobody drives them.
    """

    def __init__(self, rows: Sequence[Row], start: Array, *, driven: bool = False) -> None:
        if not driven:
            raise OmniError("robots on the live plant are outside of this program: omni-mj drive drives them")
        self.geometry: Kinematics | None = rows[0].settings.wheels.kinematics
        self.poses: Array = np.array(start, float)
        self._telemetry = Telemetry.of_no_wheels(len(rows), len(self.geometry.azimuths))

    def pose(self) -> Array:
        """See `Plant`, and above."""
        return self.poses

    def twist(self) -> Array:
        """Nothing is known of it."""
        return np.full_like(self.poses, np.nan)

    def advance(self, received: Received) -> dict[int, str]:
        """They go on by themselves."""
        return {}

    def telemetry(self) -> Telemetry:
        """Nothing is known of their wheels."""
        return self._telemetry
