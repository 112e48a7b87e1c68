"""Least squares of the law over stretches whose first pose and twist are free, by scipy, with honest errors.

Output errors are fitted: poses predicted from the first sample to the last of each stretch, against poses measured;
headings count in metres, by the ratio of both noises. What is free in each stretch alone, its first pose and twist, is
solved for in each evaluation (variable projection, with Kaufman's Jacobian: Kaufman 1975, BIT 15, 49), so that scipy's
`least_squares` sees the law's parameters only. The first twist is tied, weakly, to that of a parabola through the first
poses: of a robot that starts from rest the law forgets it at once.

What the law does not know lasts for more than one sample, so that errors as from white noise would be too small.
Standard errors are those of Newey and West (1987, Econometrica 55, 703): scores are summed over lags of up to 1/2 s
within a stretch; where white noise gives the larger ones, those. Both with the degrees of freedom that are left.
Intervals are Student's, a degree of freedom for each stretch but one.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy import stats
from scipy.optimize import least_squares

from omni_control.kinematics import Array
from omni_mj.studies.identify import law
from omni_mj.studies.identify.predict import first_poses
from omni_mj.studies.identify.segments import COARSEST_S, Segments

LATE = "latency_s"  # beside those of `law.NAMES`: one, or one for each log
# Name -> size of a change that matters, step of finite differences, lowest and highest value.
RANGES = {
    "creep": (0.2, 1e-2, 0.0, 20.0),
    "pile": (0.02, 1e-3, -0.2, 1.0),
    "roller_friction": (0.02, 1e-3, -0.2, 1.0),
    "scale": (0.05, 1e-3, 0.4, 2.5),
    "arm": (0.05, 1e-3, 0.4, 2.5),
    "compass_rad": (0.05, 1e-3, -1.0, 1.0),
    "give_s": (0.02, 2e-4, 1e-4, 1.0),
    "friction_m_s": (0.05, 1e-3, -0.2, 0.4),
    "turn_gain": (0.3, 1e-2, -0.5, 10.0),
    "grip": (0.1, 1e-2, 0.05, 5.0),
    "drift": (1e-3, 1e-5, -0.1, 0.1),
    "integral_1_s": (2.0, 5e-2, 0.0, 100.0),
    LATE: (0.01, 1e-4, -0.5, 0.6),
}
WIDTH = 3  # real numbers of a pose
TRUSTED_S = 0.05  # weight of the first twist that a parabola shows: 1.3 mm of noise to 0.026 m/s
ROUGH_S = 0.02  # steps in which a fit begins
NUDGE = 0.02  # of first headings and twists, rad, m/s and rad/s
MEMORY_S = 0.5  # lags of scores that are summed
LAGS = 10  # of residuals, that are tested
PERSISTENT, SIGNIFICANT = 0.1, 1e-3  # mean autocorrelation over 5 lags, and p, from which residuals are not white
SINGULAR = 1e-5  # singular value over the largest, of columns of length 1, below which nothing is known


@dataclass(frozen=True)
class Whiteness:
    """Of residuals of one kind.

    Attributes:
        rms: root mean square, m or rad; noise: what of it changes from sample to sample.
        memory: autocorrelation, mean over lags 1 to 5; unlikely: p of Ljung and Box's test.
    """

    rms: float
    noise: float
    memory: float
    unlikely: float

    @property
    def misfit(self) -> bool:
        """Whether they are not white: the law lacks something that the data show."""
        return self.memory > PERSISTENT and self.unlikely < SIGNIFICANT


@dataclass(frozen=True)
class Fit:
    """What came out.

    Attributes:
        names: of the parameters that were free, n; latencies first, one or one for each log.
        value: (n,).
        covariance: (n, n); of what the data say nothing, infinite.
        parameters: all of the law's, (11,), and `late` (logs,).
        quantile: of Student's distribution, for 95 %.
        at_bound: which stopped at a bound, (n,).
        position, heading: residuals of both.
        twist: at all samples, by the law, (S, m, 3). samples: how many there were.
        each: root mean square of the residuals of each stretch, (S,) m.
        residual: of each sample's position and heading, (S, m, 3) m, with metres per radian as `metres` says.
        by_latency: what it changes by with the latency of its log, (S, m, 3) m/s.
    """

    names: tuple[str, ...]
    value: Array
    covariance: Array
    parameters: Array
    late: Array
    quantile: float
    at_bound: np.ndarray
    position: Whiteness
    heading: Whiteness
    twist: Array
    samples: int
    each: Array
    residual: Array
    by_latency: Array
    metres: float

    @property
    def error(self) -> Array:
        """Standard errors (n,)."""
        error: Array = np.sqrt(np.diag(self.covariance))
        return error

    @property
    def misfit(self) -> bool:
        """Whether the law lacks something that the data show."""
        return self.position.misfit or self.heading.misfit


def fit(
    body: law.Body,
    segments: Segments,
    start: Array,
    late: Array,
    free: Sequence[str],
    fixed: Mapping[str, float] = {},
    rough: bool = False,
) -> Fit:
    """Fit the law to stretches: with long steps, then, from what that found, with short ones.

    Args:
        body: the robot that is believed in.
        segments: at least two.
        start: parameters (11,) in the order of `law.NAMES`.
        late: of inputs, one for all logs or one for each, s.
        free: names of `law.NAMES` that are fitted beside latencies.
        fixed: values of others than in `start`.
        rough: whether long steps will do, for values to start from.
    """
    base = np.array(start, float)
    for name, value in fixed.items():
        base[law.NAMES.index(name)] = value
    problem = _Problem(body, segments, base, len(late), [law.NAMES.index(name) for name in free])
    names = (*[LATE] * len(late), *free)
    scale, _, low, high = np.array([RANGES[name] for name in names]).T
    first = np.clip(np.append(late, base[problem.free]), low + 1e-3 * scale, high - 1e-3 * scale)
    x = first
    for coarsest in (ROUGH_S,) if rough else (ROUGH_S, COARSEST_S):
        problem.step_no_longer_than(coarsest)
        found = least_squares(
            lambda x: problem.at(x)[0].ravel(),
            x,
            lambda x: problem.at(x)[1].reshape(-1, len(names)),
            bounds=(low, high),
            x_scale=scale,
            ftol=1e-5,
            xtol=1e-5,
            gtol=1e-9,
            max_nfev=40,
        )
        x = np.clip(found.x, low + 1e-6 * scale, high - 1e-6 * scale)
    residual, jacobian, twist = problem.at(found.x)
    residual, jacobian = residual[:, :-1], jacobian[:, :-1]
    covariance = _covariance(residual, jacobian, segments, problem.taken)
    bound = (found.x < low + 2e-3 * scale) | (found.x > high - 2e-3 * scale)
    parameters = base.copy()
    parameters[problem.free] = found.x[len(late) :]
    each = np.sqrt((residual**2).sum((1, 2)) / (segments.there.sum(1) * WIDTH))
    return Fit(
        names,
        found.x,
        covariance,
        parameters,
        found.x[: len(late)],
        float(stats.t.ppf(0.975, max(len(segments) - 1, 1))),
        bound,
        whiteness(residual[..., :2], segments.there),
        whiteness(residual[..., 2:] / problem.metres, segments.there),
        twist,
        int(segments.there.sum()),
        each,
        residual,
        jacobian[..., : len(late)].sum(-1),
        problem.metres,
    )


class _Problem:
    """Residuals and their Jacobian, without what is free in each stretch."""

    def __init__(self, body: law.Body, segments: Segments, start: Array, late: int, free: list[int]) -> None:
        self.body, self.segments, self.start, self.free = body, segments, start, free
        self.taken = 2 * WIDTH * len(segments)  # numbers that are free in stretches
        self.logs = segments.log if late > 1 else np.zeros(len(segments), int)
        self.late, self._coarsest = late, COARSEST_S
        self.steps = np.array([RANGES[n][1] for n in (LATE, *(law.NAMES[i] for i in free))])
        there = segments.there
        self.metres = _noise(segments.position, there) / max(_noise(segments.angle, there), 1e-6)
        self._first = first_poses(segments)[:, 1:].real
        measured = np.stack([segments.position.real, segments.position.imag, segments.angle * self.metres], -1)
        self._measured = (measured * there[..., None]).reshape(len(there), -1)
        ones = np.zeros((len(there), 3, *there.shape[1:], WIDTH))
        for i in range(WIDTH):
            ones[:, i, :, i] = there
        self._ones = ones.reshape(len(there), 3, -1)
        self._last: tuple[bytes, tuple[Array, Array, Array]] | None = None

    def step_no_longer_than(self, coarsest: float) -> None:
        """Solve the law from now on in such steps, s."""
        self._coarsest, self._last = coarsest, None

    def at(self, x: Array) -> tuple[Array, Array, Array]:
        """Residuals (S, m + 1, 3), Jacobian (S, m + 1, 3, n), twists (S, m, 3); the last sample is the tie."""
        if self._last is None or self._last[0] != x.tobytes():
            self._last = x.tobytes(), self._at(x)
        return self._last[1]

    def _at(self, x: Array) -> tuple[Array, Array, Array]:
        parameters = self.start.copy()
        parameters[self.free] = x[self.late :]
        late = x[: self.late][self.logs]
        _, _, change, _ = self._projected(parameters[None], late, self._first)
        sets = np.tile(parameters, (1 + len(self.free), 1))
        sets[1 + np.arange(len(self.free)), self.free] += self.steps[1:]
        residual, slopes, _, twist = self._projected(sets, late, self._first + np.pad(change, ((0, 0), (0, 3))))
        jacobian = np.zeros((*residual.shape, len(x)))
        jacobian[..., self.late :] = slopes[..., 1:]
        jacobian[np.arange(len(late)), :, :, self.logs] += slopes[..., 0]
        return residual, jacobian, twist

    def _projected(self, sets: Array, late: Array, first: Array) -> tuple[Array, Array, Array, Array]:
        """Residuals, derivatives by latency and the sets after the first, by how much first states are wrong."""
        there, width = self.segments.there, WIDTH
        nudges = np.concatenate([np.zeros((1, 7)), NUDGE * np.eye(4, 7)])
        k = len(nudges)
        more = len(sets) - 1
        shifted = 1 if more else 0
        all_sets = np.concatenate([np.tile(sets[0], (k + shifted, 1)), sets[1:]])
        starts = first[:, None] + np.concatenate([nudges, np.zeros((shifted + more, 7))])
        lates = np.tile(late[:, None], len(all_sets))
        if shifted:
            lates[:, k] += self.steps[0]
        motion = law.simulate(self.body, self.segments, all_sets, lates, starts, self._coarsest)
        heading = starts[..., 0][..., None] + motion.turned
        flat = np.stack([motion.way.real, motion.way.imag, heading * self.metres], -1) * there[:, None, :, None]
        flat = flat.reshape(len(there), len(all_sets), -1)  # (S, P, m width)
        by_state = (flat[:, 1:k] - flat[:, :1]) / NUDGE
        columns = np.concatenate([self._ones[:, :2], by_state], 1)  # x, y; heading, vx, vy, w
        tied = np.zeros((len(there), 2 * width, width))
        weight = TRUSTED_S * np.array([1.0, 1.0, self.metres])
        tied[:, width:] = np.diag(weight)
        q, r = np.linalg.qr(np.concatenate([columns, tied], 2).swapaxes(1, 2))

        def without(values: Array) -> Array:  # (S, p, m width + width)
            return values - np.einsum("sij,spj->spi", q, np.einsum("sij,spi->spj", q, values))

        wrong = flat[:, 0] - self._measured
        both = np.concatenate([wrong, (first - self._first)[:, 1:4] * weight], 1)
        solved = np.linalg.solve(r, -np.einsum("sij,si->sj", q, both)[..., None])[..., 0]
        shape = len(there), there.shape[1] + 1, width
        residual = without(both[:, None]).reshape(shape)
        slopes = (flat[:, k:] - flat[:, :1]) / self.steps[: shifted + more, None]
        slopes = without(np.concatenate([slopes, np.zeros((*slopes.shape[:2], width))], 2))
        return residual, slopes.swapaxes(1, 2).reshape(*shape, -1), solved[:, 2:], motion.twist[:, 0]


def _noise(values: np.ndarray, there: np.ndarray) -> float:
    """What changes from sample to sample: standard deviation, by second differences, of each real number."""
    three = there[:, 2:] & there[:, 1:-1] & there[:, :-2]
    second = (values[:, 2:] - 2 * values[:, 1:-1] + values[:, :-2])[three]
    numbers = 2 if np.iscomplexobj(values) else 1
    return (
        float(np.sqrt(np.median(np.abs(second) ** 2) / (6 * (1.386 if numbers == 2 else 0.455))))
        if second.size
        else 0.0
    )


def _covariance(residual: Array, jacobian: Array, segments: Segments, taken: int) -> Array:
    """Of the parameters (n, n)."""
    n, there = jacobian.shape[-1], segments.there
    length = np.sqrt((jacobian**2).sum((0, 1, 2)))
    shown = length > 0
    unit = jacobian[..., shown] / length[shown]
    _, sizes, basis = np.linalg.svd(unit.reshape(-1, shown.sum()), full_matrices=False)
    known = sizes > SINGULAR * sizes[:1]
    bread = (basis[known].T / sizes[known] ** 2) @ basis[known]
    count = there.sum() * residual.shape[-1]
    left = max(count - taken - shown.sum(), 1)
    white = bread * (residual**2).sum() / left
    scores = (unit * residual[..., None]).sum(2)  # (S, m, n)
    lags = min(max(1, round(MEMORY_S / segments.period)), there.shape[1] - 1)
    meat = np.einsum("smi,smj->ij", scores, scores)
    for lag in range(1, lags + 1):
        both = np.einsum("smi,smj->ij", scores[:, lag:], scores[:, :-lag])
        meat += (1 - lag / (lags + 1)) * (both + both.T)
    lasting = bread @ meat @ bread * count / left
    more = np.sqrt(np.maximum(np.diag(white), 1e-300) / np.maximum(np.diag(lasting), 1e-300))
    both = lasting * np.outer(np.maximum(more, 1.0), np.maximum(more, 1.0))
    lost = (basis[~known] ** 2).sum(0) > 1e-3
    both[lost, :] = both[:, lost] = 0.0
    both[lost, lost] = np.inf
    covariance = np.zeros((n, n))
    covariance[~shown, ~shown] = np.inf
    covariance[np.ix_(shown, shown)] = both / np.outer(length[shown], length[shown])
    return covariance


def whiteness(residual: Array, there: np.ndarray) -> Whiteness:
    """Root mean square, what of it changes from sample to sample, mean autocorrelation, p of Ljung and Box's test."""
    count = there.sum() * residual.shape[-1]
    power = (residual**2).sum() / count
    r = np.zeros(LAGS)
    pairs = np.ones(LAGS)
    for lag in range(1, min(LAGS, there.shape[1] - 1) + 1):
        both = there[:, lag:] & there[:, :-lag]
        pairs[lag - 1] = max(both.sum() * residual.shape[-1], 1)
        r[lag - 1] = (residual[:, lag:] * residual[:, :-lag]).sum() / pairs[lag - 1] / max(power, 1e-30)
    three = there[:, 2:] & there[:, 1:-1] & there[:, :-2]
    second = (residual[:, 2:] - 2 * residual[:, 1:-1] + residual[:, :-2])[three]
    noise = np.sqrt((second**2).mean() / 6) if second.size else 0.0
    unlikely = float(stats.chi2.sf((pairs * r**2).sum(), LAGS))
    return Whiteness(float(np.sqrt(power)), float(noise), float(r[:5].mean()), unlikely)
