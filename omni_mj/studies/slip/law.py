"""What the fits must find, in closed form: the law of creep (`omni_mj.scenarios.told`), and rolling out.

**Rolling out** without current, drag D through the contacts and friction of hubs, tau for gear, motor and wheel
bearings, slow the body, of mass m, and what turns with the hubs, of the inertia I; with the wheels' radius R and
directions d

    deceleration = (D_j + sum |d_ij| tau / R) / (m + sum d_ij^2 I / R^2).
"""

from dataclasses import dataclass

import numpy as np

from omni_control.kinematics import Array
from omni_mj.robot.motors import Motor
from omni_mj.scenarios.settings import Settings
from omni_mj.scenarios.told import creep

AXES = {"forward": 0, "sideways": 1, "turning": 2}
ROLLING = np.array([0.5, 0.5, 3.5])  # half of the mean speed of the moves, m/s and rad/s


@dataclass(frozen=True)
class Expected:
    """The law's numbers along forward, sideways and turning, (3,) each.

    Attributes:
        drag: through the contacts, N, N and N m.
        deceleration: of a roll-out, m/s^2 and rad/s^2, at the speeds of `ROLLING`.
        gain, time: K and T as TIGERs fit them, T in s^2/m; without creep 1 and 0.
    """

    drag: Array
    deceleration: Array
    gain: Array
    time: Array


def expected(settings: Settings) -> Expected:
    """Of a robot on level carpet."""
    wheels, body, crept = settings.wheels.kinematics, settings.body, creep(settings)
    inertia = np.array([body.mass_kg, body.mass_kg, body.yaw_inertia_kg_m2])
    motor, directions, radius = Motor.of(settings.motor), wheels.matrix, wheels.radius
    turning = np.abs(directions) / radius * ROLLING  # of the wheels, rad/s
    friction = settings.drive.gear_friction_nm + motor.wheel_dry + motor.wheel_viscous * turning
    hubs = (np.abs(directions) * friction).sum(0) / radius
    rotors = motor.inertia * motor.gear**2 / radius**2 * (directions**2).sum(0)
    return Expected(crept.drag, (crept.drag + hubs) / (inertia + rotors), crept.gain, crept.time)
