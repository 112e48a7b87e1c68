"""What no robot can be: numbers that contradict each other or physics, a line each."""

import math
from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import Any

from omni_mj.scenarios.clock import CYCLE_RATE_HZ

FULL_CELL_V = 4.2  # of a LiPo cell
GRAVITY_M_S2 = 9.81
ENVELOPE_M = 0.09  # radius that the league's rules allow
HEIGHT_M = 0.15  # and the height
# By which a robot's weight presses rollers into the carpet (omni_mj.worlds.contact, 2.65 kg on 4 wheels), rounded up.
SINKS_M = 7e-5


def depth(radius: float, roller_radius: float, angle: float) -> float:
    """How far a roller reaches below the axle when it is `angle` (rad) away from the bottom, m.

    Rollers are ellipsoids about a chord of the wheel, with half-axes r across and sqrt(R r) along, the barrel whose
    profile has the wheel's radius R of curvature.
    """
    c, s = math.cos(angle), math.sin(angle)
    along = math.sqrt(radius * roller_radius)
    return (radius - roller_radius) * c + math.hypot(roller_radius * c, along * s)


def wheels(given: Any) -> Iterator[str]:
    """Of `WheelSettings`: rollers that fit on a wheel and close it, wheels that are beside each other."""
    radius, roller, count = given.radius_m, given.roller_radius_m, given.rollers
    if 2 * roller >= radius:
        yield (
            f"wheels.roller_radius_m = {roller:g} leaves no room for an axle in a wheel of wheels.radius_m = "
            f"{radius:g}; it must be below half of that"
        )
        return
    # A barrel thins from its middle to its ends, half a pitch away: there its radius is R cos(pi/n) - (R - r).
    needed = math.pi / math.acos(1 - roller / radius)
    if count <= needed:
        yield (
            f"wheels.rollers = {count} of wheels.roller_radius_m = {roller:g} do not close a wheel of "
            f"wheels.radius_m = {radius:g}: their ends do not meet; it takes {math.floor(needed) + 1} at least, or "
            "thicker ones"
        )
    elif given.model == "two-rollers" and radius - depth(radius, roller, math.tau / count) < SINKS_M:
        yield (
            f"wheels.rollers = {count} is too many for wheels.model = two-rollers: with wheels.roller_radius_m = "
            f"{roller:g} more than two of a wheel touch the carpet; take rollers"
        )
    yield from _overlapping(given.azimuths_deg, given.arm_m, radius, roller)


def _overlapping(azimuths: Sequence[float], arm: float, radius: float, roller: float) -> Iterator[str]:
    """Wheels are discs as thick as their rollers; neighbours meet where their inner sides, lines, cross."""
    around = sorted(azimuth % 360 for azimuth in azimuths)
    for one, other in pairwise([*around, around[0] + 360]):
        between = math.radians(other - one) / 2
        if between >= math.pi / 2:
            continue
        if (arm - roller) * math.tan(between) < radius:
            least = f"{roller + radius / math.tan(between):.3g} at least" if between > 0.01 else "none is enough"
            yield (
                f"wheels.azimuths_deg: the wheels at {one:g} and {other % 360:g} deg overlap with wheels.arm_m = "
                f"{arm:g} and wheels.radius_m = {radius:g}; place them apart, or give another arm ({least})"
            )


def support(azimuths: Sequence[float], arm: float, x: float) -> float:
    """How far a point (x, 0) is inside the polygon of the wheels' contacts, m; negative outside."""
    around = sorted(math.radians(azimuth % 360) for azimuth in azimuths)
    inside = math.inf
    for one, other in pairwise([*around, around[0] + math.tau]):
        middle, half = (one + other) / 2, (other - one) / 2
        inside = min(inside, arm * math.cos(half) - x * math.cos(middle))
    return inside


def robot(settings: Any) -> Iterator[str]:
    """Of `Settings`: a body on its wheels, and a battery that gives power."""
    body, placed, battery = settings.body, settings.wheels, settings.battery
    inside = support(placed.azimuths_deg, placed.arm_m, body.centre_x_m)
    if inside <= 0:
        yield (
            f"body.centre_x_m = {body.centre_x_m:g} is {-inside * 1e3:.3g} mm outside the polygon of the wheels' "
            "contacts (wheels.azimuths_deg, wheels.arm_m): the robot would tip over as it stands; it must be inside"
        )
    if body.yaw_inertia_kg_m2 > 2 * body.tilt_inertia_kg_m2:
        yield (
            f"body.yaw_inertia_kg_m2 = {body.yaw_inertia_kg_m2:g} and body.tilt_inertia_kg_m2 = "
            f"{body.tilt_inertia_kg_m2:g} are principal inertias which no body has; the first is twice the second at "
            "most, that of a flat disc"
        )
    across = max(ENVELOPE_M, placed.arm_m + placed.roller_radius_m)
    for name, farthest in (("yaw", across), ("tilt", math.hypot(across, HEIGHT_M))):
        inertia, most = getattr(body, f"{name}_inertia_kg_m2"), body.mass_kg * farthest**2
        if inertia > most:
            yield (
                f"body.{name}_inertia_kg_m2 = {inertia:g} is more than body.mass_kg = {body.mass_kg:g} has if all of "
                f"it is {farthest * 1e3:.0f} mm away, at the robot's edge; at most {most:.3g}"
            )
    motor, counts = settings.motor, settings.sensors.encoder_counts
    fastest, least = motor.no_load_rpm / 60, math.ceil(CYCLE_RATE_HZ / (motor.no_load_rpm / 60))
    if counts < least:
        yield (
            f"sensors.encoder_counts = {counts}: a count in a cycle of 1/{CYCLE_RATE_HZ} s is "
            f"{CYCLE_RATE_HZ / counts:.4g} turns a second, above the {fastest:.4g} of motor.no_load_rpm: no speed of "
            f"the motor could be measured; {least} at least"
        )
    if battery.cut_off_v >= (full := FULL_CELL_V * battery.cells):
        yield (
            f"battery.cut_off_v = {battery.cut_off_v:g} is not below the {full:g} V of battery.cells = {battery.cells} "
            f"when full ({FULL_CELL_V} V a cell): it would never give power"
        )
