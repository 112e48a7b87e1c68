"""Check whether units, axes and wheels of a log are as stated, and estimate the delay.

Displacements over 0.1 s are compared with integrals of the inputs. The share of the motion that
inputs explain is the squared correlation of planar displacements as complex numbers, which does
not depend on the angle between axes; its phase is that angle.
"""

from typing import NamedTuple

import numpy as np
from scipy.interpolate import make_interp_spline
from scipy.optimize import linear_sum_assignment

from omni_control.errors import OmniError
from omni_control.kinematics import Array, Kinematics, world_to_body
from omni_mj.studies.identify.robot_logs import LEAST_LINES, RobotLog, integrate

SHORTEST_S, LONGEST_S = 5e-4, 0.5  # between lines
WINDOW_S, LATEST_S, DELAY_STEP_S, MOST_WINDOWS = 0.1, 0.5, 1 / 120, 2000
MOVES_M_S, TURNS_RAD_S = 0.05, 0.2  # root mean square below which axes are not checked
SIZES = {
    "wheels": (0.5, 2.0),
    "commands": (0.25, 2.5),
}  # of motion over inputs; beyond, units are wrong
FOLLOWS, BETTER = (
    0.3,
    0.1,
)  # share that inputs must explain; by how much a mistake must explain more
TURNED_RAD, DOUBT = 0.5, 0.2  # between axes; share by which axes that are turned so explain less
CORRELATED, SURE, AHEAD = (
    0.6,
    0.8,
    0.1,
)  # of wheels; in another order; by how much that must be better
MOVING = 0.3  # expected speed of a wheel over the fastest's, below which it is not missed


class Match(NamedTuple):
    """How inputs explain a motion at their best delay.

    Attributes:
        share: Mean share of translation and rotation, as far as there is any; else NaN.
        late: The delay, s.
        angle: From inputs to motion, rad; NaN without translation.
        ratios: Motion over inputs of translation and rotation, root mean squares; NaN without any.
    """

    share: float
    late: float
    angle: float
    ratios: tuple[float, float]

    @property
    def score(self) -> float:
        """The share, less if axes are turned."""
        return self.share - DOUBT * (abs(self.angle) > TURNED_RAD)


def wheel_twists(log: RobotLog, geometry: Kinematics) -> Array:
    """Return the body twists (F, 3) that wheels say, by the geometry of the start robot."""
    if (have := log.inputs["wheels"].shape[1]) != (needed := len(geometry.azimuths)):
        raise OmniError(
            f"{log.name}: {have} wheels, but the robot's file has {needed}; name one of {have} by --robot"
        )
    return geometry.body_twist(log.inputs["wheels"])


def starting_delay(log: RobotLog, inputs: Array, source: str, geometry: Kinematics) -> float:
    """Return the delay at which inputs explain the motion best, s.

    Args:
        log: Of the motion.
        inputs: Twists (F, 3) that act until the next line.
        source: wheels or commands.
        geometry: Of the start robot's wheels.

    Raises:
        OmniError: Units, axes, signs or wheels are others than stated, or inputs do not explain the
            motion.
    """
    seen = int(np.isfinite(log.pose).all(1).sum())
    period = float(np.median(np.diff(log.time)))
    if seen < LEAST_LINES:
        raise OmniError(f"{log.name}: {seen} lines with a pose are too few; at least {LEAST_LINES}")
    if not SHORTEST_S <= period <= LONGEST_S:
        raise OmniError(f"{log.name}: {period:g} s from line to line; time_s must be in s")
    by_wheels = source == "wheels"
    in_body = by_wheels or log.in_body
    match = _explain(log.time, log.pose, inputs, in_body, by_wheels)
    if np.isnan(match.share):
        return match.late
    if by_wheels:
        _check_wheels(log, geometry, match.late)
    for verb, ratio in zip(("moves", "turns"), match.ratios, strict=True):
        if not np.isnan(ratio) and not SIZES[source][0] < ratio < SIZES[source][1]:
            gear = ", and wheels behind the gear" * by_wheels
            raise OmniError(
                f"{log.name}: the robot {verb} {ratio:.2g} times as fast as the {source} say; "
                f"are all in m, rad and s{gear}?"
            )
    mirrored, clockwise = "x or y is mirrored, or they are swapped", "headings turn clockwise"
    mistakes = {
        mirrored: ([1, -1, 1], in_body),
        clockwise: ([1, 1, -1], in_body),
        f"{mirrored} and {clockwise}": ([1, -1, -1], in_body),
    }
    if not by_wheels:
        mistakes[f"they are along the {'field' if in_body else 'robot'}'s axes"] = (
            [1, 1, 1],
            not in_body,
        )
    best, mistake = max(
        (_explain(log.time, log.pose * signs, inputs, frame, by_wheels).score, mistake)
        for mistake, (signs, frame) in mistakes.items()
    )
    if best > max(match.score + BETTER, CORRELATED):
        raise OmniError(f"{log.name}: the {source} explain the motion better if {mistake}")
    if match.share < FOLLOWS:
        raise OmniError(
            f"{log.name}: the {source} explain {match.share:.0%} of the motion at any delay up to {LATEST_S:g} s; "
            "are they this robot's?"
        )
    if abs(match.angle) > TURNED_RAD:
        raise OmniError(
            f"{log.name}: motion is turned by {np.degrees(match.angle):.0f} degrees from the {source}; "
            "x is forward, y to the left, heading counter-clockwise"
        )
    return match.late


def _explain(time: Array, pose: Array, inputs: Array, in_body: bool, by_wheels: bool) -> Match:
    """Return how inputs explain poses; by wheels, poses may be late."""
    at, motion = _displacements(time, pose, in_body)
    total = integrate(time, inputs)
    delays = np.arange(-LATEST_S / 2 if by_wheels else 0.0, LATEST_S, DELAY_STEP_S)
    moved = np.stack([motion @ [1, 1j, 0], motion[:, 2]])
    from_at = at - delays[:, None]
    given = total(from_at + WINDOW_S) - total(from_at)
    given = np.stack([given @ [1, 1j, 0], given[..., 2]], axis=1)
    products, powers = np.sum(moved * given.conj(), 2), np.sum(abs(given) ** 2, 2)
    power = np.sum(abs(moved) ** 2, 1)
    moves = powers.mean(0) > len(at) * (WINDOW_S * np.array([MOVES_M_S, TURNS_RAD_S])) ** 2
    if not moves.any():
        return Match(np.nan, 0.0, np.nan, (np.nan, np.nan))
    shares = abs(products) ** 2 / (powers * power + 1e-12)
    shares[:, 1] *= np.sign(products[:, 1].real)
    best = int(abs(shares[:, moves]).mean(1).argmax())
    ratios = np.where(moves, np.sqrt(power / (powers[best] + 1e-12)), np.nan)
    angle = float(np.angle(products[best, 0])) if moves[0] else np.nan
    return Match(
        float(shares[best, moves].mean()),
        float(delays[best]),
        angle,
        (float(ratios[0]), float(ratios[1])),
    )


def _displacements(time: Array, pose: Array, in_body: bool) -> tuple[Array, Array]:
    """Return times and displacements from there on over `WINDOW_S`, (n,) and (n, 3)."""
    seen = np.isfinite(pose).all(1)
    at = np.arange(time[seen][0], time[seen][-1] - WINDOW_S, WINDOW_S / 2)
    at = at[:: 1 + len(at) // MOST_WINDOWS]
    path = make_interp_spline(time[seen], pose[seen], k=1)
    return at, world_to_body(
        path(at + WINDOW_S) - path(at), path(at + WINDOW_S / 2)[:, 2] * in_body
    )


def _check_wheels(log: RobotLog, geometry: Kinematics, late: float) -> None:
    """Raise an error if wheels turn the other way, are in another order, or do not turn."""
    at, motion = _displacements(log.time, log.pose, True)
    expected = geometry.wheel_speeds(motion)
    total = integrate(log.time, log.inputs["wheels"])
    measured = total(at + WINDOW_S - late) - total(at - late)
    count = len(geometry.azimuths)
    with np.errstate(invalid="ignore"):  # of a wheel that stands
        likeness = np.nan_to_num(np.corrcoef(expected.T, measured.T)[:count, count:])
    place = linear_sum_assignment(-abs(likeness))[1]
    best = likeness[np.arange(count), place]
    power = expected.std(0)
    stands = (abs(best) < CORRELATED) & (power > MOVING * power.max())
    elsewhere = (abs(best) > SURE) & (abs(best) - likeness.diagonal() > AHEAD)
    if (stands | elsewhere).any() and (abs(best) > SURE).sum() >= count - 1:
        turn = ", ".join(f"{column:g}" for column in np.sign(best) * (place + 1) * ~stands)
        names = ", ".join(str(i + 1) for i in range(count))
        raise OmniError(
            f"{log.name}: wheels {names} of the robot's file turn as {turn} of the log (-: the other way; "
            "0: as none); order, signs or axes are others than the file's"
        )
