"""Least squares of the law over stretches whose first pose and velocity are free, by scipy, with honest errors.

Output errors are fitted: positions predicted from the first sample to the last of each stretch, against positions
measured. What is free in each stretch alone, its first pose and velocity, is solved for in each evaluation (variable
projection, with Kaufman's Jacobian: Kaufman 1975, BIT 15, 49), so that scipy's `least_squares` sees the law's
parameters only. The first velocity is tied, weakly, to that of a parabola through the first poses: of a robot that
starts from rest the law forgets it at once.

What the law does not know lasts for more than one sample, so that errors as from white noise would be too small.
Standard errors are those of Newey and West (1987, Econometrica 55, 703): scores are summed over lags of up to 1/2 s
within a stretch; where white noise gives the larger ones, those. Both with the degrees of freedom that are left.
Intervals are Student's, with a degree of freedom for each stretch but one.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy import stats
from scipy.optimize import least_squares

from omni_control.kinematics import Array
from omni_mj.studies.identify import law
from omni_mj.studies.identify.predict import first_states
from omni_mj.studies.identify.segments import Segments

SCALES = np.array([0.01, 0.1, 0.1, 0.05, 0.05, 0.02, 0.02, 0.05, 0.05])
STEPS = np.array([1e-4, 1e-3, 1e-3, 1e-3, 1e-3, 2e-4, 2e-4, 1e-3, 1e-3])  # of finite differences
LOW = np.array([-0.3, 0.4, 0.4, -0.2, -0.2, 1e-3, 1e-3, -0.2, -1.0])
HIGH = np.array([0.6, 2.5, 2.5, 0.8, 0.8, 0.6, 0.6, 0.4, 1.0])
OF_TURNING = np.array([0, 1, 5])  # scales, steps and bounds of the parameters of turning
TRUSTED_S = 0.015  # weight of the first velocity that a parabola shows: 1.5 mm of noise to 0.1 m/s
NUDGE = 0.02  # of velocities at the start, m/s and rad/s
MEMORY_S = 0.5  # lags of scores that are summed
LAGS = 10  # of residuals, that are tested
PERSISTENT, SIGNIFICANT = 0.1, 1e-3  # mean autocorrelation over 5 lags, and p, from which residuals are not white
SINGULAR = 1e-5  # singular value over the largest, of columns of length 1, below which nothing is known


@dataclass(frozen=True)
class Fit:
    """What came out.

    Attributes:
        names: of the parameters, n.
        value: (n,); error: standard errors (n,), infinite where the data say nothing.
        quantile: of Student's distribution, for 95 %.
        at_bound: which stopped at a bound, (n,).
        rms: of the residuals, in m or rad; noise: what of it changes from sample to sample.
        memory: autocorrelation of residuals, mean over lags 1 to 5; unlikely: p of Ljung and Box's test.
        velocity: along the body's axes at all samples, by the law (S, m) complex; turn rates of turning.
        samples: how many there were.
        each: root mean square of the residuals of each stretch, (S,).
    """

    names: tuple[str, ...]
    value: Array
    error: Array
    quantile: float
    at_bound: np.ndarray
    rms: float
    noise: float
    memory: float
    unlikely: float
    velocity: np.ndarray
    samples: int
    each: Array

    @property
    def misfit(self) -> bool:
        """Whether residuals are not white: the law lacks something that the data show."""
        return self.memory > PERSISTENT and self.unlikely < SIGNIFICANT


def fit(segments: Segments, start: Array, fixed: Sequence[str] = (), turning: bool = False) -> Fit:
    """Fit the law to stretches.

    Args:
        segments: at least two.
        start: parameters (9,) in the order of `law.NAMES`, or (3,) of `law.TURNING`.
        fixed: names of those that stay as they are.
        turning: whether headings are fitted, else positions.
    """
    names = law.TURNING if turning else law.NAMES
    picked = OF_TURNING if turning else np.arange(len(names))
    free = np.array([i for i, name in enumerate(names) if name not in fixed])
    problem = _Problem(segments, turning, np.array(start, float), free, STEPS[picked])
    low, high = LOW[picked][free], HIGH[picked][free]
    first = np.clip(np.array(start, float)[free], low + 1e-6, high - 1e-6)
    found = least_squares(
        lambda x: problem.at(x)[0].ravel(),
        first,
        lambda x: problem.at(x)[1].reshape(-1, len(free)),
        bounds=(low, high),
        x_scale=SCALES[picked][free],
        ftol=1e-5,
        xtol=1e-5,
        gtol=1e-9,
        max_nfev=40,
    )
    residual, jacobian, velocity = problem.at(found.x)
    residual, jacobian = residual[:, :-1], jacobian[:, :-1]
    value, error, bound = np.array(start, float), np.zeros(len(names)), np.zeros(len(names), bool)
    value[free] = found.x
    error[free] = _errors(residual, jacobian, segments, problem.taken)
    near = 1e-3 * SCALES[picked][free]
    bound[free] = (found.x < low + near) | (found.x > high - near)
    rms, noise, memory, unlikely = _whiteness(residual, segments.there)
    quantile = float(stats.t.ppf(0.975, max(len(segments) - 1, 1)))
    samples = int(segments.there.sum())
    each = np.sqrt((residual**2).sum((1, 2)) / (segments.there.sum(1) * residual.shape[-1]))
    return Fit(names, value, error, quantile, bound, rms, noise, memory, unlikely, velocity, samples, each)


class _Problem:
    """Residuals and their Jacobian, without what is free in each stretch."""

    def __init__(self, segments: Segments, turning: bool, start: Array, free: np.ndarray, steps: Array) -> None:
        self.segments, self.start, self.free, self.steps = segments, start, free, steps
        self.simulate: Callable[..., tuple[np.ndarray, np.ndarray]] = law.turn if turning else law.translate
        self.width = 1 if turning else 2  # real numbers of a position
        self.nudges = np.array([0, NUDGE] if turning else [0, NUDGE, 1j * NUDGE])
        self.measured = segments.angle if turning else segments.position
        self.taken = 2 * self.width * len(segments)  # numbers that are free in stretches
        self._first = first_states(segments, self.measured)[1]
        self._last: tuple[bytes, tuple[Array, Array, np.ndarray]] | None = None

    def at(self, x: Array) -> tuple[Array, Array, np.ndarray]:
        """Residuals (S, m + 1, width), Jacobian (S, m + 1, width, n), velocities (S, m); the last are of the tie."""
        if self._last is None or self._last[0] != x.tobytes():
            self._last = x.tobytes(), self._at(x)
        return self._last[1]

    def _at(self, x: Array) -> tuple[Array, Array, np.ndarray]:
        parameters = self.start.copy()
        parameters[self.free] = x
        k, n = len(self.nudges), len(x)
        _, _, found = self._projected(np.tile(parameters, (k, 1)), self._first, k)
        sets = np.tile(parameters, (k + n, 1))
        sets[k + np.arange(n), self.free] += self.steps[self.free]
        return (*self._projected(sets, self._first + found, k)[:2], self._velocity)

    def _projected(self, sets: Array, first: np.ndarray, k: int) -> tuple[Array, Array, np.ndarray]:
        """Residuals, derivatives by the parameters after the k-th set, and by how much first velocities are wrong."""
        there = self.segments.there
        starts = first[:, None] + np.append(self.nudges, np.zeros(len(sets) - k))
        ways, velocity = self.simulate(self.segments, sets, starts)
        self._velocity = velocity[:, 0]
        flat = self._flat(ways * there[:, None])  # (S, P, m width)
        measured = self._flat(np.where(there, self.measured, 0)[:, None])[:, 0]
        ones = self._flat(np.stack([there, 1j * there] if self.width == 2 else [there], 1))
        columns = np.concatenate([ones, (flat[:, 1:k] - flat[:, :1]) / NUDGE], 1)  # (S, 2 width, m width)
        tied = np.zeros((len(there), 2 * self.width, self.width))
        tied[:, self.width :] = TRUSTED_S * np.eye(self.width)
        q, r = np.linalg.qr(np.concatenate([columns, tied], 2).swapaxes(1, 2))

        def without(values: Array, off: Array) -> Array:  # (S, p, m width + width)
            both = np.concatenate([values, off], 2)
            return both - np.einsum("sij,spj->spi", q, np.einsum("sij,spi->spj", q, both))

        wrong = (flat[:, 0] - measured)[:, None]
        away = TRUSTED_S * self._flat((first - self._first)[:, None, None])
        both = np.concatenate([wrong, away], 2)[:, 0]
        solved = np.linalg.solve(r, -np.einsum("sij,si->sj", q, both)[..., None])[..., 0]
        velocities = solved[:, self.width :]
        change = velocities[:, 0] + (1j * velocities[:, 1] if self.width == 2 else 0)
        slopes = (flat[:, k:] - flat[:, :1]) / self.steps[self.free][: flat.shape[1] - k, None]
        slopes = without(slopes, np.zeros((*slopes.shape[:2], self.width)))
        shape = len(there), there.shape[1] + 1, self.width
        return without(wrong, away).reshape(shape), slopes.swapaxes(1, 2).reshape(*shape, -1), change

    def _flat(self, values: np.ndarray) -> Array:
        """(S, p, m) as real numbers (S, p, m width)."""
        if self.width == 1:
            return values.real.astype(float)
        return np.ascontiguousarray(values, complex).view(float)


def _errors(residual: Array, jacobian: Array, segments: Segments, taken: int) -> Array:
    """Standard errors (n,)."""
    n, there = jacobian.shape[-1], segments.there
    length = np.sqrt((jacobian**2).sum((0, 1, 2)))
    shown = length > 0
    error = np.full(n, np.inf)
    unit = jacobian[..., shown] / length[shown]
    _, sizes, basis = np.linalg.svd(unit.reshape(-1, shown.sum()), full_matrices=False)
    known = sizes > SINGULAR * sizes[:1]
    lost = (basis[~known] ** 2).sum(0) > 1e-3
    bread = (basis[known].T / sizes[known] ** 2) @ basis[known]
    count = there.sum() * residual.shape[-1]
    left = max(count - taken - shown.sum(), 1)
    white = np.diag(bread) * (residual**2).sum() / left
    scores = (unit * residual[..., None]).sum(2)  # (S, m, n)
    lags = min(max(1, round(MEMORY_S / segments.period)), there.shape[1] - 1)
    meat = np.einsum("smi,smj->ij", scores, scores)
    for lag in range(1, lags + 1):
        both = np.einsum("smi,smj->ij", scores[:, lag:], scores[:, :-lag])
        meat += (1 - lag / (lags + 1)) * (both + both.T)
    lasting = np.diag(bread @ meat @ bread) * count / left
    error[shown] = np.where(lost, np.inf, np.sqrt(np.maximum(white, lasting)) / length[shown])
    return error


def _whiteness(residual: Array, there: np.ndarray) -> tuple[float, float, float, float]:
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
    return float(np.sqrt(power)), float(noise), float(r[:5].mean()), unlikely
