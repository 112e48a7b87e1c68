"""Numbers of a robot: those of models/ssl_robot.xml that are defaults of settings, and the geometry of any."""

from functools import lru_cache

import mujoco

from omni_control.kinematics import Kinematics
from omni_mj.worlds import build, files


@lru_cache(maxsize=1)
def _spec() -> mujoco.MjSpec:
    return mujoco.MjSpec.from_file(str(files.path(files.ROBOT)))


def carpet_friction() -> float:
    """Coefficient of friction between rollers and carpet, as in the model."""
    return float(_spec().default.pair.friction[0])


def numeric(name: str) -> float:
    """A number that the model holds under <custom>."""
    return float(_spec().numeric(name).data[0])


def roller_damping() -> float:
    """Damping of the rollers' bearings, as in the model, N m s/rad."""
    return max(float(joint.damping[0]) for joint in _spec().joints)


def geometry(robot: str) -> Kinematics:
    """Of a robot's wheels, measured on its model; `robot` is a name or the path of an MJCF file."""
    return build.world(robot).kinematics
