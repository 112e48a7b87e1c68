"""What faults do to bodies of the MuJoCo plant: a load on a chassis, a carpet that leans.

MuJoCo derives constants from masses when it compiles a model. Those that it reckons with afterwards are changed here
as well (`body_subtreemass`). The others, `body_invweight0` and `dof_invweight0`, only scale its constraints, whose
stiffness, damping and creep were written for them (`omni_mj.worlds.contact`, `omni_mj.robot.carpet`): they stay,
and carpet and rubber with them.
"""

from collections.abc import Iterable
from functools import cached_property

import mujoco
import numpy as np
from mujoco.batch import Batch

from omni_control.kinematics import Array
from omni_mj.mjcf.geometry import spread
from omni_mj.worlds.build import World
from omni_mj.worlds.columns import Columns

_FIELDS = ("body_mass", "body_subtreemass", "body_ipos", "body_inertia", "body_iquat")


_STUCK_NM = 100.0  # dry friction of a hub that is stuck: more than motor and carpet can turn


class MujocoBodies:
    """n robots, each in its world's copy of the model's fields, as these are when a load or a slope is first asked for.

    Args:
        batch: of the worlds.
        world: as built.
        n: number of robots.
    """

    def __init__(self, batch: Batch, world: World, n: int) -> None:
        self._batch, self._world = batch, world
        bodies, rows = np.array([robot.chassis for robot in world.robots]), np.arange(n)
        self._at = rows // len(bodies), bodies[rows % len(bodies)]
        self._now: dict[str, Array] = {}
        qpos, qvel = batch.bind("qpos"), batch.bind("qvel")
        self._pose = Columns(qpos, np.array([robot.qpos[:7] for robot in world.robots]))
        self._speeds = Columns(qvel, np.array([robot.dofs for robot in world.robots]))

    @property
    def centre(self) -> Array:
        """Of mass of each chassis with its load, in its frame, (n, 3) m."""
        return (self._now or self._empty)["body_ipos"]

    @cached_property
    def _fields(self) -> dict[str, Array]:
        return {name: self._batch.expand(name) for name in _FIELDS}

    @cached_property
    def _empty(self) -> dict[str, Array]:
        return {name: field[self._at] for name, field in self._fields.items()}

    def lean(self, along: Array) -> None:
        """See `faults.robots.Bodies`: gravity turns in the world's axes, on every body, wheels and rollers too."""
        into = np.sqrt(np.maximum(1 - (along**2).sum(1), 0.0))
        g, places = -float(self._world.model.opt.gravity[2]), len(self._world.robots)
        self._batch.expand("opt.gravity")[:] = g * np.column_stack([along, -into])[::places]

    @cached_property
    def _hubs(self) -> tuple[Columns, Array]:
        """Dry friction of hubs, (n, W) N m, and what it is."""
        hubs = np.array([robot.wheel_dofs for robot in self._world.robots])
        friction = Columns(self._batch.expand("dof_frictionloss"), hubs)
        return friction, friction.get().copy()

    def block(self, stuck: np.ndarray) -> None:
        """See `faults.robots.Bodies`."""
        friction, usual = self._hubs
        friction.set(np.where(stuck, _STUCK_NM, usual))

    def put(self, robot: int, moved: tuple[float, float, float]) -> None:
        """See `faults.robots.Bodies`; tilted and as high as it was."""
        pose, speeds = self._pose.get().copy(), self._speeds.get().copy()
        x, y, turn = moved
        pose[robot, :2] += x, y
        mujoco.mju_mulQuat(
            pose[robot, 3:], np.array([np.cos(turn / 2), 0, 0, np.sin(turn / 2)]), pose[robot, 3:].copy()
        )
        speeds[robot] = 0.0
        self._pose.set(pose)
        self._speeds.set(speeds)

    def carry(self, loads: Iterable[tuple[int, float, float]]) -> None:
        """See `faults.robots.Bodies`."""
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
                now["body_inertia"][row], now["body_iquat"][row] = _joined(
                    now["body_inertia"][row], now["body_iquat"][row], more
                )
        for name, values in now.items():
            self._fields[name][self._at] = values
        self._now = now


def _joined(inertia: Array, quaternion: Array, more: Array) -> tuple[Array, Array]:
    """Return principal moments (3,) and axes (4,) of a body with `more` inertia (3, 3), in its frame."""
    matrix, turned = np.zeros(9), np.zeros(4)
    mujoco.mju_quat2Mat(matrix, quaternion)
    axes = matrix.reshape(3, 3)
    moments, vectors = np.linalg.eigh(axes * inertia @ axes.T + more)
    vectors[:, 2] *= np.linalg.det(vectors)  # right-handed
    mujoco.mju_mat2Quat(turned, vectors.ravel())
    return moments, turned
