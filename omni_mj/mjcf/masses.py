"""Masses of bodies: put into a body, and summed over several."""

from collections.abc import Iterable

import mujoco
import numpy as np

from omni_control.kinematics import Array


def weigh(body: mujoco.MjsBody, mass: float, centre: Array, inertia: Array) -> None:
    """Give a body its mass, centre of mass (3,) and inertia (3, 3) about it, in its own frame."""
    body.explicitinertial = True
    body.mass, body.ipos, body.iquat = mass, centre, [1.0, 0.0, 0.0, 0.0]
    body.inertia = np.zeros(3)  # the compiler takes either this or the full matrix
    body.fullinertia = inertia[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]


def composite(model: mujoco.MjModel, bodies: Iterable[int]) -> tuple[float, Array, Array]:
    """Mass, centre of mass (3,) and inertia (3, 3) about it of some bodies as modelled, in the world's frame."""
    data, chosen = mujoco.MjData(model), list(bodies)
    mujoco.mj_kinematics(model, data)
    mass, at = model.body_mass[chosen], data.xipos[chosen]
    centre = mass @ at / mass.sum()
    inertia = np.zeros((3, 3))
    for number, m, r in zip(chosen, mass, at - centre, strict=True):
        axes = data.ximat[number].reshape(3, 3)
        inertia += axes @ np.diag(model.body_inertia[number]) @ axes.T + m * spread(r)
    return float(mass.sum()), centre, inertia


def spread(r: Array) -> Array:
    """Inertia of a unit mass at r about the origin, m^2."""
    return np.asarray(r @ r * np.eye(3) - np.outer(r, r))
