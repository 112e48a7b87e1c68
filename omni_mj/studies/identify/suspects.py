"""Whether one wheel is not as the others: its radius or encoder, or the stiffness of its loop.

The law lets all wheels be alike. Of each wheel by itself it is tested how far it is not, without another fit: of the
residuals r and the derivative c by that, less what the fitted parameters could do as well, the share is -c r / c^2
(a score test, Rao 1948, Proc. Camb. Phil. Soc. 44, 50, with the step to the estimate), with an error as of the fit, of
the residuals that are left then.
"""

from collections.abc import Iterator, Sequence

import numpy as np
from scipy.special import ndtr

from omni_control.kinematics import Array
from omni_mj.studies.identify import law
from omni_mj.studies.identify.errors import SINGULAR, lasting
from omni_mj.studies.identify.fit import RANGES, Fit
from omni_mj.studies.identify.projected import Problem
from omni_mj.studies.identify.residuals import ALARM
from omni_mj.studies.identify.segments import Segments

STEP = 0.01  # of finite differences
ALIKE = 1e-3  # by which wheels of our plant seem to differ that do not, standard deviation
OWN = 0.1  # of what a wheel does, that no fitted parameter does as well, below which it is not looked at
MOST = 0.5  # of what lasts of the residuals, from which on a wheel is said to explain it


def odd_rims(found: Fit, body: law.Body, segments: Segments) -> Iterator[str]:
    """The wheel whose rim does not move as its angle says, if there is one, in a line.

    Args:
        found: the fit to wheels in which all are alike, to segments.
        body: the robot that was fitted.
        segments: the stretches.
    """
    residual, alone = _alone(found, body, segments, range(len(body.wheels)))
    share, error = shares(residual, alone, segments)
    wheel = int(np.argmax(share**2 * (alone**2).sum(0)))  # that explains most
    off = float(np.hypot(error[wheel], ALIKE))
    if 2 * len(share) * ndtr(-abs(share[wheel]) / off) < ALARM:  # Bonferroni: of any wheel, either way
        yield (
            f"wheel {wheel + 1}: it goes {100 * share[wheel]:+.1f} +- {100 * off:.1f} % farther than its angle says, "
            "beside the others; is it worn, or its encoder's scale another?"
        )


def odd_loops(found: Fit, body: law.Body, segments: Segments) -> Iterator[str]:
    """The wheel whose loop would explain most of what the law lacks by commands, if there is one, in a line."""
    count = len(body.wheels)
    residual, alone = _alone(found, body, segments, range(2 * count))
    explained = []
    for wheel in range(count):
        basis, _ = np.linalg.qr(alone[:, [wheel, count + wheel]])
        explained.append(float(((basis.T @ residual.ravel()) ** 2).sum()))
    noise = found.position.noise**2 * 2 + (found.metres * found.heading.noise) ** 2
    share = np.array(explained) / max(float((residual**2).sum() - noise * segments.there.sum()), 1e-12)
    wheel = int(np.argmax(share))
    if share[wheel] > MOST:
        yield f"wheel {wheel + 1}: another motor, radius or loop of this wheel alone explains most of that"


def shares(residual: Array, alone: Array, segments: Segments) -> tuple[Array, Array]:
    """By which shares wheels differ, and standard errors, infinite where the data do not show it, (n,) each."""
    power = (alone**2).sum(0)
    shown = power > 0
    power = np.where(shown, power, 1.0)
    share = -(alone.T @ residual.ravel()) / power
    left = residual[..., None] + (alone * share).reshape(*residual.shape, -1)  # what that wheel does not explain
    scores = (alone.reshape(left.shape) * left).sum(2)
    error = np.sqrt(np.diag(lasting(scores, segments))) / power
    return share, np.where(shown, error, np.inf)


def _alone(found: Fit, body: law.Body, segments: Segments, odd: Sequence[int]) -> tuple[Array, Array]:
    """Residuals (S, m, 3), and what parameters of single wheels do to them that those fitted cannot, (S m 3, n)."""
    late, which = len(found.late), [len(law.NAMES) + i for i in odd]
    free = [law.NAMES.index(name) for name in found.names[late:]]
    steps = np.append([RANGES[name][1] for name in found.names], np.full(len(which), STEP))
    problem = Problem(body, segments, found.parameters, late, [*free, *which], steps)
    residual, jacobian, _ = problem.at(np.concatenate([found.late, found.parameters[[*free, *which]]]))
    residual, jacobian = residual[:, :-1], jacobian[:, :-1]
    known, asked = (part.reshape(residual.size, -1) for part in np.split(jacobian, [len(found.names)], axis=-1))
    length = np.linalg.norm(known, axis=0)
    basis, sizes, _ = np.linalg.svd(known[:, length > 0] / length[length > 0], full_matrices=False)
    basis = basis[:, sizes > SINGULAR * sizes[:1]]
    alone = asked - basis @ (basis.T @ asked)
    return residual, alone * ((alone**2).sum(0) > OWN**2 * (asked**2).sum(0))
