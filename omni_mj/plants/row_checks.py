"""Checks that a plant can simulate rows in one batch, from their start poses."""

from collections.abc import Sequence

import mujoco

from omni_control.errors import OmniError
from omni_control.kinematics import Array
from omni_mj.config.rows import Row
from omni_mj.mjcf.settings_to_mjcf import RobotShape

# Depth to which robots may overlap each other or a wall at the start: that of a hard contact
_MAX_OVERLAP_M = 1e-3


def check_mujoco_rows(rows: Sequence[Row]) -> None:
    """Check that all rows can share one model of the plant `mujoco`.

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
                world_number = rows[world * len(rows) // len(positions)].world_index
                raise OmniError(
                    f"world {world_number}: {body!r} and {other_body!r} start in each other, "
                    f"{-1e3 * contact.dist:.0f} mm deep; move their start poses apart"
                )


def check_planar_rows(rows: Sequence[Row]) -> None:
    """Check that the plant `planar` can simulate all rows in a batch.

    Raises:
        OmniError: Robots share a world, have a custom model, or differ in their wheels.
    """
    for number, row in enumerate(rows):
        if row.slot:
            raise OmniError(
                "the plant planar has one robot per world, because it does not simulate "
                "collisions; use the plant mujoco"
            )
        if row.settings.model.file:
            raise OmniError(
                "the plant planar does not support custom models (model.file); use the plant mujoco"
            )
        if row.settings.wheels != rows[0].settings.wheels:
            raise OmniError(
                f"rows 0 and {number} differ in wheels: all rows of a batch on the plant planar "
                "must have the same wheels"
            )
