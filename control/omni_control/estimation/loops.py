"""Identification and prediction of robots by compiled loops over them, in place of numpy with all at once."""

from collections.abc import Callable
from typing import Any

import numpy as np

from omni_control.delay import CommandsInFlight
from omni_control.estimation import by_robot
from omni_control.estimation.arrays import GivesArrays, LateArrays
from omni_control.estimation.identify import Identifier
from omni_control.estimation.late import Late
from omni_control.estimation.motion import Plane
from omni_control.estimation.predict_by_robot import predict
from omni_control.estimation.turning import Turning
from omni_control.kinematics import Array

Compile = Callable[[Callable[..., Any]], Callable[..., Any]]


class Loops:
    """What takes in frames of n robots, and predicts them; see `Identifying`, which does the same without.

    Args:
        turning: how they turn, as known at the start; only this changes it from then on.
        plant: where they are and their law, same.
        gives: how their wheels give way.
        compiled: what makes machine code of a loop, with all that it calls.

    Attributes:
        arrays: of these, for loops of the same kind.
    """

    def __init__(self, turning: Turning, plant: Identifier, gives: GivesArrays, compiled: Compile) -> None:
        self._plant, self.arrays = plant, (turning.arrays, plant.arrays, gives)
        self._identify, self._predict = compiled(by_robot.identify), compiled(predict)
        n = len(plant.position)
        self._unseen = np.full((n, 3), np.nan)
        self._prompt = LateArrays(np.zeros(n), np.zeros(n, bool), np.zeros(n))

    def identify(self, measured: Array | None, sent: CommandsInFlight, late: Late | None) -> None:
        """Take in a frame, of which vision reports poses (n, 3); none on the way to that."""
        reported, commands = measured is not None, sent.last(sent.length).copy()
        seen = self._unseen if measured is None else measured
        self._identify(*self.arrays, self._late(late), self._plant.frames, reported, seen, commands)
        self._plant.took(reported)

    def predict(self, sent: CommandsInFlight, late: Late | None) -> tuple[Plane, Plane, Array]:
        """Positions, velocities and headings (n,) to which the commands lead that are still to act."""
        n = len(self._unseen)
        position, velocity, heading = np.empty(n, complex), np.empty(n, complex), np.empty(n)
        commands = sent.last(sent.length).copy()
        self._predict(*self.arrays, self._late(late), commands, position, velocity, heading)
        return position, velocity, heading

    def _late(self, late: Late | None) -> LateArrays:
        return self._prompt if late is None else LateArrays(*late)
