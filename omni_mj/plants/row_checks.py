"""Checks that a plant can simulate rows in one batch, from their start poses."""

from collections.abc import Sequence
from operator import attrgetter

import mujoco

from omni_control.errors import OmniError
from omni_control.kinematics import Array
from omni_mj.config.rows import Row

# Depth to which robots may overlap each other or a wall at the start, m: that of a hard contact
_MAX_OVERLAP_M = 1e-3
# Settings on which the model of the plant `mujoco` depends
MODEL_SETTINGS = (
    "body",
    "wheels",
    "physics",
    "model",
    "motor.gear_ratio",
    "motor.rotor_inertia_kg_m2",
)


def check_equal_settings(rows: Sequence[Row], names: Sequence[str]) -> None:
    """Check that all rows have the same values of some settings.

    Args:
        rows: Rows of a batch.
        names: Names of settings or of their sections.

    Raises:
        OmniError: A row differs from the first one.
    """
    for number, row in enumerate(rows):
        differences = [
            name
            for name in names
            if attrgetter(name)(row.settings) != attrgetter(name)(rows[0].settings)
        ]
        if differences:
            raise OmniError(
                f"rows 0 and {number} differ in {' and '.join(differences)}: "
                "all rows of a batch share one model"
            )


def check_start_poses(rows: Sequence[Row], model: mujoco.MjModel, positions: Array) -> None:
    """Check that no robot overlaps another or a wall, from which contacts would push it violently.

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
                    f"world {world_number}: {body!r} and {other_body!r} overlap at the start by "
                    f"{-1e3 * contact.dist:.0f} mm; move their start poses apart"
                )


def check_planar_rows(rows: Sequence[Row]) -> None:
    """Check that the plant `planar` can simulate all rows in a batch.

    Raises:
        OmniError: Robots share a world, have a custom model, or differ in their wheels.
    """
    for row in rows:
        if row.slot:
            raise OmniError(
                "the plant planar has one robot per world, because it does not simulate "
                "collisions; use the plant mujoco"
            )
        if row.settings.model.file:
            raise OmniError(
                "the plant planar does not support custom models (model.file); use the plant mujoco"
            )
    check_equal_settings(rows, ["wheels"])
