"""What the world does to robots: it pushes, loads and moves them, and the carpet changes."""

from collections.abc import Sequence

import numpy as np

from omni_control.errors import OmniError
from omni_control.kinematics import Array
from omni_mj.link.schedule import Active
from omni_mj.plants.faults.robots import Act, Robots
from omni_mj.scenarios import faults
from omni_mj.scenarios.rows import Row
from omni_mj.scenarios.settings import column


def push(robots: Robots) -> Act:
    """Forces on the chassis."""

    def act(active: Active) -> None:
        robots.push[:] = 0.0
        for row, push in active.of(faults.Push):
            robots.push[row] += push.force_n * _towards(push.direction_deg)

    return act


def check_carpet(rows: Sequence[Row]) -> None:
    """See that robots of a world can stand on one carpet.

    Raises:
        OmniError: those of some tilt when those of others do not.
    """
    tilts = [[fault for fault in row.faults if isinstance(fault, faults.Tilt)] for row in rows]
    if any(each != tilts[0] for each in tilts):
        raise OmniError("robots that share a world stand on one carpet: their faults must have the same tilts")


def tilt(robots: Robots) -> Act:
    """Carpets that lean."""
    n, places = len(robots.rows), 1 + max(row.place for row in robots.rows)
    for first in range(0, n, places):
        check_carpet(robots.rows[first : first + places])
    robots.bodies.lean(np.zeros((n, 2)))

    def act(active: Active) -> None:
        along = np.zeros((n, 2))
        for row, tilt in active.of(faults.Tilt):
            along[row] += np.sin(np.radians(tilt.angle_deg)) * _towards(tilt.direction_deg)
        robots.bodies.lean(along)

    return act


def friction(robots: Robots) -> Act:
    """Other carpets, but for patches."""
    usual = column([row.settings.carpet for row in robots.rows], "friction")

    def act(active: Active) -> None:
        friction = usual.copy()
        for row, fault in active.of(faults.Friction):
            friction[row] = fault.to
        robots.traction.carpet.become(friction)

    return act


def payload(robots: Robots) -> Act:
    """Loads on the chassis."""
    bodies = robots.bodies
    shift = robots.traction.centre - bodies.centre

    def act(active: Active) -> None:
        bodies.carry([(row, load.mass_kg, load.height_m) for row, load in active.of(faults.Payload)])
        robots.traction.centre = bodies.centre + shift

    return act


def patch(robots: Robots) -> Act:
    """Patches of another friction, over those of the carpet."""
    kinds = [[fault for fault in row.faults if isinstance(fault, faults.FrictionPatch)] for row in robots.rows]
    robots.traction.carpet.reserve(max(map(len, kinds)))

    def act(active: Active) -> None:
        found = active.of(faults.FrictionPatch)
        robots.traction.carpet.cover((row, (each.x_m, each.y_m, each.radius_m, each.to)) for row, each in found)

    return act


def kidnap(robots: Robots) -> Act:
    """Hands that put robots elsewhere, when they do."""

    def act(active: Active) -> None:
        for row, hand in active.begun(faults.Kidnap):
            robots.bodies.put(row, hand.moved)

    return act


def _towards(degrees: float) -> Array:
    return np.array([np.cos(np.radians(degrees)), np.sin(np.radians(degrees))])
