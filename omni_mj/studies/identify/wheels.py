"""What wheels say of the motion, as far as they can be those of the robot that is believed in."""

import numpy as np

from omni_control.errors import OmniError
from omni_control.kinematics import Array
from omni_mj.scenarios.settings import Settings
from omni_mj.studies.identify.logs import Log


def twists(log: Log, settings: Settings) -> Array:
    """Body twists (F, 3) by the wheels of a log and the geometry of the start robot.

    Raises:
        OmniError: the robot has another number of wheels.
    """
    assert log.wheels is not None
    geometry = settings.wheels.kinematics
    if (have := log.wheels.shape[1]) != (count := len(geometry.azimuths)):
        raise OmniError(f"{log.name}: {have} wheels, but the robot's file has {count}; name one of {have} by --robot")
    if not np.isfinite(log.wheels).all():
        raise OmniError(f"{log.name}: wheels are missing in line {np.argmin(np.isfinite(log.wheels).all(1)) + 1}")
    if (rim := np.quantile(np.abs(log.wheels), 0.95) * geometry.radius) > 10:
        raise OmniError(f"{log.name}: wheels run at {rim:.0f} m/s; are they in degrees or counts, or before the gear?")
    return geometry.body_twist(log.wheels)
