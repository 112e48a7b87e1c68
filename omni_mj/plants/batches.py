"""The rows that can share a batch of worlds."""

from collections.abc import Sequence

import mujoco

from omni_control.errors import OmniError
from omni_control.kinematics import Array
from omni_mj.scenarios.rows import Row
from omni_mj.worlds.shape import Shape

_ALLOWED_DEPTH_M = 1e-3  # in which robots may start in each other or in a wall: that of a hard contact


def places(rows: Sequence[Row]) -> int:
    """Robots per world.

    Raises:
        OmniError: not every world has as many, one after the other.
    """
    count = max(row.place for row in rows) + 1
    worlds = [row.world for row in rows[::count]]
    if [(row.world, row.place) for row in rows] != [(world, place) for world in worlds for place in range(count)]:
        raise OmniError("the rows of a batch must be those of one world after the other, all with as many places")
    return count


def check(rows: Sequence[Row]) -> None:
    """Check what the rows' robots are made of.

    Raises:
        OmniError: they differ in their model or the physics, or one has wheels without creep and what needs creep.
    """
    first = rows[0].settings
    for number, row in enumerate(rows):
        differ = [
            field
            for field, one, other in (
                ("body", row.settings.body, first.body),
                ("wheels", row.settings.wheels, first.wheels),
                ("physics", row.settings.physics, first.physics),
                ("motor.gear or motor.rotor_inertia_kg_m2", Shape.of(row.settings), Shape.of(first)),
            )
            if one != other
        ]
        if differ:
            raise OmniError(f"rows 0 and {number} differ in {' and '.join(differ[:3])}: one batch has one model")
        varied = row.settings.variation
        if row.settings.wheels.creep == "off" and (varied.friction or varied.wear_m or row.settings.carpet.patches):
            raise OmniError("variation.friction, variation.wear_m and carpet.patches need wheels.creep = on")


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
