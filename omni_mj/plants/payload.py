"""What robots carry: mass, centre of mass and inertia of a chassis with a load on it.

MuJoCo derives constants from masses when it compiles a model. Those that it reckons with afterwards are changed here
as well (`body_subtreemass`). The others, `body_invweight0` and `dof_invweight0`, only scale its constraints, whose
stiffness, damping and creep were written for them (`omni_mj.worlds.contact`, `omni_mj.onboard.traction`): they stay,
and carpet and rubber with them.
"""

from collections.abc import Iterable

import mujoco
import numpy as np
from mujoco.batch import Batch

from omni_control.kinematics import Array
from omni_mj.mjcf.masses import spread
from omni_mj.worlds.build import World

_FIELDS = ("body_mass", "body_subtreemass", "body_ipos", "body_inertia", "body_iquat")


class Carriers:
    """The chassis of n robots, each in its world's copy of the model's fields, as they are when this is made.

    Args:
        batch: of the worlds.
        world: as built.
        n: number of robots.

    Attributes:
        centre: of mass of each chassis with its load, in its frame, (n, 3) m.
    """

    def __init__(self, batch: Batch, world: World, n: int) -> None:
        bodies, rows = np.array([robot.chassis for robot in world.robots]), np.arange(n)
        self._at = rows // len(bodies), bodies[rows % len(bodies)]
        self._fields = {name: batch.expand(name) for name in _FIELDS}
        self._empty = {name: field[self._at] for name, field in self._fields.items()}
        self.centre = self._empty["body_ipos"]

    def carry(self, loads: Iterable[tuple[int, float, float]]) -> None:
        """Carry these loads and no others.

        Args:
            loads: row, mass in kg, and height above the carpet in m, or 0 for that of the chassis' centre of mass.
        """
        now = {name: values.copy() for name, values in self._empty.items()}
        for row, mass, height in loads:
            before, centre = now["body_mass"][row], now["body_ipos"][row]
            at = np.array([*centre[:2], height or self._empty["body_ipos"][row, 2]])
            now["body_mass"][row] += mass
            now["body_subtreemass"][row] += mass
            # About the common centre of mass two bodies turn as their reduced mass does at their distance.
            more = before * mass / (before + mass) * spread(at - centre)
            now["body_ipos"][row] = centre + mass / (before + mass) * (at - centre)
            if more.any():
                now["body_inertia"][row], now["body_iquat"][row] = _turned(
                    now["body_inertia"][row], now["body_iquat"][row], more
                )
        for name, values in now.items():
            self._fields[name][self._at] = values
        self.centre = now["body_ipos"]


def _turned(inertia: Array, quaternion: Array, more: Array) -> tuple[Array, Array]:
    """Principal moments (3,) and axes (4,) of a body that has `more` inertia (3, 3) than those say, in its frame.

    Axes are numbered as before, next to which each is taken: of a body whose axes stay, none is renamed.
    """
    matrix, turned = np.zeros(9), np.zeros(4)
    mujoco.mju_quat2Mat(matrix, quaternion)
    axes = matrix.reshape(3, 3)
    moments, vectors = np.linalg.eigh(np.diag(inertia) + axes.T @ more @ axes)
    order = np.argsort(np.abs(vectors).argmax(0))
    first, second, _ = vectors.T[order] * np.sign(np.diag(vectors[:, order]))[:, None]
    own = np.column_stack([first, second, np.cross(first, second)])
    mujoco.mju_mat2Quat(turned, (axes @ own).ravel())
    return moments[order], turned
