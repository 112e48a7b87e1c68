"""Questions to a compiled model that several ask."""

import mujoco
import numpy as np
from numpy.typing import NDArray

Ids = NDArray[np.int_]


def dc_motors(model: mujoco.MjModel) -> Ids:
    """Numbers of the <dcmotor>s on joints."""
    return np.flatnonzero(
        (model.actuator_gaintype == mujoco.mjtGain.mjGAIN_DCMOTOR)
        & (model.actuator_trntype == mujoco.mjtTrn.mjTRN_JOINT)
    )


def slip_hinges(model: mujoco.MjModel, wheel: int, rim: int) -> list[int]:
    """The hinge on which a rim slips, or none.

    Args:
        model: compiled.
        wheel: the wheel's hinge.
        rim: a body, the wheel's own or one on it.
    """
    first, count = model.body_jntadr[rim], model.body_jntnum[rim]
    return [joint for joint in range(first, first + count) if joint != wheel]


def below(model: mujoco.MjModel, body: int, ancestor: int) -> bool:
    """Whether a body hangs, over others or not, on another."""
    while body > ancestor:
        body = int(model.body_parentid[body])
        if body == ancestor:
            return True
    return False
