"""Least-squares fit of the slip dynamics to segments with free initial states.

Poses predicted through each segment are compared with measured ones. Residuals of headings are
weighted by the ratio of position noise to heading noise. The initial pose and twist of each segment
are eliminated by variable projection with Kaufman's Jacobian (Kaufman 1975, BIT 15, 49). So scipy's
`least_squares` solves for the parameters only.

Residuals caused by an error of the model are correlated over several samples. So standard errors
are clustered by segment (Liang and Zeger 1986, Biometrika 73, 13), or those of white noise where
these are larger. Intervals use Student's t. If the model lacks a property of the robot, standard
errors grow by the ratio of persistent residuals to their allowed size.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from scipy.optimize import least_squares
from scipy.special import ndtri, stdtrit

from omni_control.kinematics import Array
from omni_mj.studies.identify.log_segments import MIN_SEGMENTS, LogSegments
from omni_mj.studies.identify.slip_dynamics import (
    DEAD_TIME,
    Parameters,
    RobotDynamics,
    simulate_segments,
)


class ParameterRange(NamedTuple):
    """Bounds, step sizes and prior error of a parameter, in its unit.

    Attributes:
        scale: Size of a relevant change, for the trust region and tolerances.
        step: Step of finite differences.
        low: Smallest value.
        high: Largest value.
        prior_error: Standard error of the value that the robot's file gives.
    """

    scale: float
    step: float
    low: float
    high: float
    prior_error: float


RANGES = {
    "creep_compliance": ParameterRange(0.2, 1e-2, 0.0, 20.0, 0.1),
    "rolling_resistance": ParameterRange(0.02, 1e-3, -0.2, 1.0, 0.015),
    "roller_friction": ParameterRange(0.02, 1e-3, -0.2, 1.0, 0.06),
    "scale": ParameterRange(0.05, 1e-3, 0.4, 2.5, 0.03),
    "arm": ParameterRange(0.05, 1e-3, 0.4, 2.5, 0.05),
    "heading_offset_rad": ParameterRange(0.05, 1e-3, -1.0, 1.0, 0.5),
    "compliance_s": ParameterRange(0.02, 2e-4, 1e-4, 1.0, 0.04),
    "dry_friction_m_s": ParameterRange(0.05, 1e-3, -0.2, 0.4, 0.03),
    "turn_rate_gain": ParameterRange(0.3, 1e-2, -0.5, 10.0, 1.0),
    "slope_x_m_s2": ParameterRange(0.1, 1e-2, -2.0, 2.0, 0.1),
    "slope_y_m_s2": ParameterRange(0.1, 1e-2, -2.0, 2.0, 0.1),
    DEAD_TIME: ParameterRange(0.01, 1e-4, -0.5, 0.6, 0.5),
}
# Steps of finite differences of the initial heading in rad and twist in m/s and rad/s
INITIAL_STEPS = 0.02 * np.eye(4)
# Singular values of the initial states below this fraction of the largest are treated as zero.
RANK_TOLERANCE = 1e-3
MAX_LAG = 5  # samples; largest shift at which the covariance of residuals is measured
FALSE_ALARM_RATE = 0.01  # probability of a misfit although the model describes the robot
# Allowed persistent residuals of positions in m and headings in rad. They are the 95 % quantiles
# over simulated logs.
ALLOWED = {"wheels": (0.3e-3, 2.5e-3), "commands": (0.6e-3, 4e-3)}
# A segment whose residual exceeds this multiple of the median is an outlier. Outliers are left out
# unless they exceed this fraction of all segments.
OUTLIER_RATIO, MAX_OUTLIER_FRACTION = 3.0, 0.25


@dataclass(frozen=True)
class Residuals:
    """Residuals of positions in m, or of headings in rad.

    Attributes:
        rms: Root mean square.
        noise: Standard deviation of the white part.
        persistent: Square root of the mean covariance between samples that are 1 to `MAX_LAG`
            apart; 0 for white noise.
        allowed: Largest value of `persistent` for a robot that the model describes.
        misfit: Whether `persistent` exceeds `allowed` significantly; see `FALSE_ALARM_RATE`.
    """

    rms: float
    noise: float
    persistent: float
    allowed: float
    misfit: bool


@dataclass(frozen=True)
class Prior:
    """Knowledge of n parameters before a fit, as independent normal distributions.

    Attributes:
        mean: Means, (n,).
        error: Standard errors, (n,).
    """

    mean: Array
    error: Array

    def combine(self, values: Array, covariance: Array) -> tuple[Array, Array]:
        """Return mean and covariance of the parameters after the data are known.

        Args:
            values: Estimates by the data, (n,).
            covariance: Their covariance, (n, n).
        """
        unit = np.outer(self.error, self.error)
        normalized = covariance / unit
        total = normalized + np.eye(len(values))
        deviation = np.linalg.solve(total, (values - self.mean) / self.error)
        return self.mean + self.error * deviation, np.linalg.solve(total, normalized) * unit


@dataclass(frozen=True)
class Fit:
    """Result of a fit.

    Attributes:
        problem: The problem that was solved.
        values: Values of the n fitted parameters, (n,).
        covariance: Covariance of the fitted parameters, (n, n); huge for parameters that the data
            do not determine, before a prior is applied.
        misfit_ratio: Ratio by which a misfit enlarges standard errors, at least 1.
        quantile: Half width of a 95 % interval over the standard error, by Student's t.
        at_bound: Names of the fitted parameters that stopped at a bound.
        residuals: Residuals of "positions" in m and "headings" in rad.
    """

    problem: "ProjectedProblem"
    values: Array
    covariance: Array
    misfit_ratio: float
    quantile: float
    at_bound: frozenset[str]
    residuals: dict[str, Residuals]

    @property
    def misfit(self) -> bool:
        """Whether the model lacks a property of this robot."""
        return any(residuals.misfit for residuals in self.residuals.values())

    @property
    def parameters(self) -> Parameters:
        """All parameters by name; see `RobotDynamics.nominal_parameters`."""
        return self.problem.parameters(self.values)

    def with_prior(self, prior: Prior) -> "Fit":
        """Return the fit combined with a prior. A misfit enlarges standard errors only."""
        values = prior.combine(self.values, self.covariance)[0]
        covariance = prior.combine(self.values, self.misfit_ratio**2 * self.covariance)[1]
        return replace(self, values=values, covariance=covariance)


class ProjectedProblem:
    """Least-squares problem in the parameters, with the initial states projected out.

    Args:
        dynamics: The robot.
        segments: S segments.
        start: Initial parameters by name.
        free: Names of the n parameters that are fitted.

    Attributes:
        jacobian: Derivatives of the residuals by the free parameters at the last evaluated point,
            (S, m, 3, n).
        weights: Weights of residuals of x, y and heading, (3,).
        start_values: Initial values of the free parameters, (n,).
    """

    def __init__(
        self,
        dynamics: RobotDynamics,
        segments: LogSegments,
        start: Parameters,
        free: Sequence[str],
    ) -> None:
        self.dynamics, self.segments, self.start, self.free = dynamics, segments, start, free
        self.start_values = np.array([start[name] for name in free])
        ranges = np.array([RANGES[name] for name in free]).T
        self.scale, self.steps, self.low, self.high = ranges[:4]
        white = np.abs(_white_differences(segments.pose)).reshape(-1, 3)
        # Values that rest have no noise.
        noise = np.array(
            [np.median(column[column > 0]) if column.any() else 0 for column in white.T]
        )
        noise = np.maximum(noise, segments.noise_floor)
        self.weights = np.array([1.0, 1.0, max(noise[:2].mean(), 1e-6) / max(noise[2], 1e-6)])
        self.initial_states = segments.estimate_initial_states()
        self.jacobian = np.empty(0)

    def parameters(self, x: Array) -> Parameters:
        """Return all parameters by name, for values x (n,) of the free ones."""
        return self.start | dict(zip(self.free, x.tolist(), strict=True))

    def residual(self, x: Array) -> Array:
        """Return weighted residuals (S, m, 3) for free parameters x, and update the Jacobian.

        Predictions change linearly with the initial position and, to first order, with the initial
        heading and twist. So the best initial state is a linear least-squares solution, and its
        contribution is subtracted from residuals and derivatives.
        """
        count, m = self.segments.time.shape
        predicted = self._perturbed_predictions(x)
        steps = np.concatenate([INITIAL_STEPS.diagonal(), self.steps])[:, None]
        derivatives = (predicted[:, 1:] - predicted[:, :1]) / steps
        position_derivatives = np.tile(np.eye(3)[:2], m)[None].repeat(count, 0)
        states = np.concatenate([position_derivatives, derivatives[:, :4]], 1)
        measured = (self.segments.pose * self.weights).reshape(count, 1, 3 * m)
        columns = np.concatenate([predicted[:, :1] - measured, derivatives[:, 4:]], 1)
        columns -= columns @ np.linalg.pinv(states, rcond=RANK_TOLERANCE) @ states
        columns = columns.reshape(count, -1, m, 3)
        self.jacobian = np.moveaxis(columns[:, 1:], 1, -1)
        return columns[:, 0]

    def _perturbed_predictions(self, x: Array) -> Array:
        """Return weighted poses predicted for a parameter vector x and its perturbations.

        Returns:
            Poses (S, 5 + n, 3 m): without perturbation, with perturbed initial heading and twist
            (four), and with each free parameter perturbed (n).
        """
        n, (count, m) = 5 + len(self.free), self.segments.time.shape
        sets = {name: np.full((n, 1), value) for name, value in self.parameters(x).items()}
        for i, name in enumerate(self.free):
            sets[name][5 + i] += self.steps[i]
        initial = np.tile(self.initial_states[:, None], (1, n, 1, 1))
        initial[:, 1:5, 0, 2] += INITIAL_STEPS[:, 0]
        initial[:, 1:5, 1] += INITIAL_STEPS[:, 1:]
        poses = simulate_segments(self.dynamics, self.segments, sets, initial)
        return (poses * self.weights).reshape(count, n, 3 * m)

    def solve(self) -> Array:
        """Return the free parameters with the smallest squared residuals, (n,)."""
        return least_squares(
            lambda x: self.residual(x).ravel(),
            np.clip(self.start_values, self.low + 1e-3 * self.scale, self.high - 1e-3 * self.scale),
            lambda x: self.jacobian.reshape(-1, len(x)),
            bounds=(self.low, self.high),
            x_scale=self.scale,
            ftol=1e-5,
            xtol=1e-5,
            gtol=1e-9,
            max_nfev=40,
        ).x


def fit_parameters(
    dynamics: RobotDynamics,
    segments: LogSegments,
    start: Parameters,
    free: Sequence[str],
    drop_outliers: bool = True,
) -> Fit:
    """Fit the slip dynamics to segments.

    Args:
        dynamics: The robot.
        segments: At least two segments.
        start: Initial parameters by name.
        free: Names of the parameters that are fitted.
        drop_outliers: Whether to fit again without the outliers if there are only a few.
    """
    problem = ProjectedProblem(dynamics, segments, start, free)
    x = problem.solve()
    residual = problem.residual(x)
    rms = np.sqrt((residual**2).mean((1, 2)))
    is_inlier = rms <= OUTLIER_RATIO * np.median(rms)
    has_few_outliers = 1 > is_inlier.mean() >= 1 - MAX_OUTLIER_FRACTION
    if drop_outliers and has_few_outliers and is_inlier.sum() >= MIN_SEGMENTS:
        inliers = segments.select(is_inlier)
        return fit_parameters(dynamics, inliers, problem.parameters(x), free, False)
    # Errors of rounding persist while the robot is slow.
    floor_m, _, floor_rad = segments.noise_floor
    allowed_m, allowed_rad = np.hypot(ALLOWED[segments.source], [floor_m, floor_rad]).tolist()
    residuals = {
        "positions": measure_residuals(residual[..., :2], allowed_m),
        "headings": measure_residuals(residual[..., 2:] / problem.weights[2], allowed_rad),
    }
    is_low = x < problem.low + 2e-3 * problem.scale
    is_high = x > problem.high - 2e-3 * problem.scale
    return Fit(
        problem=problem,
        values=x,
        covariance=robust_covariance(problem.jacobian, residual),
        misfit_ratio=max(r.persistent / r.allowed if r.misfit else 1.0 for r in residuals.values()),
        quantile=float(stdtrit(len(segments) - 1, 0.975)),
        at_bound=frozenset(np.array(free)[is_low | is_high].tolist()),
        residuals=residuals,
    )


def measure_residuals(values: Array, allowed: float) -> Residuals:
    """Return the statistics of residuals (S, m, k).

    Args:
        values: Residuals, m or rad.
        allowed: See `Residuals.allowed`.
    """
    products = [values[:, lag:] * values[:, :-lag] for lag in range(1, MAX_LAG + 1)]
    power = float((values**2).mean())
    covariance = float(np.mean([product.mean() for product in products]))
    n_products = sum(product.size for product in products)
    error = (power - max(covariance, 0.0)) / n_products**0.5
    misfit = bool(covariance > allowed**2 - ndtri(FALSE_ALARM_RATE) * error)
    noise = float((_white_differences(values) ** 2).mean()) ** 0.5
    return Residuals(power**0.5, noise, max(covariance, 0.0) ** 0.5, allowed, misfit)


def robust_covariance(jacobian: Array, residual: Array) -> Array:
    """Return the covariance (n, n) of parameters, robust to correlation within segments.

    Args:
        jacobian: Derivatives of the residuals, (S, m, 3, n).
        residual: Weighted residuals, (S, m, 3).
    """
    n = jacobian.shape[-1]
    # Columns are normalized to length 1, so that the inverse is accurate for any units.
    length = np.maximum(np.sqrt((jacobian**2).sum((0, 1, 2))), 1e-9)
    unit = jacobian / length
    flat = unit.reshape(-1, n)
    inverse = np.linalg.inv(flat.T @ flat + 1e-12 * np.eye(n))
    # Correction for the degrees of freedom: six initial states per segment, and n parameters
    freedom = residual.size / max(residual.size - 6 * len(residual) - n, 1)
    scores = inverse @ np.einsum("smkn,smk->ns", unit, residual)
    robust = scores @ scores.T * freedom
    white = np.diag(inverse) * (residual**2).mean() * freedom
    error = np.sqrt(np.maximum(np.diag(robust), white))
    # Correlations of n parameters are known from many more than n segments only.
    weight = min(1.0, n / len(residual))
    correlation = weight * _to_correlation(inverse) + (1 - weight) * _to_correlation(robust)
    return correlation * np.outer(error / length, error / length)


def _to_correlation(covariance: Array) -> Array:
    """Return the correlations of a covariance (n, n)."""
    deviation = np.maximum(np.sqrt(np.diag(covariance)), 1e-150)
    return covariance / np.outer(deviation, deviation)


def _white_differences(values: Array) -> Array:
    """Return second differences of (S, m, k), scaled so that white noise keeps its variance."""
    return np.diff(values, 2, axis=1) / 6**0.5
