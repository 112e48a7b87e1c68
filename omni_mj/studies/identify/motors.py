r"""What currents, voltages and roll-outs tell: motor constants, mass, drag, and the efficiency of the force.

**Voltages and currents** give resistance and torque constant of each motor (`windings`), of which means are told.

**Currents and motion.** Currents give the body the force F_j = k G / radius sum d_ij i_i along its axis j, of which

    F_j - what rotors and wheels take for themselves = m a_j + F_drag,j n_j.

What the right-hand side needs, the acceleration a and the direction n of the motion, is of the law that was fitted to
wheels: it is smooth, while currents, which ring with their loops, are on the left, where noise does no harm to a
regression. The mass m then is what the constant k makes it; drag is of all that brakes a robot that rolls out, gears
and bearings of the wheels with it. Where the robot's mass is that of its file, mass of the file over m is the
efficiency of the force, as TIGERs Mannheim have it.

**Roll-outs.** Where motors carry no current, positions are a parabola from 50 ms after letting go down to 0.1 m/s: its
deceleration, times the mass and rotors, is the drag of the same kind.

Errors are those of Newey and West over half a second; of roll-outs, what they differ by.
"""

from collections.abc import Iterator, Sequence

import numpy as np
from scipy.special import stdtrit

from omni_control.kinematics import Array
from omni_mj.robot.motors import Motor
from omni_mj.scenarios.settings import Settings
from omni_mj.studies.identify import law, windings
from omni_mj.studies.identify.errors import MEMORY_S, regress
from omni_mj.studies.identify.findings import Estimate, Kind, judged
from omni_mj.studies.identify.logs import Log
from omni_mj.studies.identify.motion import Part

NORMAL = 1.96
# Errors of 56 logs over those of residuals within half a second: windings warm more slowly (docs/identify.md).
LASTS = {"resistance_ohm": 4.0, "constant_nm_a": 1.8}
TURNING_RAD_S, MOVING_M_S = 0.5, 0.15  # what is looked at for forces: straight moves, faster than that
LET_GO_S, LEAST_S, SLOW_M_S, ALONG = 0.05, 0.2, 0.1, np.cos(np.radians(20))
STEPS = "moves at several speeds, with the columns of currents and voltages"
ROLLS = "roll-outs from 1 to 1.5 m/s along that axis, four or more (column coasting, or currents)"
KINDS = {
    "resistance_ohm": Kind("resistance of a motor", "ohm", 0, 0.2, "", STEPS, 5e-4),
    "constant_nm_a": Kind("torque constant of a motor", "N m/A", 0, 0.1, "", STEPS, 5e-5),
    "mass_kg": Kind("mass by currents", "kg", 0, 0.2, "", STEPS, 0.0125),
    "efficiency": Kind("efficiency of the force", "", 0, 0.2, "", STEPS, 0.0125),
    "drag_forward_n": Kind("drag of all forward, by currents", "N", 0, 0.3, "", STEPS, 0.03),
    "drag_sideways_n": Kind("drag of all sideways, by currents", "N", 0, 0.3, "", STEPS, 0.03),
    "roll_out_forward_m_s2": Kind("deceleration of roll-outs forward", "m/s^2", 0, 0.3, "", ROLLS),
    "roll_out_sideways_m_s2": Kind("deceleration of roll-outs sideways", "m/s^2", 0, 0.3, "", ROLLS),
}


def by_motors(logs: Sequence[Log], settings: Settings, rolled: Part | None) -> tuple[list[Estimate], list[str]]:
    """Numbers that logs with columns of motors tell, and which motors are not as the others.

    Args:
        logs: all there are.
        settings: of the start robot.
        rolled: the fit to wheels; None where there is none.
    """
    constant, estimates, odd = settings.motor.constant_nm_a, list[Estimate](), list[str]()
    those = [log for log in logs if log.wheels is not None and log.motors is not None]
    electric = [
        log for log in those if log.motors and log.motors.current is not None and log.motors.voltage is not None
    ]
    if electric:
        each = windings.windings(electric, settings)
        odd += windings.odd(each)
        for name in ("resistance_ohm", "constant_nm_a"):
            number = name.split("_")[0]
            # What is wrong of one motor's lines is of all alike: the error of their mean is that of one.
            value, error = (float(np.mean([getattr(one, number + of) for one in each])) for of in ("", "_error"))
            estimates.append(judged(name, KINDS[name], "motors", value, LASTS[name] * error, NORMAL))
        constant = estimates[-1].value if estimates[-1].told else constant
    if rolled is not None and any(log.motors and log.motors.current is not None for log in those):
        estimates += _forces([log for log in logs if log.wheels is not None], settings, rolled, constant)
    estimates += _roll_outs([log for log in logs if log.motors and log.motors.coasting is not None])
    return estimates, odd


def _forces(logs: Sequence[Log], settings: Settings, rolled: Part, constant: float) -> Iterator[Estimate]:
    """Mass and drag by currents and the motion that was fitted to wheels."""
    body, motor, gear = law.Body.of(settings), Motor.of(settings.motor), settings.motor.gear
    ring = settings.wheels.rollers * law.ROLLER_KG * (1 - settings.wheels.roller_radius_m / body.radius) ** 2
    rotor = motor.inertia * gear**2 / body.radius**2 + ring
    currents = np.concatenate([_at_lines(log, len(body.wheels)) for log in logs])
    segments = rolled.segments
    faster = np.concatenate([_gained(log) for log in logs]) * body.radius  # of rims, m/s^2
    twist, time, there = rolled.fitted.twist, segments.time, segments.there
    step = np.maximum(time[:, 2:] - time[:, :-2], 1e-9)[..., None]
    gained = (twist[:, 2:] - twist[:, :-2]) / step
    middle, lines = twist[:, 1:-1], segments.lines[:, 1:-1]
    plane = gained[..., 0] + 1j * gained[..., 1] + 1j * middle[..., 2] * (middle[..., 0] + 1j * middle[..., 1])
    pull = constant * gear / body.radius * currents[lines] - rotor * faster[lines]  # of each rim, (S, m, W)
    usable = there[:, 2:] & there[:, 1:-1] & there[:, :-2] & (np.abs(middle[..., 2]) < TURNING_RAD_S)
    speed = np.hypot(middle[..., 0], middle[..., 1])
    usable &= (speed > MOVING_M_S) & np.isfinite(pull).all(-1)
    rows, forces = list[Array](), list[Array]()
    for stretch in np.flatnonzero(usable.any(1)):
        ok = usable[stretch]
        for axis, acceleration in enumerate((plane.real, plane.imag)):
            directions = body.wheels[:, axis]
            along = middle[stretch, ok, axis] / speed[stretch, ok]
            row = np.zeros((int(ok.sum()), 1, 3))
            row[:, 0, 0], row[:, 0, 1 + axis] = acceleration[stretch, ok], along
            rows.append(row)
            forces.append((pull[stretch, ok] * directions).sum(-1)[:, None])
    if not rows:
        return
    lag = max(1, round(MEMORY_S / segments.period))
    value, error = regress(rows, forces, [lag] * len(rows))
    for name, v, e in zip(("mass_kg", "drag_forward_n", "drag_sideways_n"), value, error, strict=True):
        yield judged(name, KINDS[name], "motors", float(v), float(e), NORMAL)
    efficiency, relative = settings.body.mass_kg / value[0], error[0] / value[0]
    yield judged("efficiency", KINDS["efficiency"], "motors", float(efficiency), float(efficiency * relative), NORMAL)


def _at_lines(log: Log, wheels: int) -> Array:
    """Currents (F, W) at the lines of a log; not a number where there are none."""
    if log.motors is None or log.motors.current is None:
        return np.full((len(log.time), wheels), np.nan)
    current = log.motors.current
    if not log.motors.means:
        return current
    return np.concatenate([(current[1:] + current[:-1]) / 2, current[-1:]])


def _gained(log: Log) -> Array:
    """Accelerations of wheels (F, W) at the lines of a log, rad/s^2."""
    assert log.wheels is not None
    gained = np.diff(log.wheels, axis=0) / np.diff(log.time)[:, None]
    return np.concatenate([gained[:1], gained])


def _roll_outs(logs: Sequence[Log]) -> Iterator[Estimate]:
    """Deceleration along each axis where motors carry no current."""
    found: dict[int, list[float]] = {0: [], 1: []}
    for log in logs:
        assert log.motors is not None
        assert log.motors.coasting is not None
        edges = np.flatnonzero(np.diff(np.concatenate([[0], log.motors.coasting.astype(int), [0]])))
        for begin, end in edges.reshape(-1, 2):
            rolled = _roll_out(log, begin, end)
            if rolled is not None:
                found[rolled[0]].append(rolled[1])
    for axis, name in enumerate(("roll_out_forward_m_s2", "roll_out_sideways_m_s2")):
        if len(values := found[axis]) >= 2:
            error = float(np.std(values, ddof=1) / np.sqrt(len(values)))
            yield judged(
                name, KINDS[name], "motors", float(np.mean(values)), error, float(stdtrit(len(values) - 1, 0.975))
            )


def _roll_out(log: Log, begin: int, end: int) -> tuple[int, float] | None:
    """Axis and deceleration of one roll-out; None where it is too short, too slow, or along neither axis."""
    time, pose = log.time[begin:end], log.pose[begin:end]
    seen = np.isfinite(pose).all(1) & (time >= time[0] + LET_GO_S)
    time, pose = time[seen], pose[seen]
    if len(time) < 6:
        return None
    place = pose[:, 0] + 1j * pose[:, 1]
    steps = np.abs(np.diff(place)) / np.diff(time)
    slow = np.flatnonzero(np.convolve(steps, np.ones(3) / 3, "same") < SLOW_M_S)
    count = slow[0] if slow.size else len(time)
    time, place, heading = time[:count], place[:count], pose[:count, 2]
    if count < 6 or time[-1] - time[0] < LEAST_S:
        return None
    way = (place - place[0]) * np.exp(-1j * heading.mean())
    direction = way[-1] / max(abs(way[-1]), 1e-9)
    axis = int(abs(direction.imag) > abs(direction.real))
    if max(abs(direction.real), abs(direction.imag)) < ALONG:
        return None
    t = time - time[0]
    columns = np.stack([np.ones_like(t), t, -(t**2) / 2], 1)
    return axis, float(np.linalg.lstsq(columns, (way * direction.conjugate()).real, rcond=None)[0][2])
