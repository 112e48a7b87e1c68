"""How robots answer near rest, by the gains of their wheel loops."""

from typing import TYPE_CHECKING

import numpy as np

from omni_control.kinematics import Array
from omni_mj.scenarios.robot_checks import GRAVITY_M_S2

if TYPE_CHECKING:
    from omni_mj.scenarios.settings import Settings


def hold(settings: "Settings") -> Array:
    """Force over the speed that is missing ahead and aside, (2,) N s/m: that of the loops' gain and of back-EMF.

    A wheel gives n k_t (kp + n k_t) / (R r^2) along its rim; all of them that times sum d^2, with the direction cosines
    d between rims and motion. Of a loop that integrates, its gain alone.
    """
    motor, radius = settings.motor, settings.wheels.radius_m
    torque = motor.gear * motor.constant_nm_a
    rim = torque * (settings.firmware.kp + torque) / (motor.resistance_ohm * radius**2)
    return np.asarray(rim * (_cosines(settings) ** 2).sum(0))


def lag(settings: "Settings") -> Array:
    """Time constant of small steps ahead and aside, (2,) s: mass over `hold`. Rotors and creep are left out."""
    return np.asarray(settings.body.mass_kg / hold(settings))


def drag(settings: "Settings") -> Array:
    """What dry friction costs of the speed ahead and aside, (2,) m/s: all of it, along the motion, over `hold`.

    That of pile, of gears and motors, tau / r at a wheel's rim, and of rollers, which turn by the motion's part along
    their wheel's axle.
    """
    motor, drive, cosines = settings.motor, settings.drive, _cosines(settings)
    weight = settings.body.mass_kg * GRAVITY_M_S2
    rubbing = motor.gear * motor.constant_nm_a * motor.no_load_current_a * motor.dry_share + drive.gear_friction_nm
    rollers = drive.roller_friction * weight * np.sqrt(np.maximum(1 - cosines**2, 0.0)).mean(0)
    force = settings.carpet.pile * weight + rollers + rubbing / settings.wheels.radius_m * cosines.sum(0)
    return np.asarray(force / hold(settings))


def _cosines(settings: "Settings") -> Array:
    """Between rims and motion ahead and aside, without sign, (wheels, 2)."""
    return np.abs(settings.wheels.kinematics.matrix[:, :2])
