"""Cut out poses that the inputs do not explain: false detections, and robots that are carried."""

from dataclasses import replace

import numpy as np

from omni_control.errors import list_first
from omni_control.kinematics import Array, Kinematics, wrap_angle
from omni_mj.studies.identify.log_checks import (
    LoggedMotion,
    compute_displacements,
    match_motion,
    to_complex,
)
from omni_mj.studies.identify.robot_logs import (
    MAX_GAP_PERIODS,
    MIN_LINES,
    RobotLog,
    has_pose,
    integrate_windows,
)

# A faster step from one pose to the next is a jump to a false detection, or of a robot that was
# put elsewhere: distance and angle plus speed times interval.
JUMP_M, JUMP_M_S = 0.1, 8.0
JUMP_RAD, JUMP_RAD_S = 1.0, 30.0
# If more steps are jumps, units are wrong.
MAX_JUMP_FRACTION = 0.05
# Displacements over this time are compared with the inputs. They may differ by a distance or angle,
# plus a fraction of the displacement by the inputs.
WINDOW_S, TOLERANCE_FRACTION = 0.5, 0.6
TOLERANCE = np.array([[0.08], [0.4]])  # m and rad
# If more of the motion is not explained, the log is wrong, which `log_checks` reports.
MAX_UNEXPLAINED_FRACTION = 0.5
MARGIN_S = 0.1  # cut before and after


def discard_unexplained_poses(log: RobotLog, geometry: Kinematics) -> tuple[RobotLog, list[str]]:
    """Return a log without poses that its inputs do not explain, and remarks about them.

    Args:
        log: The log.
        geometry: Wheels of the start robot.

    Raises:
        OmniError: The log has another number of wheels.
    """
    source = "wheels" if "wheels" in log.inputs else "commands"
    motion = LoggedMotion.from_log(log, source, geometry)
    if has_pose(log.pose).sum() < MIN_LINES:
        return log, []
    is_discarded = _mark_intervals(log.time, *_find_jumps(log))
    pose = np.where(is_discarded[:, None], np.nan, log.pose)
    if has_pose(pose).sum() >= MIN_LINES:
        unexplained = _find_unexplained_windows(motion._replace(pose=pose))
        is_discarded |= _mark_intervals(log.time, unexplained, unexplained + WINDOW_S)
        pose[is_discarded] = np.nan
    if not is_discarded.any():
        return log, []
    bounds = np.flatnonzero(np.diff(is_discarded.astype(int), prepend=0, append=0))
    spans = [
        f"{log.time[start] - log.time[0]:.2f} to {log.time[stop - 1] - log.time[0]:.2f} s"
        for start, stop in bounds.reshape(-1, 2)
    ]
    remark = (
        f"{log.name}: cut out where the {source} do not explain the poses (a robot that is carried "
        f"or pushed, or a false detection): {list_first(spans)}"
    )
    return replace(log, pose=pose), [remark]


def _mark_intervals(time: Array, start: Array, end: Array) -> np.ndarray:
    """Return whether times (F,) are between sorted starts and ends (n,), or in a margin, (F,)."""
    margin = max(MARGIN_S, 2 * float(np.median(np.diff(time))))
    n_started = np.searchsorted(start - margin, time, "right")
    return np.asarray(n_started > np.searchsorted(end + margin, time))


def _find_jumps(log: RobotLog) -> tuple[Array, Array]:
    """Return the times of the poses before and after each jump, (n,) s each.

    There are none if too many steps are jumps.
    """
    is_visible = has_pose(log.pose)
    visible_time = log.time[is_visible]
    interval, step = np.diff(visible_time), np.diff(log.pose[is_visible], axis=0)
    is_jump = np.hypot(step[:, 0], step[:, 1]) > JUMP_M + JUMP_M_S * interval
    is_jump |= abs(wrap_angle(step[:, 2])) > JUMP_RAD + JUMP_RAD_S * interval
    is_jump &= interval <= MAX_GAP_PERIODS * np.median(interval)
    if is_jump.mean() > MAX_JUMP_FRACTION:
        is_jump[:] = False
    return visible_time[:-1][is_jump], visible_time[1:][is_jump]


def _find_unexplained_windows(motion: LoggedMotion) -> Array:
    """Return the start times of windows whose displacements the inputs do not explain, (n,) s.

    There are none if the inputs leave most of the motion unexplained.
    """
    match = match_motion(motion)
    start, displacements = compute_displacements(motion, WINDOW_S)
    integrals = integrate_windows(motion.time, motion.twist, start - match.delay, WINDOW_S)
    measured, expected = to_complex(displacements), to_complex(integrals)
    expected[0] *= np.exp(1j * np.nan_to_num(match.angle))
    is_unexplained = abs(measured - expected) > TOLERANCE + TOLERANCE_FRACTION * abs(expected)
    is_unexplained, is_moving = is_unexplained.any(0), (abs(measured) > TOLERANCE).any(0)
    if is_unexplained.sum() > MAX_UNEXPLAINED_FRACTION * is_moving.sum():
        return np.empty(0)
    return start[is_unexplained]
