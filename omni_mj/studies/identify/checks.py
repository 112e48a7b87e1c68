"""Checks whether units, axes and wheels of a log are those that its columns say, and a first estimate of the delay."""

from collections.abc import Iterator

import numpy as np
from scipy.optimize import linear_sum_assignment

from omni_control.errors import OmniError
from omni_control.kinematics import Array, world_to_body
from omni_mj.scenarios.settings import Settings
from omni_mj.studies.identify.logs import Log

LEAST_POSES = 30
SHORTEST_S, LONGEST_S, LATEST_S = 5e-4, 0.5, 0.5  # between lines; of a delay
CLOCKS = {"ms": 1e-3, "us": 1e-6, "ns": 1e-9, "minutes": 60.0}
SMOOTHING = np.array([1.0, 2.0, 3.0, 2.0, 1.0]) / 9
MOVES_M_S, TURNS_RAD_S = 0.05, 0.2  # root mean square below which axes are not checked
FOLLOWS, BETTER = 0.3, 0.1  # share of the motion that inputs must explain; by how much a mistake must explain more
SIZES = {"wheels": (0.5, 2.0), "commands": (0.25, 2.5)}  # of motion over inputs, beyond which units are wrong
TURNED_RAD, DEGREES = 0.5, 15  # of motion over inputs, from which axes, and units of headings, are wrong
CORRELATED = 0.6  # of a wheel with its expected motion, or of the motion with inputs
PLACED, AHEAD = 0.9, 0.03  # the same of wheels in another order, and by how much that must be better
MOVING = 0.3  # expected speed of a wheel over the fastest's, below which it is not missed


def units(log: Log) -> None:
    """Raise an error if the numbers of a log cannot be in the units that the names of its columns say.

    Raises:
        OmniError: with the units that they may be in.
    """
    valid = np.isfinite(log.pose).all(1)
    if valid.sum() < LEAST_POSES:
        raise OmniError(f"{log.name}: {valid.sum()} lines with a pose are too few; at least {LEAST_POSES}")
    if not SHORTEST_S <= log.period <= LONGEST_S:
        fits = [unit for unit, size in CLOCKS.items() if SHORTEST_S <= log.period * size <= LONGEST_S]
        unit = " or ".join(fits) or "another unit than s"
        raise OmniError(f"{log.name}: {log.period:g} s from line to line; is time_s in {unit}?")
    moved, step = np.abs(np.diff(log.pose[valid], axis=0)), np.diff(log.time[valid])
    quantities = [
        (moved[:, :2].max(), 100, "jumps of {:.4g} m from line to line; are x_m and y_m in m?"),
        (_most(moved[:, 2] / step), 45, "headings turn at {:.0f} rad/s; is heading_rad in degrees?"),
        (_most(np.hypot(*moved[:, :2].T) / step), 10, "speeds of {:.0f} m/s; are x_m and y_m in cm or mm?"),
    ]
    if log.command is not None:
        _complete(log, log.command, "commands")
        speed, rate = _most(np.hypot(*log.command[:, :2].T)), _most(np.abs(log.command[:, 2]))
        quantities.append((speed, 10, "commands of {:.0f} m/s; are they in cm/s or mm/s?"))
        quantities.append((rate, 60, "turn rates of {:.0f} rad/s; are they in degrees/s?"))
    for value, most, message in quantities:
        if value > most:
            raise OmniError(f"{log.name}: {message.format(value)}")


def wheel_twists(log: Log, settings: Settings) -> Array:
    """Return the body twists (F, 3) that wheels say, by the geometry of the start robot.

    Raises:
        OmniError: these are not wheels of such a robot.
    """
    assert log.wheels is not None
    geometry = settings.wheels.kinematics
    if (have := log.wheels.shape[1]) != (count := len(geometry.azimuths)):
        raise OmniError(f"{log.name}: {have} wheels, but the robot's file has {count}; name one of {have} by --robot")
    _complete(log, log.wheels, "wheels")
    if (rim := _most(np.abs(log.wheels)) * geometry.radius) > 10:
        raise OmniError(f"{log.name}: wheels run at {rim:.0f} m/s; are they in degrees or counts, or before the gear?")
    return geometry.body_twist(log.wheels)


def delay(log: Log, inputs: Array, in_body: bool, source: str, settings: Settings) -> float:
    """Return the delay at which inputs explain the motion best, s.

    Args:
        log: of the motion.
        inputs: twists (F, 3) that act until the next line.
        in_body: whether they are along the body's axes.
        source: wheels or commands.
        settings: of the start robot.

    Raises:
        OmniError: axes, signs or units are others than said, or inputs do not explain the motion.
    """
    earliest = -LATEST_S / 2 if source == "wheels" else 0.0
    delays = np.arange(earliest, LATEST_S, max(log.period / 2, 1 / 120))
    share, late, (gain, turning) = _explained(log.time, log.pose, inputs, in_body, delays)
    if np.isnan(share):
        return late
    if source == "wheels":
        _place_wheels(log, settings, delays)
    best, message = max(
        (_explained(log.time, *mistaken, delays)[0], message)
        for message, mistaken in _mistakes(log.pose, inputs, in_body, source)
    )
    if best > max(share + BETTER, CORRELATED):
        raise OmniError(
            f"{log.name}: {source} explain {100 * max(share, 0):.0f} % of the motion, {100 * best:.0f} % if {message}"
        )
    if share < FOLLOWS:
        raise OmniError(
            f"{log.name}: the {source} explain {100 * max(share, 0):.0f} % of the motion at any delay up to "
            f"{LATEST_S:g} s; are they this robot's?"
        )
    if turning.real > DEGREES:
        raise OmniError(
            f"{log.name}: headings turn {turning.real:.0f} times what the {source} say; are they in degrees?"
        )
    if abs(np.angle(gain)) > TURNED_RAD:
        raise OmniError(
            f"{log.name}: motion is turned by {np.degrees(np.angle(gain)):.0f} degrees from the {source}; "
            "x is forward, y to the left, heading counter-clockwise"
        )
    if not np.isnan(gain) and not SIZES[source][0] < abs(gain) < SIZES[source][1]:
        expected = "wheels behind the gear, in rad, of this radius" if source == "wheels" else "these in m/s"
        raise OmniError(
            f"{log.name}: the robot goes {abs(gain):.2g} times as far as the {source} say; are x_m and y_m in m, and "
            f"are {expected}?"
        )
    return late


def _mistakes(
    pose: Array, inputs: Array, in_body: bool, source: str
) -> Iterator[tuple[str, tuple[Array, Array, bool]]]:
    """Yield what may be wrong, with poses, inputs and frame as they were then."""
    order = "; or are wheels in another order than the file's?" * (source == "wheels")
    yield "x and y are swapped" + order, (pose[:, [1, 0, 2]], inputs, in_body)
    yield "y is mirrored" + order, (pose * [1, -1, 1], inputs, in_body)
    yield "x is mirrored" + order, (pose * [-1, 1, 1], inputs, in_body)
    yield "headings turn the other way; is one clockwise?", (pose * [1, 1, -1], inputs, in_body)
    for turn, degrees in ((1j, 90), (-1, 180), (-1j, -90)):
        planar = inputs @ [1, 1j, 0] * turn
        turned = np.stack([planar.real, planar.imag, inputs[:, 2]], 1)
        yield f"they are turned by {degrees} degrees; x is forward, y to the left", (pose, turned, in_body)
    if source == "commands":
        axes = "field's" if in_body else "robot's"
        yield f"they are along the {axes} axes; name their columns for the {axes} axes", (pose, inputs, not in_body)


def _explained(
    time: Array, pose: Array, inputs: Array, in_body: bool, delays: Array
) -> tuple[float, float, list[complex]]:
    """Return which share of the motion inputs explain at their best delay, that delay, and complex gains.

    The share is the mean of those of translation and rotation, as far as there is any, else not a number. So are the
    gains, motion over inputs, of both.
    """
    valid = np.isfinite(pose).all(1)
    at, pose = time[valid], pose[valid]
    step, middle = np.diff(at)[:, None], (at[1:] + at[:-1]) / 2
    motion = world_to_body(_smooth(np.diff(pose, axis=0) / step), (pose[1:, 2] + pose[:-1, 2]) / 2 * in_body)
    lines = _acting(time, middle - delays[:, None])
    shares, gains = [], []
    parts = ((inputs @ [1, 1j, 0], motion @ [1, 1j, 0], MOVES_M_S), (inputs[:, 2] + 0j, motion[:, 2], TURNS_RAD_S))
    for inputs_of, moved, least in parts:
        u = _smooth(inputs_of[lines].T)  # (F, delays)
        product, power = moved @ u.conj(), (np.abs(u) ** 2).sum(0) + 1e-12
        share = product.real * np.abs(product.real) / power / ((np.abs(moved) ** 2).sum() + 1e-12)
        moves = bool((np.abs(inputs_of) ** 2).mean() > least**2)
        shares += [share] * moves
        gains.append(complex((product / power)[share.argmax()]) if moves else complex("nan"))
    if not shares:
        return float("nan"), 0.0, gains
    mean = np.mean(shares, axis=0)
    return float(mean.max()), float(delays[mean.argmax()]), gains


def _place_wheels(log: Log, settings: Settings, delays: Array) -> None:
    """Raise an error if wheels turn the other way, are in another order, or do not turn, as the motion says."""
    assert log.wheels is not None
    valid = np.isfinite(log.pose).all(1)
    time, pose = log.time[valid], log.pose[valid]
    twist = world_to_body(_smooth(np.gradient(pose, time, axis=0)), pose[:, 2])
    expected = settings.wheels.kinematics.wheel_speeds(twist)
    count, power = expected.shape[1], np.sqrt((expected**2).mean(0))

    def alike(late: float) -> Array:
        """Return the correlations of expected and measured wheels, (W, W)."""
        measured = _smooth(log.wheels[_acting(log.time, time - late)])  # type: ignore[index]
        with np.errstate(invalid="ignore"):  # of a wheel that stands
            return np.nan_to_num(np.corrcoef(expected.T, measured.T)[:count, count:])

    likeness = alike(max(delays, key=lambda late: np.abs(alike(late)).max(1).sum()))
    place = linear_sum_assignment(-np.abs(likeness))[1]
    in_place, best = np.diagonal(likeness), np.abs(likeness[range(count), place])
    moving = power > MOVING * power.max()
    if (best - np.abs(in_place)).max() > AHEAD and best.min() > PLACED:
        order = ", ".join(str(wheel + 1) for wheel in place)
        raise OmniError(
            f"{log.name}: wheels are in another order, {order} by the file's, or the robot's axes are turned"
        )
    stands, inverted = moving & (best < CORRELATED), in_place < -CORRELATED
    for wheels, what in ((stands, "does not turn as the robot moves"), (inverted, "turns the other way")):
        if wheels.any() and (best > CORRELATED).sum() >= count - 1:
            raise OmniError(f"{log.name}: " + ", ".join(f"wheel {i + 1} {what}" for i in np.flatnonzero(wheels)))


def _acting(time: Array, at: Array) -> np.ndarray:
    """Return the lines whose inputs act at these times."""
    return np.clip(np.searchsorted(time, at, side="right") - 1, 0, len(time) - 1)


def _complete(log: Log, values: Array, what: str) -> None:
    if not np.isfinite(values).all():
        raise OmniError(f"{log.name}: {what} are missing in line {np.argmin(np.isfinite(values).all(1)) + 1}")


def _smooth(values: np.ndarray) -> np.ndarray:
    """Smooth along the first axis."""
    padded = np.pad(values, [(2, 2), *[(0, 0)] * (values.ndim - 1)], "edge")
    return sum(weight * padded[i : len(padded) - 4 + i] for i, weight in enumerate(SMOOTHING))


def _most(values: Array) -> float:
    """Return the 95 % quantile: single jumps are no matter of units."""
    return float(np.quantile(values, 0.95))
