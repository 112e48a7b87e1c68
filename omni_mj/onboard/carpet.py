"""What the carpet is like where a wheel is, and in the direction in which it goes."""

from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import NDArray

from omni_control.kinematics import Array
from omni_mj.onboard import arrays, laws
from omni_mj.onboard.arrays import CarpetArrays
from omni_mj.scenarios.robot_settings import CarpetSettings
from omni_mj.scenarios.settings import column

Plane = NDArray[np.complex128]  # vectors of the plane as complex numbers, x first


class Carpet:
    """Carpets of n robots with W wheels, each in a world of its own or sharing one.

    Friction is that of the last patch that covers a wheel's middle, or else the carpet's. Fibres lean: a wheel that
    travels against them is dragged more than one that travels with them. To first order in the lean the drag of the
    pile is p (1 + nap cos(angle between travel and the direction straight against the fibres)).

    Args:
        settings: one per robot.
        wheels: where wheels touch, from the robot's middle, in its frame, (W,) m.
    """

    def __init__(self, settings: Sequence[CarpetSettings], wheels: Plane) -> None:
        self._wheels, self._outward = wheels, wheels / np.abs(wheels)
        self._shape = len(settings), len(wheels)
        self._friction = arrays.filled(column(settings, "friction"), self._shape)
        self._pile, self._nap = column(settings, "pile"), column(settings, "nap")
        self._fibres = np.exp(-1j * np.radians(column(settings, "nap_deg")))
        self._leans = bool(self._nap.any())
        self._patches = np.zeros((max(len(s.patches) for s in settings), 4, len(settings), 1))
        self._patches[:, 2] = -1.0  # a radius within which nothing is
        for robot, each in enumerate(settings):
            if each.patches:
                self._patches[: len(each.patches), :, robot, 0] = each.patches

    def become(self, friction: Array) -> None:
        """From now on have other coefficients of friction, (n, 1), but in the patches."""
        self._friction = arrays.filled(friction, self._shape)

    def reserve(self, patches: int) -> None:
        """Make room for so many patches more, which are nowhere yet."""
        room = np.zeros((patches, *self._patches.shape[1:]))
        room[:, 2] = -1.0
        self._patches, self._own = np.concatenate([self._patches, room]), len(self._patches)

    def cover(self, patches: Iterable[tuple[int, tuple[float, float, float, float]]]) -> None:
        """From now on have these patches over its own, in the room for them: of robots, [x, y, radius, friction]."""
        self._patches[self._own :, 2] = -1.0
        used = np.full(self._patches.shape[2], self._own)
        for robot, patch in patches:
            self._patches[used[robot], :, robot, 0] = patch
            used[robot] += 1

    def arrays(self) -> CarpetArrays:
        """What a compiled loop reads until the carpet changes."""
        patches, robots = self._patches[..., 0], (self._pile[:, 0], self._nap[:, 0], self._fibres[:, 0])
        return CarpetArrays(self._friction.T, patches, *robots)

    def friction(self, place: Plane, heading: Plane) -> Array:
        """Coefficient of friction under each wheel, (n, W).

        Args:
            place: of the robots, (n,) m, world frame.
            heading: unit vectors (n,).
        """
        friction = self._friction
        if len(self._patches):
            at = (place + heading * self._wheels[:, None]).T
            for x, y, radius, other in self._patches:
                friction = np.where(laws.inside(at, x + 1j * y, radius), other, friction)
        return friction

    def pile(self, direction: Plane, heading: Plane) -> Array:
        """Rolling resistance of the pile over load, (n, 1) or (n, W).

        Args:
            direction: in which wheels travel, (n, W) unit vectors, axle first; shorter ones where wheels come to rest.
            heading: of the robots, unit vectors (n,).
        """
        if not self._leans:
            return self._pile
        return laws.leaning(self._pile, self._nap, direction * self._outward, heading[:, None] * self._fibres)
