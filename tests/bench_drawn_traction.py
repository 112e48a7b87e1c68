"""Where traction ends: what a robot is then taken for, and how soon it is back; for `bench_drawn`.

**Sane** is what a robot could be, with what is drawn of faults and errors (`SANE`). A latency is that beyond the dead
time: told wrong by 2 frames at most, and a frame of doubt. Alpha: published robots have 0.79 to 1, those that are hot
and nearly empty 0.7 (docs/results.md); nobody outruns its wheels, but windows of a fit that brake show up to 1.08.
Creep: half to twice that of the robot in closed form; four published robots differ by a factor of 1.9. Lag and dry
friction: at most twice those in closed form. Compass: two frames of turning at 3 rad/s. Coupling: a wheel with a motor
of 60 % of its torque constant c pulls kt (kp + n kt), half of what others pull, which turns the robots of the catalogue
by up to 0.8 rad/m (`omni_control.estimation.compliance`).

**Spells** in which traction ends: from the first frame in which a wheel slides or somebody pushes to the last that no
other follows within a second. **Back** is a robot whose error in the plane is what it was before, or less than 2 cm.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from omni_control.kinematics import Array
from omni_mj.measure import causes
from omni_mj.measure.recovery import NEAR_M
from omni_mj.measure.table import Table
from omni_mj.scenarios.faults import span
from omni_mj.scenarios.settings import FRAME_RATE_HZ, PERIOD_S
from omni_mj.scenarios.told import drag, lag
from omni_mj.simulate.log import Log
from omni_mj.studies.slip.law import expected

SANE = {
    "latency": (-3.0, 3.0),
    "alpha ahead": (0.7, 1.1),
    "alpha aside": (0.7, 1.1),
    "alpha turning": (0.7, 1.1),
    "creep ahead": (0.5, 2.0),
    "creep aside": (0.5, 2.0),
    "dry friction": (0.0, 2.0),
    "lag": (0.0, 2.0),
    "compass": (-0.1, 0.1),
    "coupling ahead": (-0.8, 0.8),
    "coupling aside": (-0.8, 0.8),
}
WITHIN_S = 1.0  # in which it shall be back
Found = Mapping[str, Any]
ROUNDING = 1e-9  # of what is kept at an edge


def identified(log: Log, row: int) -> dict[str, Array]:
    """What a robot is taken for, name of `SANE` -> (frames,)."""
    settings, own = log.rows[row].settings, slice(log.lengths[row])
    names = "latency_hat", "alpha_hat", "own_lag", "own_creep", "own_friction", "own_compass", "own_coupling"
    late, alpha, lags, creep, friction, compass, coupling = (log.channel(name)[own, row].T for name in names)
    law = expected(settings)
    values = [
        late[0] - lags[0] / PERIOD_S - settings.radio.delay_frames,
        *alpha,
        *(creep / law.time[:2, None]),
        friction[0] / drag(settings)[0],
        lags[0] / lag(settings)[0],
        compass[0],
        *coupling,
    ]
    return dict(zip(SANE, values, strict=True))


def taken_for(log: Log, row: int) -> dict[str, list[float]]:
    """The least and greatest of each, and the share of the frames in which it is not sane."""
    found = {}
    for name, values in identified(log, row).items():
        least, most = SANE[name]
        outside = (values < least - ROUNDING) | (values > most + ROUNDING)
        found[name] = [float(values.min()), float(values.max()), float(outside.mean())]
    return found


def spells(log: Log, row: int) -> list[tuple[int, int]]:
    """Spells of a row that a second of grip follows: their first frames, and those after their last."""
    ends = causes.of_row(log, row)[causes.SLIDING].copy()
    for fault in log.rows[row].faults:
        if fault.kind == "push":
            start, stop = span(fault)
            ends[start : int(min(stop, len(ends)))] = True
    frames = np.flatnonzero(ends)
    each = np.split(frames, np.flatnonzero(np.diff(frames) > FRAME_RATE_HZ) + 1) if frames.size else []
    return [(int(own[0]), int(own[-1]) + 1) for own in each if own[-1] + FRAME_RATE_HZ < len(ends)]


def returns(log: Log, row: int, distance: Array) -> list[Any]:
    """Of each spell its length, s, the error at its end, m, that to which it is back, m, and when, s; None for never.

    Args:
        log: what was recorded.
        row: number of the row.
        distance: its errors in the plane, (frames,) m.
    """
    found = []
    for first, after in spells(log, row):
        level = max(NEAR_M, float(distance[max(first - 1, 0)]))
        back = np.flatnonzero(distance[after : log.lengths[row]] <= level)
        when = float(back[0]) * PERIOD_S if back.size else None
        found.append([(after - first) * PERIOD_S, float(distance[after]), level, when])
    return found


def back(parts: Mapping[str, Sequence[Found]], controllers: Sequence[str]) -> Table:
    """How soon controllers are back in parts of a study."""
    rows = []
    for part, found in parts.items():
        for label in controllers:
            runs = (run for each in found for run in each["results"][label]["spells"])
            own = [spell for run in runs for spell in run]
            times = np.array([np.inf if when is None else when for _, off, level, when in own if off > level])
            late, counts = (times > WITHIN_S).sum(), [len(own), len(times)]
            quantiles = np.quantile(times, [0.5, 0.95, 1], method="higher") if times.size else np.full(3, np.nan)
            rows.append([part, label, *map(str, counts), str(len(times) - late), *(f"{x:.2f}" for x in quantiles)])
    counted = ["spells", "robots off", f"back within {WITHIN_S:g} s", "median, s", "19 in 20", "longest"]
    return Table("after traction has ended", ["", "", *counted], rows, 2)


def taken(parts: Mapping[str, Sequence[Found]], subject: str) -> Table:
    """What the subject takes its robots for: least and greatest of all frames, and how many of them are not sane."""
    rows = []
    for name, (least, most) in SANE.items():
        row = [name, f"{least:g} to {most:g}"]
        for found in parts.values():
            runs = np.array([run[name] for each in found for run in each["results"][subject]["taken_for"]])
            if len(runs):
                row.append(f"{runs[:, 0].min():.2f} to {runs[:, 1].max():.2f}, {100 * runs[:, 2].mean():.2f} %")
            else:
                row.append("")
        rows.append(row)
    return Table(f"{subject}: what is identified, and mean share of frames not sane", ["", "sane", *parts], rows, 1)
