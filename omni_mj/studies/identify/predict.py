"""How well numbers predict motion that they were not fitted to."""

from dataclasses import dataclass

import numpy as np

from omni_control.kinematics import Array
from omni_mj.studies.identify import law
from omni_mj.studies.identify.segments import Segments

SEEN_S = 0.25  # from which the first pose and twist of a stretch are taken, by a parabola


@dataclass(frozen=True)
class Prediction:
    """Root mean square errors over stretches: of positions, m, and of headings, rad.

    Attributes:
        start, start_rad: by the numbers that were believed before.
        identified, identified_rad: by those that were found.
        stretches: how many.
    """

    start: float
    identified: float
    start_rad: float
    identified_rad: float
    stretches: int


def predict(body: law.Body, segments: Segments, sets: Array, late: Array) -> Prediction:
    """Predict each stretch from its first quarter second on, with its inputs alone.

    Args:
        body: the robot.
        segments: that were not fitted to.
        sets: parameters (2, ...) that were believed, and that were found, as `law.simulate` has them.
        late: of inputs by the same, (S, 2) s.
    """
    first = first_poses(segments)
    motion = law.simulate(body, segments, sets, late, np.repeat(first[:, None, 1:].real, 2, 1))
    there = segments.there
    where, heading = first[:, 0, None, None] + motion.way, first[:, 1, None, None].real + motion.turned
    away = [np.abs(where[:, i] - segments.position)[there] for i in (0, 1)]
    turned = [(heading[:, i] - segments.angle)[there] for i in (0, 1)]
    errors = [float(np.sqrt((wrong**2).mean())) for wrong in (*away, *turned)]
    return Prediction(errors[0], errors[1], errors[2], errors[3], len(segments))


def first_poses(segments: Segments) -> np.ndarray:
    """Of each stretch position as a complex number, heading, twist and acceleration, world frame, (S, 8)."""
    place, speed, pull = first_states(segments, segments.position)
    angle, rate, faster = first_states(segments, segments.angle)
    return np.stack([place, angle, speed.real, speed.imag, rate, pull.real, pull.imag, faster], 1)


def first_states(segments: Segments, measured: np.ndarray) -> np.ndarray:
    """Positions, velocities and accelerations at the first line (3, S), by a parabola through 1/4 s or 6 samples."""
    time = segments.time - segments.time[:, :1]
    found = np.zeros((3, len(segments)), measured.dtype)
    for i, there in enumerate(segments.there):
        at = np.flatnonzero(there)
        near = at[: max(6, int((time[i, at] < SEEN_S).sum()))]
        t = time[i, near]
        columns = np.stack([np.ones_like(t), t, t**2 / 2], 1)
        found[:, i] = np.linalg.lstsq(columns, measured[i, near], rcond=None)[0]
    return found
