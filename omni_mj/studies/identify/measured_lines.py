"""Find the lines of a log in which a sensor was read, and the step of its values.

A logger with more lines than measurements repeats the last value. A value that is repeated after
the robot has moved is no measurement. Coarse values of a slow robot also repeat, and are.
"""

import numpy as np

from omni_control.kinematics import Array

# Largest jump after a repeated value over the motion per line that follows, if the value was
# measured again. It is 1 at a constant speed, and the number of repetitions if it was not.
MAX_JUMP_RATIO = 1.5
MIN_MOTION_STEPS = 4
MAX_ROUNDING = 1.2  # range of rounding errors of times in steps, with the error of a fitted line
ROUNDING = 1e-9  # smaller relative differences of values are errors of rounding


def find_step(values: Array) -> float:
    """Return the smallest difference between values (F,), such as 0.01 for two decimals.

    NaN is ignored. The step is 0 if all values are equal.
    """
    distinct = np.unique(values[np.isfinite(values)])
    differences = np.diff(distinct)
    is_step = differences > ROUNDING * np.abs(distinct).max(initial=0.0)
    return float(differences[is_step].min(initial=np.inf)) if is_step.any() else 0.0


def find_measured_lines(values: Array, steps: Array) -> np.ndarray:
    """Return whether values of a sensor were measured in each line, (F,).

    Args:
        values: K values in F lines, (F, K), without jumps by whole turns. Lines with NaN are no
            measurements.
        steps: Steps of the values, (K,); see `find_step`.
    """
    lines = np.flatnonzero(np.isfinite(values).all(1))
    present = values[lines]
    is_change = (np.diff(present, axis=0, prepend=np.nan) != 0).any(1)
    starts = np.flatnonzero(is_change)
    lengths = np.diff(starts, append=len(lines))
    jumps = np.abs(np.diff(present[starts], axis=0))
    motion_per_line = jumps[1:] / lengths[1:-1, None]
    is_held = np.zeros(len(starts), bool)
    is_held[:-2] = (jumps[:-1] > MAX_JUMP_RATIO * (motion_per_line + 2 * steps)).any(1)
    # Exact repetitions shorter than a rest, before far more motion than a step, are no chance.
    is_moving = (jumps > MIN_MOTION_STEPS * steps).any(1)
    repetitions = np.median(lengths[:-1][is_moving]) if is_moving.any() else 1
    is_short = lengths <= 2 * repetitions
    is_held[:-1] |= is_moving & is_short[:-1]
    is_held[-1:] = is_short[-1:] & (repetitions > 1)
    is_measured = np.zeros(len(values), bool)
    is_measured[lines] = is_change | ~np.repeat(is_held, lengths)
    return is_measured


def interpolate_measurements(time: Array, values: Array, steps: Array) -> Array:
    """Return values (F, K) of K sensors, interpolated where one was not measured.

    Values after the last measurement are NaN.

    Args:
        time: Times of the lines, (F,) s.
        values: The values, without NaN.
        steps: Steps of the values, (K,).
    """
    columns = []
    for column, step in zip(values.T, steps, strict=True):
        is_measured = find_measured_lines(column[:, None], np.array([step]))
        columns.append(np.interp(time, time[is_measured], column[is_measured], np.nan, np.nan))
    return np.column_stack(columns)


def restore_even_times(time: Array, step: float) -> Array:
    """Return evenly spaced times (F,) if rounding them to a step can give these times, or these."""
    lines = np.arange(len(time))
    even_times = np.polynomial.Polynomial.fit(lines, time, 1)(lines)
    return np.where(np.ptp(even_times - time) <= MAX_ROUNDING * step, even_times, time)
