"""What rollers on a carpet that gives way do to a wheel: where it rolls, what that costs, and how it lifts the wheel.

The full plant has all of this from its contacts (`omni_mj.worlds.contact`); here it is what they come to. A roller at
the angle phi from the bottom, a barrel of the radius r and the half length sqrt(R r) on a wheel of the radius R, is as
far below the axle as its support function says,

    h(phi) = (R - r) cos phi + sqrt(r^2 cos^2 phi + R r sin^2 phi).

Robots are too heavy to follow every roller: the axle stays at a height z, and a roller with h > z stands on a spring and
a damper, on which the wheel presses it at the speed w h'(phi) as it turns at w:

    f = max(0, K (h - z) + c w h').

The mean over phi carries the load, which gives z. From the same mean follow

- the radius on which the wheel rolls: a contact acts in the middle of its depth, with the lever (h + z) / 2;
- the torque f h' that turning costs, which the dampers take;
- the lift: contacts press more as rollers come down than they pull as these go up, for they cannot pull. At the height
  at which it stands, a wheel that turns carries more.

Torque and lift are w and w^2 where the wheel turns slowly, and each grows with a power less where it turns fast. Along
the axle a roller spins at v / r as its wheel travels at v. Its bearing brakes it by c v / r, and the wheel by c v / r^2
for each that stands. Until it comes down again it has come to rest, and is spun up by the impulse I v / r^2, one for
each pitch p: together (c count + I |w| / p) v / r^2.
"""

from dataclasses import dataclass
from typing import Self

import numpy as np

from omni_control.kinematics import Array
from omni_mj.scenarios.robot_settings import WheelSettings
from omni_mj.worlds.contact import STIFFNESS_N_M

_SAMPLES = 4001
_HALVINGS = 60
_SPEEDS_RAD_S = 50.0, 100.0  # that of a wheel at 1.5 and 3 m/s


@dataclass(frozen=True)
class Standing:
    """Wheels that stand under a load, and turn at |w| rad/s.

    Attributes:
        lever: from the axle to where the carpet pulls, m.
        count: of the rollers that touch the carpet, on average.
        cost, cost_fades: of turning, cost |w| / (1 + cost_fades |w|) N m.
        lift, lift_fades: load of a turning wheel at the height at which it stands, lift w^2 / (1 + lift_fades |w|) N.
    """

    lever: Array
    count: Array
    cost: Array
    cost_fades: Array
    lift: Array
    lift_fades: Array

    @classmethod
    def of(cls, wheels: WheelSettings, load: Array, damping: float) -> Self:
        """Of wheels under loads (any shape) in N, on carpet of a damping in N s/m; results have that shape."""
        loads, which = np.unique(load, return_inverse=True)
        carpet = _Carpet(wheels, damping)
        height = carpet.height(loads)
        lever, count = carpet.lever(height), carpet.count(height)
        (slow, fast), (few, many) = np.array([carpet.turning(loads, height, speed) for speed in _SPEEDS_RAD_S]).swapaxes(0, 1)
        half, full = _SPEEDS_RAD_S
        cost_fades = (slow / half - fast / full) / (fast - slow)
        lift_fades = (few / half**2 - many / full**2) / (many / full - few / half)
        found = (
            lever, count, slow / half * (1 + half * cost_fades), cost_fades,
            few / half**2 * (1 + half * lift_fades), lift_fades,
        )  # fmt: skip
        return cls(*(values[which].reshape(load.shape) for values in found))


class _Carpet:
    """A wheel over it; arrays of heights or loads are (k,)."""

    def __init__(self, wheels: WheelSettings, damping: float) -> None:
        outer, roller, pitch = wheels.radius_m, wheels.roller_radius_m, 2 * np.pi / wheels.rollers
        phi = np.linspace(-np.pi / 2, np.pi / 2, _SAMPLES)
        along = np.sqrt((roller * np.cos(phi)) ** 2 + outer * roller * np.sin(phi) ** 2)
        self._below = ((outer - roller) * np.cos(phi) + along)[:, None]
        self._falling = np.gradient(self._below[:, 0], phi)[:, None]
        self._share, self._damping, self._outer = (phi[1] - phi[0]) / pitch, damping, outer

    def force(self, height: Array, speed: float = 0.0) -> Array:
        """Of the roller at each angle, (angles, k) N."""
        depth = self._below - height
        pressed = STIFFNESS_N_M * depth + self._damping * speed * self._falling
        return np.where(depth > 0, np.maximum(pressed, 0.0), 0.0)

    def height(self, loads: Array, speed: float = 0.0) -> Array:
        """At which the axle stands under loads, by halving."""
        low, high = np.zeros_like(loads), np.full_like(loads, self._outer)
        for _ in range(_HALVINGS):
            middle = (low + high) / 2
            rises = self._share * self.force(middle, speed).sum(0) > loads
            low, high = np.where(rises, middle, low), np.where(rises, high, middle)
        return low

    def lever(self, height: Array) -> Array:
        """Mean lever of the contacts, by their forces."""
        force = self.force(height)
        lever: Array = (force * (self._below + height) / 2).sum(0) / force.sum(0)
        return lever

    def count(self, height: Array) -> Array:
        """Rollers that touch the carpet."""
        count: Array = self._share * (self._below > height).sum(0)
        return count

    def turning(self, loads: Array, height: Array, speed: float) -> tuple[Array, Array]:
        """Torque that turning costs, N m, and what the wheel carries more at the height at which it stands, N."""
        carried = self._share * self.force(height, speed).sum(0)
        torque = self._share * (self.force(self.height(loads, speed), speed) * self._falling).sum(0)
        return torque, carried - loads
