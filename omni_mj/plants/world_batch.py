"""Batches of worlds: the rows that can share one, and how it is made."""

import copy
from collections.abc import Sequence

import mujoco
from mujoco.batch import Batch

from omni_control.errors import OmniError
from omni_control.kinematics import Array
from omni_mj.config.rows import Row
from omni_mj.mjcf.robot_spec import RobotShape
from omni_mj.mjcf.world_builder import World

# In which robots may start in each other or in a wall: that of a hard contact
_ALLOWED_DEPTH_M = 1e-3


def check(rows: Sequence[Row]) -> None:
    """Check what the rows' robots are made of.

    Raises:
        OmniError: they differ in their model or the physics.
    """
    first = rows[0].settings
    for number, row in enumerate(rows):
        differ = [
            name
            for name in ("body", "wheels", "physics")
            if getattr(row.settings, name) != getattr(first, name)
        ]
        if not differ and RobotShape.from_settings(row.settings) != RobotShape.from_settings(first):
            differ = ["motor.gear or motor.rotor_inertia_kg_m2"]
        if differ:
            raise OmniError(
                f"rows 0 and {number} differ in {' and '.join(differ)}: one batch has one model"
            )


def check_start(rows: Sequence[Row], model: mujoco.MjModel, positions: Array) -> None:
    """Refuse robots that start in each other or in a wall, which would throw them apart.

    Args:
        rows: of the robots.
        model: of each world.
        positions: of the worlds, (worlds, nq).

    Raises:
        OmniError: two bodies overlap; their names, and how deep.
    """
    data = mujoco.MjData(model)
    for world, qpos in enumerate(positions):
        data.qpos[:] = qpos
        mujoco.mj_fwdPosition(model, data)
        for contact in data.contact:
            if contact.dist < -_ALLOWED_DEPTH_M:
                first, second = (model.geom(geom).name for geom in contact.geom)
                raise OmniError(
                    f"world {rows[world * len(rows) // len(positions)].world}: {first!r} and {second!r} start in each "
                    f"other, {-1e3 * contact.dist:.0f} mm deep; place the robots apart"
                )


def made(world: World, worlds: int, threads: int = 1) -> Batch:
    """So many worlds like one that was built, stepped by so many threads."""
    model = copy.copy(world.model)
    # The battery limits, also where braking motors lift its voltage
    model.actuator_ctrllimited[:] = 0
    return Batch(model, worlds, threads)
