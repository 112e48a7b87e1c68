"""Least squares of the law over stretches whose first pose and twist are free.

Poses that are predicted through each stretch are compared with measured ones; headings count in
metres, by the ratio of the noises. The first pose and twist of each stretch are eliminated by
projection (variable projection with Kaufman's Jacobian: Kaufman 1975, BIT 15, 49), so that scipy's
`least_squares` sees the law's parameters only. Residuals of a law last for more than one sample,
so standard errors are those of sums over whole stretches (Liang and Zeger 1986, Biometrika 73, 13),
or of white noise where those are larger; intervals are Student's. If the law lacks something of
the robot, standard errors grow by the ratio of lasting residuals to what is allowed.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares
from scipy.special import stdtrit
from scipy.stats import norm

from omni_control.kinematics import Array
from omni_mj.studies.identify.log_segments import LEAST, Stretches
from omni_mj.studies.identify.slip_dynamics import LATE, Body, Parameters, simulate

# Name -> size of a change that matters, step of finite differences, lowest and highest value.
RANGES = {
    "creep": (0.2, 1e-2, 0.0, 20.0),
    "rolling_resistance": (0.02, 1e-3, -0.2, 1.0),
    "roller_friction": (0.02, 1e-3, -0.2, 1.0),
    "scale": (0.05, 1e-3, 0.4, 2.5),
    "arm": (0.05, 1e-3, 0.4, 2.5),
    "compass_rad": (0.05, 1e-3, -1.0, 1.0),
    "give_s": (0.02, 2e-4, 1e-4, 1.0),
    "friction_m_s": (0.05, 1e-3, -0.2, 0.4),
    "turn_rate_gain": (0.3, 1e-2, -0.5, 10.0),
    "lean_x_m_s2": (0.1, 1e-2, -2.0, 2.0),
    "lean_y_m_s2": (0.1, 1e-2, -2.0, 2.0),
    LATE: (0.01, 1e-4, -0.5, 0.6),
}
NUDGES = 0.02 * np.eye(4)  # of first heading and twist, rad, m/s and rad/s
NEGLIGIBLE = 1e-3  # of a column of first states, over the largest, below which it is not solved for
LAGS, ALARM = 5, 0.01  # samples over which residuals last; chance of a false alarm
ALLOWED = {
    True: (0.3e-3, 2.5e-3),
    False: (0.6e-3, 4e-3),
}  # by wheels, by commands: what lasts of 95 % of our logs
ODD, MOST_ODD = (
    3.0,
    0.25,
)  # residuals over their median, and share, of stretches that may be left out


@dataclass(frozen=True)
class Residuals:
    """Residuals of positions in m, or headings in rad.

    Attributes:
        rms: Root mean square.
        noise: The part that changes from sample to sample.
        lasting: Root of the mean covariance of samples up to `LAGS` apart, which noise does not
            have.
        allowed: The part that lasts where the law describes the robot.
        misfit: Whether more lasts, sure to `ALARM`.
    """

    rms: float
    noise: float
    lasting: float
    allowed: float
    misfit: bool


@dataclass(frozen=True)
class Fit:
    """Result of a fit.

    Attributes:
        free: Names of the n parameters that are fitted.
        covariance: Of these, (n, n); huge for what the data do not show.
        parameters: All of the law's, by name; see `Body.parameters`.
        quantile: Student's, for 95 % intervals.
        at_bound: Names of parameters that stopped at a bound.
        residuals: Of "positions" in m and "headings" in rad.
        usual: Stretches whose residuals are not far larger than the others', (S,).
        body: Fitted with.
        stretches: Fitted to.
    """

    free: Sequence[str]
    covariance: Array
    parameters: Parameters
    quantile: float
    at_bound: frozenset[str]
    residuals: dict[str, Residuals]
    usual: np.ndarray
    body: Body
    stretches: Stretches

    @property
    def misfit(self) -> bool:
        """Whether the law lacks something of this robot."""
        return any(r.misfit for r in self.residuals.values())


class Problem:
    """Residuals and their Jacobian, without what the first pose and twist of each stretch explain.

    Args:
        body: The robot.
        stretches: S of them.
        start: Parameters of the law by name.
        free: Names of those that are fitted.

    Attributes:
        jacobian: By free parameters at the last point, (S, m, 3, n).
        metres: Of a residual per unit of x, y and heading, (3,).
    """

    def __init__(
        self, body: Body, stretches: Stretches, start: Parameters, free: Sequence[str]
    ) -> None:
        self.body, self.stretches, self.start, self.free = body, stretches, start, free
        self.scale, self.steps, self.low, self.high = np.array([RANGES[name] for name in free]).T
        noise = np.median(np.abs(_changes(stretches.pose)), axis=(0, 1))
        self.metres = np.array([1.0, 1.0, noise[:2].mean() / max(noise[2], 1e-6)])
        self.first = stretches.estimate_first()
        self.jacobian = np.empty(0)

    def parameters(self, x: Array) -> Parameters:
        """Return all parameters for free ones."""
        return self.start | dict(zip(self.free, x.tolist(), strict=True))

    def residual(self, x: Array) -> Array:
        """Return residuals (S, m, 3) in metres for free parameters."""
        n, (count, m) = (
            5 + len(self.free),
            self.stretches.time.shape,
        )  # sets: nominal, four first states, parameters
        sets = {name: np.full((n, 1), value) for name, value in self.parameters(x).items()}
        for i, name in enumerate(self.free):
            sets[name][5 + i] += self.steps[i]
        first = np.tile(self.first[:, None], (1, n, 1, 1))
        first[:, 1:5, 0, 2] += NUDGES[:, 0]
        first[:, 1:5, 1] += NUDGES[:, 1:]
        poses = simulate(self.body, self.stretches, sets, first)
        flat = (poses * self.metres).reshape(count, n, 3 * m)
        slopes = (flat[:, 1:] - flat[:, :1]) / np.concatenate([NUDGES.diagonal(), self.steps])[
            :, None
        ]
        places = np.tile(np.eye(3)[:2], m)[None].repeat(count, 0)
        states = np.concatenate([places, slopes[:, :4]], 1)
        wrong = flat[:, :1] - (self.stretches.pose * self.metres).reshape(count, 1, 3 * m)
        columns = np.concatenate([wrong, slopes[:, 4:]], 1)
        columns -= columns @ np.linalg.pinv(states, rcond=NEGLIGIBLE) @ states
        columns = columns.reshape(count, -1, m, 3)
        self.jacobian = np.moveaxis(columns[:, 1:], 1, -1)
        residual: Array = columns[:, 0]
        return residual

    def solve(self, x: Array) -> Array:
        """Return what minimizes the squares."""
        solution: Array = least_squares(
            lambda x: self.residual(x).ravel(),
            np.clip(x, self.low + 1e-3 * self.scale, self.high - 1e-3 * self.scale),
            lambda x: self.jacobian.reshape(-1, len(x)),
            bounds=(self.low, self.high),
            x_scale=self.scale,
            ftol=1e-5,
            xtol=1e-5,
            gtol=1e-9,
            max_nfev=40,
        ).x
        return solution


def fit(body: Body, stretches: Stretches, start: Parameters, free: Sequence[str]) -> Fit:
    """Fit the law to stretches.

    Args:
        body: The robot.
        stretches: At least two.
        start: Parameters by name.
        free: Names of those that are fitted.
    """
    problem = Problem(body, stretches, start, free)
    x = problem.solve(np.array([start[name] for name in free]))
    residual = problem.residual(x)
    allowed = ALLOWED[stretches.are_wheels]
    residuals = {
        "positions": measure(residual[..., :2], allowed[0]),
        "headings": measure(residual[..., 2:] / problem.metres[2], allowed[1]),
    }
    lacking = max([1.0, *(r.lasting / r.allowed for r in residuals.values() if r.misfit)])
    bound = (x < problem.low + 2e-3 * problem.scale) | (x > problem.high - 2e-3 * problem.scale)
    rms = np.sqrt((residual**2).mean((1, 2)))
    return Fit(
        free=free,
        covariance=lacking**2 * covariance(problem.jacobian, residual),
        parameters=problem.parameters(x),
        quantile=float(stdtrit(len(stretches) - 1, 0.975)),
        at_bound=frozenset(np.array(free)[bound].tolist()),
        residuals=residuals,
        usual=rms <= ODD * np.median(rms),
        body=body,
        stretches=stretches,
    )


def fit_usual(body: Body, stretches: Stretches, start: Parameters, free: Sequence[str]) -> Fit:
    """Fit the law, and again without stretches of far larger residuals if there are a few; see `fit`."""
    result = fit(body, stretches, start, free)
    usual = result.usual
    if usual.all() or usual.mean() < 1 - MOST_ODD or usual.sum() < LEAST:
        return result
    return fit(body, stretches.select(usual), result.parameters, free)


def measure(values: Array, allowed: float) -> Residuals:
    """Measure residuals (S, m, k), of which `allowed` may last."""
    products = [values[:, lag:] * values[:, :-lag] for lag in range(1, LAGS + 1)]
    power, lasting = (
        float((values**2).mean()),
        float(np.mean([product.mean() for product in products])),
    )
    error = (power - max(lasting, 0.0)) / sum(product.size for product in products) ** 0.5
    misfit = bool(lasting > allowed**2 + norm.isf(ALARM) * error)
    noise = float((_changes(values) ** 2).mean()) ** 0.5
    return Residuals(power**0.5, noise, max(lasting, 0.0) ** 0.5, allowed, misfit)


def covariance(jacobian: Array, residual: Array) -> Array:
    """Return the covariance (n, n) of parameters by Jacobian (S, m, 3, n) and residuals (S, m, 3); see the module."""
    n = jacobian.shape[-1]
    length = np.maximum(np.sqrt((jacobian**2).sum((0, 1, 2))), 1e-9)
    unit = jacobian / length
    flat = unit.reshape(-1, n)
    bread = np.linalg.inv(flat.T @ flat + 1e-12 * np.eye(n))
    freedom = residual.size / max(residual.size - 6 * len(residual) - n, 1)
    scores = bread @ np.einsum("smkn,smk->ns", unit, residual)
    robust = scores @ scores.T * freedom
    white = np.diag(bread) * (residual**2).mean() * freedom
    larger = np.sqrt(np.maximum(white / np.maximum(np.diag(robust), 1e-300), 1.0)) / length
    return robust * np.outer(larger, larger)


def _changes(values: Array) -> Array:
    """Return second differences of (S, m, k) over those of white noise of variance 1."""
    return np.diff(values, 2, axis=1) / 6**0.5
