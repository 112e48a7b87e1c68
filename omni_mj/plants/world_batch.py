"""Batches of MuJoCo worlds with one model: checks of the rows, and construction."""

import copy
from collections.abc import Sequence

import mujoco
from mujoco.batch import Batch

from omni_control.errors import OmniError
from omni_control.kinematics import Array
from omni_mj.config.rows import Row
from omni_mj.mjcf.settings_to_mjcf import RobotShape
from omni_mj.mjcf.world_builder import World

# Depth to which robots may overlap each other or a wall at the start: that of a hard contact
_MAX_OVERLAP_M = 1e-3


def check_rows(rows: Sequence[Row]) -> None:
    """Check that all rows can share one model.

    Raises:
        OmniError: Rows differ in their model or the physics.
    """
    reference = rows[0].settings
    for number, row in enumerate(rows):
        differences = [
            name
            for name in ("body", "wheels", "physics")
            if getattr(row.settings, name) != getattr(reference, name)
        ]
        if not differences and RobotShape.from_settings(row.settings) != RobotShape.from_settings(
            reference
        ):
            differences = ["motor.gear_ratio or motor.rotor_inertia_kg_m2"]
        if differences:
            raise OmniError(
                f"rows 0 and {number} differ in {' and '.join(differences)}: "
                "all rows of a batch share one model"
            )


def check_start_poses(rows: Sequence[Row], model: mujoco.MjModel, positions: Array) -> None:
    """Check that no robot overlaps another or a wall, because contacts would throw it away.

    Args:
        rows: Rows of the robots.
        model: Model of each world.
        positions: Positions `qpos` of the worlds, (worlds, nq).

    Raises:
        OmniError: Two bodies overlap.
    """
    data = mujoco.MjData(model)
    for world, qpos in enumerate(positions):
        data.qpos[:] = qpos
        mujoco.mj_fwdPosition(model, data)
        for contact in data.contact:
            if contact.dist < -_MAX_OVERLAP_M:
                body, other_body = (model.geom(geom).name for geom in contact.geom)
                world_number = rows[world * len(rows) // len(positions)].world
                raise OmniError(
                    f"world {world_number}: {body!r} and {other_body!r} start in each other, "
                    f"{-1e3 * contact.dist:.0f} mm deep; move their start poses apart"
                )


def make_batch(world: World, n_worlds: int, n_threads: int = 1) -> Batch:
    """Return a batch of copies of a world.

    Args:
        world: World as built.
        n_worlds: Number of copies.
        n_threads: Threads that step them.
    """
    model = copy.copy(world.model)
    # The battery limits voltages, also where braking motors lift its voltage.
    model.actuator_ctrllimited[:] = 0
    return Batch(model, n_worlds, n_threads)
