"""The default robot as tests reckon with it: the numbers of its file, and nothing that the code makes of them."""

import numpy as np

from omni_mj.scenarios.settings import Settings

_SETTINGS = Settings()
MASS_KG, COM_HEIGHT_M = _SETTINGS.body.mass_kg, _SETTINGS.body.centre_height_m
AZIMUTHS = np.radians(_SETTINGS.wheels.azimuths_deg)
ARM_M, RADIUS_M = _SETTINGS.wheels.arm_m, _SETTINGS.wheels.radius_m
ROLLER_RADIUS_M, ROLLERS = _SETTINGS.wheels.roller_radius_m, _SETTINGS.wheels.rollers
GRAVITY = 9.81
# Where the wheels touch, and the directions in which positive wheel speeds push the robot, in its frame (equation 3).
CONTACTS = ARM_M * np.stack([np.cos(AZIMUTHS), np.sin(AZIMUTHS)], axis=1)
TANGENTS = np.stack([-np.sin(AZIMUTHS), np.cos(AZIMUTHS)], axis=1)
OUTWARD = np.stack([np.cos(AZIMUTHS), np.sin(AZIMUTHS)], axis=1)
