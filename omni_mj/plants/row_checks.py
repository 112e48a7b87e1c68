"""Checks that a plant can simulate rows in one batch, from their start poses."""

from collections.abc import Sequence
from operator import attrgetter

import mujoco

from omni_control.errors import OmniError
from omni_control.kinematics import Array
from omni_mj.config.rows import Row

# Depth to which a robot may overlap another or a wall at the start, m. Robots that push each other
# hard overlap by as much.
_MAX_OVERLAP_M = 1e-3
# Settings and sections on which the model of the plant `mujoco` depends
MODEL_SETTINGS = (
    "body",
    "wheels",
    "physics",
    "model",
    "motor.gear_ratio",
    "motor.rotor_inertia_kg_m2",
    "world.field_length_m",
    "world.field_width_m",
    "world.field_margin_m",
)


def check_equal_settings(rows: Sequence[Row], names: Sequence[str]) -> None:
    """Check that all rows have the same values of some settings.

    Args:
        rows: Rows of a batch.
        names: Names of settings or of sections.

    Raises:
        OmniError: A row differs from the first one.
    """
    for name in names:
        values = [attrgetter(name)(row.settings) for row in rows]
        for number, value in enumerate(values):
            if value != values[0]:
                raise OmniError(
                    f"rows 0 and {number} differ in {name}: all rows of a batch share one model"
                )


def check_start_poses(rows: Sequence[Row], model: mujoco.MjModel, positions: Array) -> None:
    """Check that no robot overlaps another or a wall. Contacts would push it away violently.

    Args:
        rows: Rows of the robots, world by world.
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
                geom, other_geom = (model.geom(geom).name for geom in contact.geom)
                robots_per_world = len(rows) // len(positions)
                raise OmniError(
                    f"world {rows[world * robots_per_world].world_index}: "
                    f"{geom!r} and {other_geom!r} overlap at the start by "
                    f"{-1e3 * contact.dist:.0f} mm; move their start poses apart"
                )


def check_planar_rows(rows: Sequence[Row], ignores_contact: bool = False) -> None:
    """Check that the plant `planar` can simulate all rows in a batch.

    Args:
        rows: Rows of a batch.
        ignores_contact: Whether robots may share a world.

    Raises:
        OmniError: Robots share a world, have a custom model, or differ in their wheels.
    """
    for row in rows:
        if row.slot and not ignores_contact:
            raise OmniError(
                "the plant planar has one robot per world, because it does not simulate "
                "collisions; use the plant mujoco"
            )
        if row.settings.model.file:
            raise OmniError(
                "the plant planar does not support custom models (model.file); use the plant mujoco"
            )
    check_equal_settings(rows, ["wheels"])
