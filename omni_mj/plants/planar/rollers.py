"""What rollers on a carpet that gives way do to a wheel: where it rolls, what that costs, and how it lifts the wheel.

The full plant has all of this from its contacts (`omni_mj.worlds.contact`); here it is what they come to. A roller at
the angle phi from the bottom, a barrel of the radius r and the half length sqrt(R r) on a wheel of the radius R, is as
far below the axle as its support function says,

    h(phi) = (R - r) cos phi + sqrt(r^2 cos^2 phi + R r sin^2 phi).

Robots are too heavy to follow every roller: the axle stays at a height z, and a roller with h > z stands on a spring
and a damper, on which the wheel presses it at the speed w h'(phi) as it turns at w:

    f = max(0, K (h - z) + c w h').

The mean over phi carries the load, which gives z. From the same mean follow

- the radius on which the wheel rolls: a contact acts in the middle of its depth, with the lever (h + z) / 2;
- the torque f h' that turning costs, which the dampers take;
- the lift: contacts press more as rollers come down than they pull as these go up, for they cannot pull. At the height
  at which it stands, a wheel that turns carries more;
- the ripple: the first harmonic of the load over the rollers that pass, at rest that of the springs alone. How the
  robot gives way to it is in `laws`.

Torque and lift are w and w^2 where the wheel turns slowly, and each grows with a power less where it turns fast.

Along the axle a roller spins at v / q as its wheel travels at v, with the distance q from its axis to the contact. Its
bearing brakes it by c v / q, and the wheel by c v / q^2 for each that stands. Until it comes down again it has come to
rest, and is spun up by the impulse I v / q^2, one for each pitch p: together (c count + I |w| / p) v <1 / q^2>. Those
that stand turn faster as their wheel does: count I <1 / q^2> of mass along the axle.
"""

from dataclasses import dataclass
from functools import lru_cache
from typing import Self

import numpy as np

from omni_control.kinematics import Array
from omni_mj.scenarios.robot_settings import WheelSettings
from omni_mj.worlds.contact import STIFFNESS_N_M

_LOADS_N = 2 ** (np.arange(-20, 41) / 4)  # between which is interpolated, so that no robot depends on another's load
_SPEEDS = 50.0, 100.0  # of a wheel at 1.5 and 3 m/s, rad/s
_DAMPING = 160.0  # N s/m; torque and lift know only its product with the speed
_SAMPLES, _HALVINGS = 1501, 45
_WAVE = np.pi**3 / 2  # waves of `laws.passing` whose first harmonic is 1


@dataclass(frozen=True)
class Standing:
    """Wheels that stand under a load, and turn at w.

    Attributes:
        lever: from the axle to where the carpet pulls, m.
        count: of the rollers that touch the carpet, on average.
        spin: mean square of a roller's speed over that of its wheel along the axle, 1/m^2.
        cost, cost_fades: of turning, cost w / (1 + cost_fades |w|) N m.
        lift, lift_fades: load of a turning wheel at the height at which it stands, lift w^2 / (1 + lift_fades |w|) N.
        ripple, ripple_grows: of the load at that height as rollers pass, over `laws.passing`, ripple + ripple_grows |w|
            N.
    """

    lever: Array
    count: Array
    spin: Array
    cost: Array
    cost_fades: Array
    lift: Array
    lift_fades: Array
    ripple: Array
    ripple_grows: Array

    @classmethod
    def of(cls, wheels: WheelSettings, load: Array, damping: Array) -> Self:
        """Of wheels under loads (n, W) in N, on carpets of a damping (n, 1) in N s/m; results are (n, W)."""
        table, more = _table(wheels), damping / _DAMPING
        at = np.log(np.maximum(load, _LOADS_N[0]))
        lever, count, spin, cost, cost_fades, lift, lift_fades, ripple, ripple_grows = (
            np.interp(at, np.log(_LOADS_N), row) for row in table
        )
        turning = more * cost, more * cost_fades, more**2 * lift, more * lift_fades
        return cls(lever, count, spin, *turning, ripple, more * ripple_grows)


@lru_cache(maxsize=16)
def _table(wheels: WheelSettings) -> tuple[Array, ...]:
    """What `Standing` says at each of the loads."""
    carpet, loads = _Carpet(wheels), _LOADS_N
    height, (half, full) = carpet.height(loads, 0.0), _SPEEDS
    (slow, few), (fast, many) = (carpet.turning(loads, height, speed) for speed in _SPEEDS)
    cost_fades = (slow / half - fast / full) / (fast - slow)
    lift_fades = (few / half**2 - many / full**2) / (many / full - few / half)
    cost, lift = slow / half * (1 + half * cost_fades), few / half**2 * (1 + half * lift_fades)
    ripple = carpet.ripple(height, 0.0)
    turning = carpet.ripple(carpet.height(loads, half), half)
    ripple_grows = np.copysign((np.abs(turning) - np.abs(ripple)) / half, ripple.real)
    standing = carpet.lever(height), carpet.count(height), carpet.spin(height)
    return *standing, cost, cost_fades, lift, lift_fades, _WAVE * ripple.real, _WAVE * ripple_grows


class _Carpet:
    """A wheel on it; loads and heights are (k,)."""

    def __init__(self, wheels: WheelSettings) -> None:
        outer, roller, pitch = wheels.radius_m, wheels.roller_radius_m, 2 * np.pi / wheels.rollers
        phi = np.linspace(-np.pi / 2, np.pi / 2, _SAMPLES)
        along = np.sqrt((roller * np.cos(phi)) ** 2 + outer * roller * np.sin(phi) ** 2)
        self._below = ((outer - roller) * np.cos(phi) + along)[:, None]
        self._falling = np.gradient(self._below[:, 0], phi)[:, None]
        self._upright, self._centre = np.cos(phi)[:, None], outer - roller
        self._wave = np.exp(1j * wheels.rollers * phi)[:, None]
        self._share, self._outer = (phi[1] - phi[0]) / pitch, outer

    def force(self, height: Array, speed: float) -> Array:
        """Of a roller at each angle, (angles, k) N."""
        depth = self._below - height
        pressed = STIFFNESS_N_M * depth + _DAMPING * speed * self._falling
        return np.where(depth > 0, np.maximum(pressed, 0.0), 0.0)

    def height(self, loads: Array, speed: float) -> Array:
        """At which the axle is under loads, m, by halving."""
        low, high = np.zeros_like(loads), np.full_like(loads, self._outer)
        for _ in range(_HALVINGS):
            middle = (low + high) / 2
            rises = self._share * self.force(middle, speed).sum(0) > loads
            low, high = np.where(rises, middle, low), np.where(rises, high, middle)
        return low

    def lever(self, height: Array) -> Array:
        """Mean lever of the contacts, by their forces."""
        force = self.force(height, 0.0)
        return np.asarray((force * (self._below + height) / 2).sum(0) / force.sum(0))

    def count(self, height: Array) -> Array:
        """Rollers that touch the carpet."""
        return np.asarray(self._share * (self._below > height).sum(0))

    def spin(self, height: Array) -> Array:
        """Mean over the rollers that touch the carpet of what is one over the square of their radius there, 1/m^2."""
        radius, stands = (self._below + height) / 2 * self._upright - self._centre, self._below > height
        return np.asarray((stands / radius**2).sum(0) / stands.sum(0))

    def ripple(self, height: Array, speed: float) -> np.ndarray:
        """First harmonic of the load as rollers pass at a height, N: real where it is as in a mirror."""
        return np.asarray(2 * self._share * (self.force(height, speed) * self._wave).sum(0))

    def turning(self, loads: Array, height: Array, speed: float) -> tuple[Array, Array]:
        """Torque that turning costs, N m, and what the wheel carries more at a height, N."""
        more = self._share * self.force(height, speed).sum(0) - loads
        return self._share * (self.force(self.height(loads, speed), speed) * self._falling).sum(0), more
