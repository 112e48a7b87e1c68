"""Residuals of a fit: how large they are, what of them is noise, and what lasts: of that, what the law may lack."""

from dataclasses import dataclass

import numpy as np
from scipy.special import ndtr

from omni_control.kinematics import Array

LAGS = 5  # samples, over which what lasts is looked for
ALARM = 0.01  # chance of a misfit that is none, of each kind of residuals


@dataclass(frozen=True)
class Lacks:
    """What of residuals is allowed to last, of positions in m and of headings in rad.

    What the law lacks on robots of our own plant, of which it is the law: 95 % of logs are below it
    (`tests/bench_identify_coverage.py`, logs 1000 to 1019 and 3000 to 3039).
    """

    position: float
    heading: float


WHEELS, COMMANDS = Lacks(0.3e-3, 2.5e-3), Lacks(0.6e-3, 4e-3)


@dataclass(frozen=True)
class Residuals:
    """Of one kind.

    Attributes:
        rms: root mean square, m or rad; noise: what of it changes from sample to sample.
        lasting: root of the mean covariance of samples up to 5 apart, m or rad: what noise does not do.
        allowed: what the law may lack, of the same.
        unlikely: chance that as much lasts where the law lacks no more than that.
    """

    rms: float
    noise: float
    lasting: float
    allowed: float
    unlikely: float

    @property
    def misfit(self) -> bool:
        """Whether the law lacks something that it does not on robots which it describes."""
        return self.unlikely < ALARM


def residuals(each: Array, there: np.ndarray, allowed: float) -> Residuals:
    """Of residuals (S, m, k) at the samples that are there (S, m).

    White noise of the variance s^2 gives a mean covariance over L lags of N pairs each the variance s^4 / (L N).
    """
    count = max(int(there.sum()) * each.shape[-1], 1)
    power = float((each**2).sum()) / count
    covariances, pairs = list[float](), 0
    for lag in range(1, min(LAGS, there.shape[1] - 1) + 1):
        both = int((there[:, lag:] & there[:, :-lag]).sum()) * each.shape[-1]
        covariances.append(float((each[:, lag:] * each[:, :-lag]).sum()) / max(both, 1))
        pairs += both
    lasting = float(np.mean(covariances)) if covariances else 0.0
    three = there[:, 2:] & there[:, 1:-1] & there[:, :-2]
    second = (each[:, 2:] - 2 * each[:, 1:-1] + each[:, :-2])[three]
    changes = float(np.sqrt((second**2).mean() / 6)) if second.size else 0.0
    error = max(power - max(lasting, 0.0), 1e-30) / np.sqrt(max(pairs, 1))
    unlikely = float(ndtr((allowed**2 - lasting) / error))
    return Residuals(float(np.sqrt(power)), changes, float(np.sqrt(max(lasting, 0.0))), allowed, unlikely)


def noise(values: np.ndarray, there: np.ndarray) -> float:
    """What changes from sample to sample: standard deviation, by second differences, of each real number."""
    three = there[:, 2:] & there[:, 1:-1] & there[:, :-2]
    second = (values[:, 2:] - 2 * values[:, 1:-1] + values[:, :-2])[three]
    numbers = 2 if np.iscomplexobj(values) else 1
    return (
        float(np.sqrt(np.median(np.abs(second) ** 2) / (6 * (1.386 if numbers == 2 else 0.455))))
        if second.size
        else 0.0
    )
