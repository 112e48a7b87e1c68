"""By how much the delay of commands differs from one to the next: from stamps of their receipt, or from moves.

**Stamps.** The standard deviation of receipt less sending, without a drift between the two clocks.

**Moves.** Each stretch s tells a delay of its own, beside that of all: with the residuals r and their derivatives J by
latency, d_s = -J r / J^2, of the variance e_s^2 = sigma^2 / J^2. It is the mean of the delays of its commands, each
weighed by what its change of the command moves: c_j = J_j J, where J_j is the way of the change from its line on, less
what a first position and velocity explain. If commands are late by sigma_j independently of each other, d_s has the
variance e_s^2 + sigma_j^2 / n_s with the number of commands that count, n_s = (sum c)^2 / sum c^2: one for a step,
thirty for a smooth move, which therefore says little. Estimate and interval are those of the likelihood of all d_s.
What residuals are left without d_s, and how long they last, makes e_s, and 2 ms by which the law itself is wrong.
"""

from collections.abc import Iterator, Sequence

import numpy as np
from scipy.special import gammaincinv

from omni_control.kinematics import Array
from omni_mj.studies.identify.findings import Estimate, Kind, judged
from omni_mj.studies.identify.fit import Fit
from omni_mj.studies.identify.logs import Log
from omni_mj.studies.identify.residuals import COMMANDS, residuals
from omni_mj.studies.identify.segments import Segments

LIMIT_S, SHARE = 0.004, 0.5  # half width of the interval above which jitter is not told: a quarter of a frame, or share
STEPS = (
    "twenty steps of the commanded velocity, of 1 m/s or 5 rad/s within a line or two and a second apart; or a column "
    "received_s: when the robot got each line's command, by any clock"
)
KIND = Kind("jitter of the delay, standard deviation", "s", LIMIT_S, SHARE, "", STEPS)
LOST = Kind("commands that were lost, share", "", 0.02, 0, "", STEPS)
LAW_S = 2.3e-3  # by which the law is wrong about delays, from move to move
LAGS = 10  # of residuals, of which sums count
LASTING = 0.45  # share of residuals with delays of their own that lasts, from which on they are not delays
LONGEST_S, GRID = 0.1, 401
NORMAL = 1.96
LEAST = 20  # stamps


def of_stamps(logs: Sequence[Log]) -> Iterator[Estimate]:
    """Jitter and losses by the logs' stamps, of those that have any."""
    late, lost = list[Array](), list[np.ndarray]()
    for log in logs:
        if log.received is None:
            continue
        there = np.isfinite(log.received)
        lost.append(~there)
        if there.sum() >= LEAST:
            delay, time = (log.received - log.time)[there], log.time[there]
            late.append(delay - np.polynomial.Polynomial.fit(time, delay, 1)(time))
    if not late:
        return
    every, missing = np.concatenate(late), np.concatenate(lost)
    spread = float(every.std())
    peaked = float((every**4).mean()) / max(spread, 1e-12) ** 4
    error = spread * np.sqrt(max(peaked - 1, 0.0) / (4 * len(every)))
    yield judged("jitter_s", KIND, "stamps", spread, float(error), NORMAL)
    share = float(missing.mean())
    yield judged("lost", LOST, "stamps", share, float(np.sqrt(share * (1 - share) / len(missing))), NORMAL)


def of_moves(fitted: Fit, segments: Segments, left_out: int = 0) -> Estimate:
    """Jitter by what each stretch says of its delay.

    Args:
        fitted: to segments.
        segments: the stretches.
        left_out: how many others there are, whose residuals are too large; of those with the longest delays, maybe.
    """
    squares = np.maximum((fitted.by_latency**2).sum((1, 2)), 1e-12)
    own = -(fitted.by_latency * fitted.residual).sum((1, 2)) / squares
    left = fitted.residual + own[:, None, None] * fitted.by_latency
    rest = residuals(left[..., :2], segments.there, COMMANDS.position)
    variance = LAW_S**2 + _lasting(left) / squares
    count = _count(segments, fitted)
    grid = np.linspace(0, LONGEST_S, GRID)
    whole = variance + grid[:, None] ** 2 / count
    mean = (own / whole).sum(1, keepdims=True) / (1 / whole).sum(1, keepdims=True)
    likelihood: Array = -0.5 * (np.log(whole) + (own - mean) ** 2 / whole).sum(1) - 0.5 * np.log((1 / whole).sum(1))
    best = int(np.argmax(likelihood))
    inside = grid[likelihood > likelihood[best] - gammaincinv(0.5, 0.95)]  # half of chi-squared's 95 %
    low, high = float(inside[0]), float(inside[-1])
    value, half, why = float(grid[best]), (high - low) / 2, None
    if left_out:
        why = f"{left_out} stretches are left out, which may be those of the longest delays"
    elif rest.lasting > LASTING * rest.rms:
        why = f"the law lacks what looks like delays that differ: {1e3 * rest.lasting:.1f} mm of residuals that last"
    elif half > (limit := max(LIMIT_S, SHARE * value)) or high >= LONGEST_S:
        why = (
            f"its 95 % interval is {1e3 * low:.1f} to {1e3 * high:.1f} ms, wider than +-{1e3 * limit:.2g} ms: "
            f"{np.median(count):.0f} commands share what a stretch tells of their delays"
        )
    error = half / NORMAL
    return Estimate("jitter_s", KIND.title, "s", "commands", value, error, error, low, high, why, STEPS)


def _lasting(residual: Array) -> float:
    """Variance of residuals (S, m, 3), times what their autocorrelation makes of that of a sum."""
    count = max(int(np.count_nonzero(residual)), 1)
    power = float((residual**2).sum()) / count
    lags = range(1, min(LAGS, residual.shape[1] - 1) + 1)
    alike = [float((residual[:, lag:] * residual[:, :-lag]).sum()) / count for lag in lags]
    shares = [max(each, 0.0) * (1 - lag / (LAGS + 1)) for lag, each in zip(lags, alike, strict=True)]
    return power + 2 * float(sum(shares))


def _count(segments: Segments, fitted: Fit) -> Array:
    """How many commands count in each stretch, (S,)."""
    found = np.ones(len(segments))
    change = np.diff(segments.inputs, axis=0, prepend=segments.inputs[:1])
    for i, (lines, there) in enumerate(zip(segments.lines, segments.there, strict=True)):
        time = segments.clock[lines[there]]
        late = float(fitted.late[min(int(segments.log[i]), len(fitted.late) - 1)])
        first, last = np.searchsorted(segments.clock, [time[0] - late, time[-1] - late])
        sent = np.arange(max(first, segments.first[i] + 1), last)
        sent = sent[np.abs(change[sent]).max(1, initial=0.0) > 0]
        if not len(sent):
            continue
        acts = time[:, None] > segments.clock[sent] + late
        free = np.linalg.qr(np.stack([np.ones_like(time), time - time[0]], 1))[0]
        ways = acts - free @ (free.T @ acts)  # (m, commands)
        moved = change[sent] * [1.0, 1.0, fitted.metres]
        along = (ways @ moved).T @ ways  # of all, by each: (3, commands)
        share = (along.T * moved).sum(1)
        found[i] = max(share.sum() ** 2 / max((share**2).sum(), 1e-12), 1.0)
    return found
