"""Whether one wheel is not as the others: its radius or encoder, or the stiffness of its loop.

The law lets all wheels be alike. Of each wheel by itself it is tested how far it is not, without another fit: of the
residuals r and the derivative c by that, less what the fitted parameters could do as well, the share is -c r / c^2
(a score test, Rao 1948, Proc. Camb. Phil. Soc. 44, 50, with the step to the estimate), with an error as of the fit.
"""

from collections.abc import Sequence

import numpy as np

from omni_control.kinematics import Array
from omni_mj.studies.identify import law
from omni_mj.studies.identify.errors import lasting
from omni_mj.studies.identify.fit import RANGES, Fit
from omni_mj.studies.identify.projected import Problem
from omni_mj.studies.identify.segments import Segments

STEP = 0.01  # of finite differences


def shares(found: Fit, body: law.Body, segments: Segments, which: Sequence[int]) -> tuple[Array, Array]:
    """By which shares wheels differ, and their standard errors, (n,) each; infinite where the data do not show it.

    Args:
        found: the fit in which all wheels are alike, to segments.
        body: the robot that was fitted.
        segments: the stretches.
        which: parameters that are tested, by their places in `law.simulate`'s.
    """
    late = len(found.late)
    free = [law.NAMES.index(name) for name in found.names[late:]]
    steps = np.append([RANGES[name][1] for name in found.names], np.full(len(which), STEP))
    problem = Problem(body, segments, found.parameters, late, [*free, *which], steps)
    residual, jacobian, _ = problem.at(np.concatenate([found.late, found.parameters[[*free, *which]]]))
    residual, jacobian = residual[:, :-1], jacobian[:, :-1]
    known, asked = (part.reshape(residual.size, -1) for part in np.split(jacobian, [len(found.names)], axis=-1))
    length = np.linalg.norm(known, axis=0)
    basis, sizes, _ = np.linalg.svd(known[:, length > 0] / length[length > 0], full_matrices=False)
    basis = basis[:, sizes > 1e-5 * sizes[0]]
    alone = asked - basis @ (basis.T @ asked)
    power = (alone**2).sum(0)
    shown = power > 1e-6 * (asked**2).sum(0)
    power = np.where(shown, power, 1.0)
    value = -(alone * residual.reshape(-1, 1)).sum(0) / power
    scores = (alone.reshape(*residual.shape, -1) * residual[..., None]).sum(2)
    error = np.sqrt(np.diag(lasting(scores, segments))) / power
    return value, np.where(shown, error, np.inf)
