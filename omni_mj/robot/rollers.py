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
- the ripple: the first harmonic of the load over the rollers that pass, at rest that of the springs alone.

Torque and lift are w and w^2 where the wheel turns slowly, and each grows with a power less where it turns fast.

Along the axle a roller spins at v / q as its wheel travels at v, with the distance q from its axis to the contact, its
lowest point. Those that stand turn faster as their wheel does: count I <1 / q^2> of mass along the axle. One that comes
down has nearly come to rest since it stood last, at the rate c / I of its bearing, and takes on the speed of the carpet
within 1 / b, 1.7 ms, at 65 rad/s a quarter of its way over the carpet:

    s' = b (v / q - s)    as long as h > z, whatever presses; the wheel is braked by (I s' + c s) / q

in steps of a cycle, as contacts act on the full plant. On the mean over phi that is v (I X + c Y). Slowly turned, Y is
count <1 / q^2>, and X is w / (p q^2) with the pitch p, an impulse for each roller; both fall behind as it turns faster.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Self

import numpy as np

from omni_control.kinematics import Array
from omni_mj.robot.wheel_loops import CYCLE_S
from omni_mj.scenarios.robot_settings import WheelSettings
from omni_mj.worlds.contact import FRICTION_RATE_HZ, STIFFNESS_N_M

_LOADS_N = 2 ** (np.arange(-20, 41) / 4)  # between which is interpolated, so that no robot depends on another's load
_SPEEDS = 50.0, 100.0  # of a wheel at 1.5 and 3 m/s, rad/s
_DAMPING = 160.0  # N s/m; torque and lift know only its product with the speed
_SAMPLES, _HALVINGS, _PHASES = 1501, 45, 32
_WAVE = np.pi**3 / 2  # waves of `planar_body.wave` whose first harmonic is 1


@dataclass(frozen=True)
class Standing:
    """Wheels that stand under a load, and turn at w.

    Attributes:
        lever: from the axle to where the carpet pulls, m.
        count: of the rollers that touch the carpet, on average.
        spin: mean square of a roller's speed over that of its wheel along the axle, 1/m^2.
        bearing, spin_up, spin_fades: force along the axle over speed, (bearing + spin_up |w|) / (1 + spin_fades |w|)
            N s/m: within 0.5 % up to 100 rad/s.
        cost, cost_fades: of turning, cost w / (1 + cost_fades |w|) N m.
        lift, lift_fades: load of a turning wheel at the height at which it stands, lift w^2 / (1 + lift_fades |w|) N.
        ripple, ripple_grows: of the load at that height as rollers pass, over `planar_body.wave`,
            ripple + ripple_grows |w| N.
    """

    lever: Array
    count: Array
    spin: Array
    bearing: Array
    spin_up: Array
    spin_fades: Array
    cost: Array
    cost_fades: Array
    lift: Array
    lift_fades: Array
    ripple: Array
    ripple_grows: Array

    @classmethod
    def of(cls, wheels: WheelSettings, load: Array, damping: Array, roller: tuple[float, Array]) -> Self:
        """Of wheels; results are (n, W).

        Args:
            wheels: their shape.
            load: of theirs, (n, W) N.
            damping: of carpets, (n, 1) N s/m.
            roller: inertia of one about its axis, kg m^2, and friction of its bearing, (n, 1) N m s/rad.
        """
        (standing, spun), more = _table(wheels), damping / _DAMPING
        at, known = np.log(np.maximum(load, _LOADS_N[0])), np.log(_LOADS_N)
        lever, count, spin, cost, cost_fades, lift, lift_fades, ripple, ripple_grows = (
            np.interp(at, known, row) for row in standing
        )
        turning = more * cost, more * cost_fades, more**2 * lift, more * lift_fades
        bearing, (slow, fast) = roller[1] * count * spin, _SPEEDS
        held, fast_held = (_held([np.interp(at, known, row) for row in rows], *roller) - bearing for rows in spun)
        # Rollers that keep their spin are not spun up again, and the less the faster they turn: then it is constant.
        fades = np.maximum(held / slow - fast_held / fast, 0.0) / np.maximum(fast_held - held, 0.01 * (held + bearing))
        along = bearing, held / slow + fades * (held + bearing), fades
        return cls(lever, count, spin, *along, *turning, ripple, more * ripple_grows)


def _held(rows: Sequence[Array], inertia: float, bearing: Array) -> Array:
    """I X + c Y, N s/m, with what bearings leave of a roller's spin until it comes down again."""
    up, held, less, more, away = rows
    left = np.exp(-bearing / inertia * away)
    return np.asarray(inertia * (up - left * less) + bearing * (held + left * more))


@lru_cache(maxsize=16)
def _table(wheels: WheelSettings) -> tuple[tuple[Array, ...], list[tuple[Array, ...]]]:
    """What `Standing` says at each of the loads, but along the axle; and what `spinning` does, at both speeds."""
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
    spun = [carpet.spinning(carpet.height(loads, speed), speed) for speed in _SPEEDS]
    return (*standing, cost, cost_fades, lift, lift_fades, _WAVE * ripple.real, _WAVE * ripple_grows), spun


class _Carpet:
    """A wheel on it; loads and heights are (k,)."""

    def __init__(self, wheels: WheelSettings) -> None:
        self._outer, self._roller, self._pitch = wheels.radius_m, wheels.roller_radius_m, 2 * np.pi / wheels.rollers
        phi = np.linspace(-np.pi / 2, np.pi / 2, _SAMPLES)
        self._phi, self._below = phi[:, None], self.below(phi)[:, None]
        self._falling = np.gradient(self._below[:, 0], phi)[:, None]
        self._wave = np.exp(1j * wheels.rollers * phi)[:, None]
        self._share = (phi[1] - phi[0]) / self._pitch

    def below(self, phi: Array) -> Array:
        """How far rollers at angles reach below the axle, m."""
        return np.asarray((self._outer - self._roller) * np.cos(phi) + self._along(phi))

    def radius(self, phi: Array, height: Array) -> Array:
        """From the axes of rollers at angles to their contacts, m, with the axle at a height."""
        lowest, depth = self._roller**2 / self._along(phi), self.below(phi) - height
        return np.asarray((lowest - depth / 2) * np.cos(phi))

    def _along(self, phi: Array) -> Array:
        """How far rollers reach below their own middles, m."""
        along: Array = np.sqrt((self._roller * np.cos(phi)) ** 2 + self._outer * self._roller * np.sin(phi) ** 2)
        return along

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
        stands = self._below > height
        return np.asarray((stands / self.radius(self._phi, height) ** 2).sum(0) / stands.sum(0))

    def spinning(self, height: Array, speed: float) -> tuple[Array, ...]:
        """X and Y of rollers that come down at rest, 1/m^2 1/s and 1/m^2.

        Returns:
            Both; what X lacks and Y has more of rollers that come down with the spin with which they left; and for how
            long they are away, s.
        """
        step = speed * CYCLE_S
        first = self._phi[(self._below > height).argmax(0), 0]
        phi = first + np.arange(_PHASES)[:, None] / _PHASES * step
        spin, up, held, less, more = np.zeros((5, *phi.shape))
        kept = np.ones_like(phi)
        while (phi < -first).any():
            stands, radius = self.below(phi) > height, self.radius(phi, height)
            rate = stands * FRICTION_RATE_HZ
            up, held = up + rate * (1 / radius - spin) / radius, held + stands * spin / radius
            less, more = less + rate * kept / radius, more + stands * kept / radius
            spin, kept = spin + CYCLE_S * rate * (1 / radius - spin), kept * (1 - CYCLE_S * rate)
            phi = phi + step
        each, end = step / self._pitch, spin.mean(0)
        away = (2 * np.pi + 2 * first) / speed
        return *(each * sums.mean(0) for sums in (up, held, end * less, end * more)), away

    def ripple(self, height: Array, speed: float) -> np.ndarray:
        """First harmonic of the load as rollers pass at a height, N: real where it is as in a mirror."""
        return np.asarray(2 * self._share * (self.force(height, speed) * self._wave).sum(0))

    def turning(self, loads: Array, height: Array, speed: float) -> tuple[Array, Array]:
        """Torque that turning costs, N m, and what the wheel carries more at a height, N."""
        more = self._share * self.force(height, speed).sum(0) - loads
        return self._share * (self.force(self.height(loads, speed), speed) * self._falling).sum(0), more
