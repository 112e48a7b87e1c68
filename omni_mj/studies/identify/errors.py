"""Covariances of what was fitted to residuals that last.

What the law does not know lasts for more than one sample, so that errors as from white noise would be too small.
Standard errors are those of Newey and West (1987, Econometrica 55, 703): scores are summed over lags of up to 1/2 s
within a stretch; where white noise gives the larger ones, those. Both with the degrees of freedom that are left.
"""

from collections.abc import Sequence

import numpy as np

from omni_control.kinematics import Array
from omni_mj.studies.identify.segments import Segments

MEMORY_S = 0.5  # lags of scores that are summed
SINGULAR = 1e-5  # singular value over the largest, of columns of length 1, below which nothing is known


def covariance(residual: Array, jacobian: Array, segments: Segments, taken: int) -> Array:
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
    lasts = bread @ lasting(scores, segments) @ bread * count / left
    more = np.sqrt(np.maximum(np.diag(white), 1e-300) / np.maximum(np.diag(lasts), 1e-300))
    both = lasts * np.outer(np.maximum(more, 1.0), np.maximum(more, 1.0))
    lost = (basis[~known] ** 2).sum(0) > 1e-3
    both[lost, :] = both[:, lost] = 0.0
    both[lost, lost] = np.inf
    covariance = np.zeros((n, n))
    covariance[~shown, ~shown] = np.inf
    covariance[np.ix_(shown, shown)] = both / np.outer(length[shown], length[shown])
    return covariance


def lasting(scores: Array, segments: Segments) -> Array:
    """Covariance of the sum of scores (S, m, n), each of which is like those before it, (n, n)."""
    lags = min(max(1, round(MEMORY_S / segments.period)), scores.shape[1] - 1)
    meat: Array = np.einsum("smi,smj->ij", scores, scores)
    for lag in range(1, lags + 1):
        both = np.einsum("smi,smj->ij", scores[:, lag:], scores[:, :-lag])
        meat += (1 - lag / (lags + 1)) * (both + both.T)
    return meat


def regress(rows: Sequence[Array], values: Sequence[Array], lags: Sequence[int]) -> tuple[Array, Array]:
    """Least squares of pieces in time, rows (m, W, n) and values (m, W), and errors by Newey and West."""
    x, y = np.concatenate([r.reshape(-1, r.shape[-1]) for r in rows]), np.concatenate([v.ravel() for v in values])
    inverse = np.linalg.pinv(x.T @ x)
    found = inverse @ (x.T @ y)
    meat = np.zeros_like(inverse)
    for row, value, most in zip(rows, values, lags, strict=True):
        scores = (row * (value - row @ found)[..., None]).sum(1)
        meat += scores.T @ scores
        for lag in range(1, min(most, len(scores) - 1) + 1):
            both = scores[lag:].T @ scores[:-lag]
            meat += (1 - lag / (most + 1)) * (both + both.T)
    return found, np.sqrt(np.maximum(np.diag(inverse @ meat @ inverse), 0.0))
