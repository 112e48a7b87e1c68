"""Test a fit on segments that it has not seen, next to the values of the start robot.

Segments in which the robot stands still test nothing and are left out. The others are divided into
folds, and each fold is predicted by a fit to the other segments. One Gauss-Newton step leads to it
from the fit to all segments.
"""

from dataclasses import dataclass

import numpy as np

from omni_control.kinematics import Array
from omni_mj.studies.identify.parameter_fit import Fit, Prior, ProjectedProblem
from omni_mj.studies.identify.slip_dynamics import DEAD_TIME, Parameters

N_FOLDS = 4
MIN_DISTANCE_M, MIN_ANGLE_RAD = 0.1, 0.3  # of a segment in which the robot moves
CLOCK_AND_CAMERA = (DEAD_TIME, "heading_offset_rad")  # properties of a log, not of the robot


@dataclass(frozen=True)
class Prediction:
    """Root mean square errors of positions that are predicted in segments with motion.

    Attributes:
        n_segments: Number of segments.
        fitted_m: Error of fits that have not seen the segments, m.
        start_m: Error of the start robot's values, m.
    """

    n_segments: int
    fitted_m: float
    start_m: float


def cross_validate(fit: Fit, prior: Prior, start: Parameters) -> Prediction | None:
    """Return the errors of predictions, or None if there are too few segments with motion.

    Args:
        fit: Fit to all segments, without prior.
        prior: Prior of the fit.
        start: Parameters of the start robot. Clock and heading offset are fitted.
    """
    problem = fit.problem
    pose = problem.segments.pose
    distance = np.hypot(*np.ptp(pose[..., :2], axis=1).T)
    is_moving = (distance > MIN_DISTANCE_M) | (np.ptp(pose[..., 2], axis=1) > MIN_ANGLE_RAD)
    if is_moving.sum() < N_FOLDS:
        return None
    start_problem = ProjectedProblem(
        problem.dynamics,
        problem.segments.select(is_moving),
        start | {name: fit.parameters[name] for name in CLOCK_AND_CAMERA},
        CLOCK_AND_CAMERA,
    )
    start_residual = start_problem.residual(start_problem.solve())
    errors = _predict_folds(fit, prior, np.where(is_moving, np.cumsum(is_moving) % N_FOLDS, -1))
    return Prediction(int(is_moving.sum()), _rms(errors), _rms(start_residual[..., :2]))


def _predict_folds(fit: Fit, prior: Prior, folds: np.ndarray) -> Array:
    """Return the errors of positions in all folds, each by a fit to the other segments, (n, m, 2).

    Args:
        fit: Fit to all segments, without prior.
        prior: Prior of the fit.
        folds: Fold of each segment, or -1, (S,).
    """
    problem = fit.problem
    residual = problem.residual(fit.values)
    covariance = N_FOLDS / (N_FOLDS - 1) * fit.covariance
    # Columns are scaled, so that singular values are comparable.
    jacobian = problem.jacobian * problem.scale
    errors = []
    for fold in range(N_FOLDS):
        is_test = folds == fold
        train = jacobian[~is_test].reshape(-1, len(fit.values))
        # At the fit to all segments, the gradients of training and test add up to zero.
        gradient = np.einsum("smkn,smk->n", jacobian[is_test], residual[is_test])
        step = np.linalg.pinv(train.T @ train, rcond=1e-9, hermitian=True) @ gradient
        x_fold = prior.combine(fit.values + problem.scale * step, covariance)[0]
        x_fold = np.clip(x_fold, problem.low, problem.high)
        errors.append(problem.residual(x_fold)[is_test, :, :2])
    return np.concatenate(errors)


def _rms(errors: Array) -> float:
    """Return the root mean square distance of errors (n, m, 2)."""
    return float(np.sqrt((errors**2).sum(-1).mean()))
