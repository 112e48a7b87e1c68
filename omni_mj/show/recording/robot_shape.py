"""The robot's shape for the rerun viewer, taken from the compiled model's own geoms."""

from functools import lru_cache
from typing import Any

import mujoco
import numpy as np
import rerun as rr

from omni_mj.worlds import robot

LIGHTER = 110  # of 255
_CYLINDER, _BOX, _ELLIPSOID = mujoco.mjtGeom.mjGEOM_CYLINDER, mujoco.mjtGeom.mjGEOM_BOX, mujoco.mjtGeom.mjGEOM_ELLIPSOID


@lru_cache(maxsize=1)
def at_rest() -> tuple[mujoco.MjModel, mujoco.MjData]:
    """The model with the chassis at the origin, so that world coordinates are the chassis' own."""
    model = robot.shared_model()
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    return model, data


def wheel_mounts() -> list[tuple[np.ndarray, np.ndarray]]:
    """Per wheel, the axle's position (3,) in m and its axis (3,), in the chassis' frame."""
    _, data = at_rest()
    joints = [data.joint(f"wheel_{i + 1}") for i in range(robot.WHEELS)]
    return [(joint.xanchor.copy(), joint.xaxis.copy()) for joint in joints]


def log(stream: rr.RecordingStream, entity: str, colour: tuple[int, int, int]) -> None:
    """Log chassis and wheels once, static, under `entity`; the cover in `colour` to tell robots apart."""
    model, _ = at_rest()
    _log_geoms(stream, f"{entity}/chassis", [model.body("chassis").id], np.zeros(3), colour)
    for i, (position, _) in enumerate(wheel_mounts()):
        wheel = model.body(f"wheel_{i + 1}").id
        rollers = np.flatnonzero(model.body_parentid == wheel)
        _log_geoms(stream, f"{entity}/wheel_{i + 1}", [wheel, *rollers], position, colour)


def _log_geoms(
    stream: rr.RecordingStream, entity: str, bodies: list[int], origin: np.ndarray, colour: tuple[int, int, int]
) -> None:
    """Log the geoms of `bodies` relative to `origin`, one entity per kind of geom."""
    model, data = at_rest()
    for kind in (_CYLINDER, _BOX, _ELLIPSOID):
        ids = np.flatnonzero((model.geom_type == kind) & np.isin(model.geom_bodyid, bodies))
        if not ids.size:
            continue
        size = model.geom_size[ids]
        colours = np.array([colour if model.geom(i).name == "cover" else _colour(model, i) for i in ids])
        if kind == _ELLIPSOID:  # every other roller lighter, or nobody sees wheels turn
            colours[::2] = np.minimum(colours[::2] + LIGHTER, 255)
        common: dict[str, Any] = {
            "centers": data.geom_xpos[ids] - origin,
            "quaternions": data.geom_xquat[ids][:, [1, 2, 3, 0]],  # MuJoCo's wxyz to rerun's xyzw
            "colors": colours,
            "fill_mode": "solid",
        }
        if kind == _CYLINDER:
            shape: Any = rr.Cylinders3D(radii=size[:, 0], lengths=2 * size[:, 1], **common)
        elif kind == _BOX:
            shape = rr.Boxes3D(half_sizes=size, **common)
        else:
            shape = rr.Ellipsoids3D(half_sizes=size, **common)
        stream.log(f"{entity}/{mujoco.mjtGeom(kind).name[7:].lower()}s", shape, static=True)


def _colour(model: mujoco.MjModel, geom: np.intp) -> np.ndarray:
    material = model.geom_matid[geom]
    rgba = model.mat_rgba[material] if material >= 0 else model.geom_rgba[geom]
    return (255 * rgba[:3]).astype(int)
