"""Check units, axes, signs and wheel order of a log, and estimate the delay of its inputs.

Displacements over 0.1 s are compared with integrals of the inputs. The squared correlation between
them is the explained part of the motion. Displacements in the plane are correlated as complex
numbers. The magnitude of this correlation does not depend on the angle between the axes of inputs
and motion. Its phase is that angle.
"""

from typing import NamedTuple, Self

import numpy as np
from scipy.interpolate import make_interp_spline
from scipy.optimize import linear_sum_assignment

from omni_control.errors import OmniError
from omni_control.kinematics import Array, Kinematics, world_to_body
from omni_mj.studies.identify.robot_logs import (
    MAX_GAP_PERIODS,
    MIN_LINES,
    RobotLog,
    has_pose,
    integrate_windows,
)

WINDOW_S = 0.1  # duration of a displacement
MAX_WINDOWS = 2000  # number of displacements
MAX_DELAY_S, DELAY_STEP_S = 0.5, 1 / 120  # candidates of the delay
MIN_RMS_M_S, MIN_RMS_RAD_S = 0.05, 0.2  # slower motion is not checked
# Range of the ratio of motion to inputs. If the ratio is outside, units are wrong.
VALID_RATIOS = {"wheels": (0.5, 2.0), "commands": (0.25, 2.5)}
MIN_EXPLAINED = 0.3  # smallest valid explained part
SURE_EXPLAINED = 0.9  # larger parts prove that signs and order of wheels are right
# A mistake is reported if it raises the score by this advantage, and to at least this value.
MISTAKE_ADVANTAGE, MISTAKE_EXPLAINED = 0.1, 0.6
MAX_ANGLE_RAD = 0.5  # largest valid angle between the axes of inputs and motion
ANGLE_PENALTY = 0.2  # subtracted from the score if the angle is larger
# Correlations of a wheel's expected speed with the measured speeds in the log
MIN_CORRELATION = 0.6  # if all are lower, the wheel does not turn
HIGH_CORRELATION = 0.8  # reached by another wheel's column if columns are in the wrong order
ORDER_ADVANTAGE = 0.1  # of that column over the wheel's own
TIE = 0.02  # difference of correlations that tells nothing
MAX_LOG_SPEED_RATIO = 0.4  # of a wheel's speed to that of the others, relative to the motion
MIN_SPEED_RATIO = 0.3  # below this fraction of the fastest expected speed, a wheel may stand still


# Candidates of the delay of each source; the clock of encoders may be ahead of that of poses
DELAYS_S = {
    "wheels": np.arange(-MAX_DELAY_S / 2, MAX_DELAY_S, DELAY_STEP_S),
    "commands": np.arange(0.0, MAX_DELAY_S, DELAY_STEP_S),
}


class LoggedMotion(NamedTuple):
    """Poses of a robot, and its twists by one source of inputs, in F lines of a log.

    Attributes:
        source: "wheels" or "commands".
        time: Times of the lines, (F,) s.
        pose: Measured poses, world frame, (F, 3).
        twist: Twists that act until the next line, (F, 3).
        in_body: Whether the twists are in the body frame.
    """

    source: str
    time: Array
    pose: Array
    twist: Array
    in_body: bool

    @classmethod
    def from_log(cls, log: RobotLog, source: str, geometry: Kinematics) -> Self:
        """Return the motion in a log, with the wheels of the start robot.

        Raises:
            OmniError: The log has another number of wheels.
        """
        inputs = log.inputs[source]
        if source == "commands":
            return cls(source, log.time, log.pose, inputs, log.in_body)
        n_logged, n_wheels = inputs.shape[1], len(geometry.azimuths)
        if n_logged != n_wheels:
            raise OmniError(
                f"{log.name}: {n_logged} wheels, but the robot's file has {n_wheels}; "
                f"name one with {n_logged} by --robot"
            )
        return cls(source, log.time, log.pose, geometry.body_twist(inputs), True)


class Match(NamedTuple):
    """Agreement between inputs and motion at their best delay.

    Attributes:
        explained: Mean explained part of translation and rotation, or that of the only one that is
            present; NaN without motion.
        delay: Delay at which the inputs explain most of the motion, s.
        angle: Angle from the axes of inputs to those of motion, rad; NaN without translation.
        ratios: Root mean square of motion over that of inputs, for translation and rotation; NaN
            for one that is absent.
    """

    explained: float
    delay: float
    angle: float
    ratios: tuple[float, float]

    @property
    def score(self) -> float:
        """The explained part, minus a penalty if the axes are rotated."""
        return self.explained - ANGLE_PENALTY * (abs(self.angle) > MAX_ANGLE_RAD)


def check_and_estimate_delay(log: RobotLog, motion: LoggedMotion, geometry: Kinematics) -> float:
    """Check a log, and return the delay at which its inputs explain the motion best, s.

    Args:
        log: The log.
        motion: Its motion by one source.
        geometry: Wheels of the start robot.

    Raises:
        OmniError: Units, axes, signs or wheels are not as stated, or the inputs do not explain the
            motion.
    """
    n_poses = has_pose(log.pose).sum()
    if n_poses < MIN_LINES:
        raise OmniError(
            f"{log.name}: {n_poses} lines with a pose are too few; at least {MIN_LINES}"
        )
    match, source = match_motion(motion), motion.source
    is_rotated = abs(match.angle) > MAX_ANGLE_RAD
    if source == "wheels" and not (is_rotated and match.explained > SURE_EXPLAINED):
        _check_wheels(log, motion, geometry)
    if np.isnan(match.explained):
        return match.delay
    _check_units(log, match, source)
    _check_axes(log, motion, match)
    if match.explained < MIN_EXPLAINED:
        raise OmniError(
            f"{log.name}: the {source} explain {match.explained:.0%} of the motion at any delay "
            f"up to {MAX_DELAY_S:g} s; are they this robot's?"
        )
    if is_rotated:
        raise OmniError(
            f"{log.name}: the motion is rotated by {np.degrees(match.angle):.0f} degrees from the "
            f"{source}; x must be forward, y to the left, heading counter-clockwise"
        )
    return match.delay


def _check_units(log: RobotLog, match: Match, source: str) -> None:
    """Raise OmniError if the ratio of motion to inputs shows wrong units."""
    low, high = VALID_RATIOS[source]
    for verb, ratio in zip(("moves", "turns"), match.ratios, strict=True):
        if not np.isnan(ratio) and not low < ratio < high:
            gear = ", and wheels behind the gear" if source == "wheels" else ""
            raise OmniError(
                f"{log.name}: the robot {verb} {ratio:.2g} times as fast as the {source} say; "
                f"are all columns in m, rad and s{gear}?"
            )


def _check_axes(log: RobotLog, motion: LoggedMotion, match: Match) -> None:
    """Raise OmniError if the inputs explain the motion better with other axes or signs."""
    source, in_body = motion.source, motion.in_body
    mirrored, clockwise = "x or y is mirrored, or they are swapped", "headings turn clockwise"
    mistakes = {
        mirrored: ([1, -1, 1], in_body),
        clockwise: ([1, 1, -1], in_body),
        f"{mirrored} and {clockwise}": ([1, -1, -1], in_body),
    }
    if source == "commands":
        axes = "field" if in_body else "robot"
        mistakes[f"commands are along the {axes}'s axes"] = ([1, 1, 1], not in_body)
    best, mistake = max(
        (match_motion(motion._replace(pose=log.pose * signs, in_body=frame)).score, mistake)
        for mistake, (signs, frame) in mistakes.items()
    )
    if best > max(match.score + MISTAKE_ADVANTAGE, MISTAKE_EXPLAINED):
        raise OmniError(f"{log.name}: the {source} explain the motion better if {mistake}")


def match_motion(motion: LoggedMotion) -> Match:
    """Return the agreement between inputs and poses at the best delay."""
    start, displacements = compute_displacements(motion)
    delays = DELAYS_S[motion.source]
    integrals = integrate_windows(motion.time, motion.twist, start - delays[:, None], WINDOW_S)
    measured, expected = to_complex(displacements), to_complex(integrals)
    products = np.sum(measured * expected.conj(), 2)
    expected_power = np.sum(abs(expected) ** 2, 2)
    power = np.sum(abs(measured) ** 2, 1)
    min_rms = WINDOW_S * np.array([MIN_RMS_M_S, MIN_RMS_RAD_S])
    is_present = expected_power.mean(0) > len(start) * min_rms**2
    if not is_present.any():
        return Match(np.nan, 0.0, np.nan, (np.nan, np.nan))
    explained = abs(products) ** 2 / (expected_power * power + 1e-12)
    explained[:, 1] *= np.sign(products[:, 1].real)
    best = int(abs(explained[:, is_present]).mean(1).argmax())
    ratios = np.where(is_present, np.sqrt(power / (expected_power[best] + 1e-12)), np.nan)
    return Match(
        explained=float(explained[best, is_present].mean()),
        delay=float(delays[best]),
        angle=float(np.angle(products[best, 0])) if is_present[0] else np.nan,
        ratios=(float(ratios[0]), float(ratios[1])),
    )


def to_complex(displacements: Array) -> np.ndarray:
    """Return displacements (..., n, 3) as translations x + i y and rotations, (..., 2, n)."""
    return np.stack([displacements @ [1, 1j, 0], displacements[..., 2]], axis=-2)


def compute_displacements(motion: LoggedMotion, window: float = WINDOW_S) -> tuple[Array, Array]:
    """Return start times (n,) and displacements (n, 3) over a window in s, frame of the twists.

    Windows that overlap a gap in the poses are left out.
    """
    is_visible = has_pose(motion.pose)
    visible_time = motion.time[is_visible]
    intervals = np.diff(visible_time)
    max_interval = max(MAX_GAP_PERIODS * float(np.median(intervals)), WINDOW_S)
    pieces = np.split(visible_time, np.flatnonzero(intervals > max_interval) + 1)
    start = np.concatenate([np.arange(p[0], p[-1] - window, window / 2) for p in pieces])
    start = start[:: 1 + len(start) // MAX_WINDOWS]
    path = make_interp_spline(visible_time, motion.pose[is_visible], k=1)
    heading = path(start + window / 2)[:, 2] * motion.in_body
    return start, world_to_body(path(start + window) - path(start), heading)


def _check_wheels(log: RobotLog, motion: LoggedMotion, geometry: Kinematics) -> None:
    """Raise OmniError if wheels have wrong signs, order or speeds, or do not turn.

    The delay is that at which the wheels, in any order and with any signs, correlate most with the
    motion.
    """
    start, displacements = compute_displacements(motion)
    expected = geometry.wheel_speeds(displacements)
    deviation = expected.std(0)
    if deviation.max() * geometry.radius < MIN_RMS_M_S * WINDOW_S:
        return
    delayed_start = start - DELAYS_S["wheels"][:, None]
    angles = integrate_windows(log.time, log.inputs["wheels"], delayed_start, WINDOW_S)
    n = len(geometry.azimuths)
    with np.errstate(invalid="ignore"):  # a wheel that does not turn
        correlations = [np.corrcoef(expected.T, measured.T)[:n, n:] for measured in angles]
    # Of equally good orders, the one in the robot's file is preferred.
    scores = abs(np.nan_to_num(correlations)) + TIE * np.eye(n)
    orders = [linear_sum_assignment(-score)[1] for score in scores]
    i = int(np.argmax([s[np.arange(n), o].sum() for s, o in zip(scores, orders, strict=True)]))
    measured, correlation, order = angles[i], np.nan_to_num(correlations[i]), orders[i]
    best = correlation[np.arange(n), order]
    is_moving = deviation > MIN_SPEED_RATIO * deviation.max()
    is_still = (abs(best) < MIN_CORRELATION) & is_moving
    advantage = abs(best) - correlation.diagonal()
    is_misplaced = (abs(best) > HIGH_CORRELATION) & (advantage > ORDER_ADVANTAGE)
    n_sure = (abs(best) > HIGH_CORRELATION).sum()
    if n_sure < n - 1:
        return
    if (is_still | is_misplaced).any():
        columns = np.sign(best) * (order + 1) * ~is_still
        raise OmniError(f"{log.name}: {_describe_wheels(columns)}")
    speed_ratio = (measured * expected).sum(0) / (expected**2).sum(0)
    speed_ratio /= np.median(speed_ratio)
    is_wrong_speed = is_moving & (abs(np.log(np.maximum(speed_ratio, 1e-9))) > MAX_LOG_SPEED_RATIO)
    for i in np.flatnonzero(is_wrong_speed).tolist():
        raise OmniError(
            f"{log.name}: wheel {i + 1} turns {speed_ratio[i]:.2g} times as fast as the motion and "
            "the other wheels say; is its column in rad, behind the gear?"
        )


def _describe_wheels(columns: Array) -> str:
    """Return a message about wrong signs or order of wheels.

    Args:
        columns: Number of the log's wheel that turns as each wheel should, negative if it turns the
            other way, 0 if none does, (W,).
    """
    wheel_numbers = np.arange(1, len(columns) + 1)
    if (abs(columns) == wheel_numbers).all():
        reversed_wheels = wheel_numbers[columns < 0]
        verb = (
            f"wheel {reversed_wheels[0]} turns"
            if len(reversed_wheels) == 1
            else f"wheels {', '.join(map(str, reversed_wheels))} turn"
        )
        return f"{verb} the other way; a positive speed must turn the robot counter-clockwise"
    logged = ", ".join(f"{column:g}" for column in columns)
    return (
        f"wheels {', '.join(map(str, wheel_numbers))} of the robot's file turn as {logged} of "
        "the log (-: opposite sign; 0: none); order, signs or axes differ from the file's"
    )
