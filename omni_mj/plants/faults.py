"""What faults do to robots on wheels: for each kind a function that makes what acts when something changes.

What acts starts anew from the robots as they were built, so that a fault leaves nothing behind, and that a robot's
numbers do not depend on what happens to others of its batch. Pushes, payloads, slopes and biases of several faults add
up, factors multiply, and of several values in place of the scenario's the last in its list counts.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from omni_control.errors import OmniError
from omni_control.kinematics import Array
from omni_mj.link.schedule import Active, Schedule
from omni_mj.onboard.motors import Motors
from omni_mj.onboard.traction import Traction
from omni_mj.scenarios import faults
from omni_mj.scenarios.rows import Row
from omni_mj.scenarios.settings import column

Act = Callable[[Active], None]


class Bodies(Protocol):
    """The bodies of n robots.

    Attributes:
        centre: of mass, to which drag is referred, of what carries a load, with it, (n, 3) m.
    """

    @property
    def centre(self) -> Array:
        """See above."""
        ...

    def carry(self, loads: Iterable[tuple[int, float, float]]) -> None:
        """Carry these loads and no others.

        Args:
            loads: row, mass in kg, and height above the carpet in m, or 0 for that of the chassis' centre of mass.
        """
        ...

    def lean(self, along: Array) -> None:
        """Stand on carpets that lean so that gravity has the parts `along` (n, 2) of itself along them."""
        ...


@dataclass(frozen=True, eq=False)
class Robots:
    """n robots, and what of them faults may change.

    Attributes:
        rows: of the robots, those of one world one after the other.
        bodies: theirs.
        traction, motors: theirs.
        push: forces on the chassis at their centres of mass, world frame, (n, 2) N.
        gyro: what gyros show too much, (n, 1) rad/s.
    """

    rows: Sequence[Row]
    bodies: Bodies
    traction: Traction
    motors: Motors
    push: Array
    gyro: Array


class Faults:
    """Faults of n robots.

    Args:
        rows: of the robots.
        bodies: of the robots.
        traction, motors: of the robots.

    Attributes:
        push, gyro: see `Robots`.

    Raises:
        OmniError: robots that share a world stand on carpets that lean differently.
    """

    def __init__(self, rows: Sequence[Row], bodies: Bodies, traction: Traction, motors: Motors) -> None:
        n = len(rows)
        robots = Robots(rows, bodies, traction, motors, np.zeros((n, 2)), np.zeros((n, 1)))
        self.push, self.gyro = robots.push, robots.gyro
        self._schedule, self._frame = Schedule([row.settings.fault for row in rows], *ACTS), 0
        self._acts = [ACTS[kind](robots) for kind in self._schedule.kinds]

    def begin(self) -> None:
        """Let begin what begins in the next frame, and end what ends."""
        active = self._schedule.at(self._frame)
        self._frame += 1
        if active is not None:
            for act in self._acts:
                act(active)


def _push(robots: Robots) -> Act:
    def act(active: Active) -> None:
        robots.push[:] = 0.0
        for row, push in active.of(faults.Push):
            robots.push[row] += push.force_n * _towards(push.direction_deg)

    return act


def _tilt(robots: Robots) -> Act:
    places, tilts = 1 + max(row.place for row in robots.rows), [_tilts(row) for row in robots.rows]
    if any(tilt != tilts[number - number % places] for number, tilt in enumerate(tilts)):
        raise OmniError("robots that share a world stand on one carpet: their faults must have the same tilts")
    robots.bodies.lean(np.zeros((len(tilts), 2)))

    def act(active: Active) -> None:
        along = np.zeros((len(tilts), 2))
        for row, tilt in active.of(faults.Tilt):
            along[row] += np.sin(np.radians(tilt.angle_deg)) * _towards(tilt.direction_deg)
        robots.bodies.lean(along)

    return act


def _friction(robots: Robots) -> Act:
    usual = column([row.settings.carpet for row in robots.rows], "friction")

    def act(active: Active) -> None:
        friction = usual.copy()
        for row, fault in active.of(faults.Friction):
            friction[row] = fault.to
        robots.traction.carpet.become(friction)

    return act


def _payload(robots: Robots) -> Act:
    bodies = robots.bodies
    shift = robots.traction.centre - bodies.centre

    def act(active: Active) -> None:
        bodies.carry([(row, load.mass_kg, load.height_m) for row, load in active.of(faults.Payload)])
        robots.traction.centre = bodies.centre + shift

    return act


def _weaken(robots: Robots) -> Act:
    def act(active: Active) -> None:
        share = np.ones_like(robots.motors.constant)
        for row, weak in active.of(faults.MotorWeak):
            share[row, weak.wheel - 1] *= weak.to
        robots.motors.weaken(share)

    return act


def _bias(robots: Robots) -> Act:
    def act(active: Active) -> None:
        robots.gyro[:] = 0.0
        for row, bias in active.of(faults.GyroBias):
            robots.gyro[row] += bias.rad_s

    return act


ACTS: dict[type[faults.Fault], Callable[[Robots], Act]] = {
    faults.Push: _push,
    faults.Tilt: _tilt,
    faults.Friction: _friction,
    faults.Payload: _payload,
    faults.MotorWeak: _weaken,
    faults.GyroBias: _bias,
}


def _tilts(row: Row) -> list[faults.Fault]:
    return [fault for fault in row.settings.fault if isinstance(fault, faults.Tilt)]


def _towards(degrees: float) -> Array:
    return np.array([np.cos(np.radians(degrees)), np.sin(np.radians(degrees))])
