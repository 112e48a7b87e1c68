"""How well numbers predict motion that they were not fitted to."""

from dataclasses import dataclass

import numpy as np

from omni_control.kinematics import Array
from omni_mj.studies.identify import law
from omni_mj.studies.identify.segments import Segments

HORIZON_S = 1.0
SEEN_S = 0.25  # from which the first pose and velocity of a stretch are taken, by a parabola


@dataclass(frozen=True)
class Prediction:
    """Root mean square error of the position over the first second of stretches, m; or of the heading, rad.

    Attributes:
        start: by the numbers that were believed before; identified: by those that were found.
        stretches: how many.
        unit: m or rad.
    """

    start: float
    identified: float
    stretches: int
    unit: str


def predict(segments: Segments, start: Array, found: Array, turning: bool = False) -> Prediction:
    """Predict each stretch from its first quarter second on, with its inputs alone.

    Args:
        segments: that were not fitted to.
        start: parameters that were believed, of `law.NAMES` or `law.TURNING`.
        found: the same, as identified.
        turning: whether headings are predicted.
    """
    measured = segments.angle if turning else segments.position
    where, speed = first_states(segments, measured)
    sets = np.stack([start, found])
    simulate = law.turn if turning else law.translate
    ways, _ = simulate(segments, sets, np.repeat(speed[:, None], 2, 1))
    time = segments.time - segments.time[:, :1]
    counted = segments.there & (time <= HORIZON_S)
    wrong = np.abs(where[:, None, None] + ways - measured[:, None])
    before, after = (float(np.sqrt((wrong[:, i][counted] ** 2).mean())) for i in (0, 1))
    return Prediction(before, after, len(segments), "rad" if turning else "m")


def first_states(segments: Segments, measured: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Positions and velocities at the first line (S,), by a parabola through a quarter second or 6 samples."""
    time = segments.time - segments.time[:, :1]
    found = np.zeros((2, len(segments)), measured.dtype)
    for i, there in enumerate(segments.there):
        at = np.flatnonzero(there)
        near = at[: max(6, int((time[i, at] < SEEN_S).sum()))]
        t = time[i, near]
        columns = np.stack([np.ones_like(t), t, t**2], 1)
        found[:, i] = np.linalg.lstsq(columns, measured[i, near], rcond=None)[0][:2]
    return found[0], found[1]
