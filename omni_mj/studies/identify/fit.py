"""Least squares of the law over stretches whose first pose and twist are free, by scipy.

Output errors are fitted: poses predicted from the first sample to the last of each stretch, against poses measured;
headings count in metres, by the ratio of both noises. scipy's `least_squares` sees the law's parameters only; what is
free in each stretch alone is solved for (`projected`). Errors are those of residuals that last (`errors`). Intervals
are Student's, a degree of freedom for each stretch but one.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares
from scipy.special import stdtrit

from omni_control.kinematics import Array
from omni_mj.studies.identify import law
from omni_mj.studies.identify.errors import covariance
from omni_mj.studies.identify.projected import WIDTH, Problem
from omni_mj.studies.identify.residuals import COMMANDS, WHEELS, Residuals, residuals
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
    "lean_x_m_s2": (0.1, 1e-2, -2.0, 2.0),
    "lean_y_m_s2": (0.1, 1e-2, -2.0, 2.0),
    LATE: (0.01, 1e-4, -0.5, 0.6),
}
ROUGH_S = 0.02  # steps in which a fit begins


@dataclass(frozen=True)
class Fit:
    """What came out.

    Attributes:
        names: of the parameters that were free, n; latencies first, one or one for each log.
        value: (n,).
        covariance: (n, n); of what the data say nothing, infinite.
        parameters: all of the law's (see `law.simulate`), and `late` (logs,).
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
    position: Residuals
    heading: Residuals
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
        """Whether the law lacks more than it does on robots which it describes."""
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
        start: parameters as `law.simulate` has them.
        late: of inputs, one for all logs or one for each, s.
        free: names of `law.NAMES` that are fitted beside latencies.
        fixed: values of others than in `start`.
        rough: whether long steps will do, for values to start from.
    """
    base = np.array(start, float)
    for name, value in fixed.items():
        base[law.NAMES.index(name)] = value
    names = (*[LATE] * len(late), *free)
    scale, steps, low, high = np.array([RANGES[name] for name in names]).T
    problem = Problem(body, segments, base, len(late), [law.NAMES.index(name) for name in free], steps)
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
    bound = (found.x < low + 2e-3 * scale) | (found.x > high - 2e-3 * scale)
    parameters = base.copy()
    parameters[problem.free] = found.x[len(late) :]
    lacks = WHEELS if segments.wheels else COMMANDS
    each = np.sqrt((residual**2).sum((1, 2)) / (segments.there.sum(1) * WIDTH))
    return Fit(
        names,
        found.x,
        covariance(residual, jacobian, segments, problem.taken),
        parameters,
        found.x[: len(late)],
        float(stdtrit(max(len(segments) - 1, 1), 0.975)),
        bound,
        residuals(residual[..., :2], segments.there, lacks.position),
        residuals(residual[..., 2:] / problem.metres, segments.there, lacks.heading),
        twist,
        int(segments.there.sum()),
        each,
        residual,
        jacobian[..., : len(late)].sum(-1),
        problem.metres,
    )
