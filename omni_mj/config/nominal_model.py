"""Closed-form response of a robot, from which the team's assumptions about it are derived.

**Wheel loops.** A wheel exerts the force k (kp + k) / (R r^2) along its rim per m/s of missing
speed, with the proportional gain kp, the torque constant k at the wheel (motor's constant times
gear ratio), the resistance R and the wheel radius r. All wheels together exert this force times
sum c^2, where c are the direction cosines between rims and motion. This is the stiffness of
`compute_speed_stiffness`. The lag is the mass over this stiffness. The friction loss is the dry
friction force over it. Rotor inertia and creep are neglected. If a loop has integral action, only
its proportional gain is considered.

**Creep.** Row i of the matrix G is (d_i, l): the rim direction d_i and the lever arm l of wheel i.
The wheel has the normal force N_i, the creep stiffness C and the traction f_i. Its contact point
travels at v_i, and its rim is faster by s_i = |v_i| f_i / (N_i C)
(`omni_mj.robot.wheel_carpet_forces`). With stiff wheel loops, all s_i together are the motion of a
rigid body, s = G e. Here e = u - v, where u is the twist by the encoders and v that of the body. In
translation all |v_i| = |v|. The tractions f_i = N_i C s_i / |v| have the force and moment

    (F, M) = G^T f = (C / |v|) G^T N G e,        so        e = |v| / C (G^T N G)^-1 (F, M).

Along an axis j of symmetry F = m a + D_j. The first term accelerates the body. D_j is the drag that
the contacts transmit: rolling resistance and roller bearings, but not motors and gears, which act
on the hubs. For v > 0

    u = v + T0 v (a + D_j / m),        T0 = m ((G^T N G)^-1)_jj / C.

T0 is m / (C sum N_i d_ij^2) if the axes are not coupled, and W / (g C sum d_ij^2) for W wheels
with equal normal forces. TIGERs write the law as K u - v = T |u| v'. Comparing the terms with and
without a = v' gives

    K = 1 / (1 + T0 D_j / m),        T = K T0 v / u = K^2 T0 / (1 + K T0 a).

A fit over a whole move weighs acceleration (a > 0) and braking equally. Its T is K^2 T0 up to
(K T0 a)^2, 2 % at 2 m/s^2. Drag appears in the gain K, not in T. Without drag K = 1. When the robot
turns on the spot, wheels travel at l |w|. With the yaw inertia J and the moment M of the drag

    u = w + T0 l |w| (w' + M / J),        T0 = J ((G^T N G)^-1)_ww / C = J / (C l^2 m g),

so a law with T l |u| in place of T |u| has K = 1 / (1 + T0 l M / J) and again T = K^2 T0.

The normal forces are those of a body at rest on equal springs, linear in the position of the wheel.
The effects of load transfer during acceleration and during braking cancel. Neglected effects:

- K is lower by up to 0.014, by the viscous friction of bearings and the spin-up of rollers (0.1 to
  0.2 N at 1 m/s), and by a rolling radius that is 0.1 % smaller.
- T differs by 1 to 2 %, by mass that turns with the rims.
- T differs by 3 %, by wheel loops that are not stiff where normal forces differ.
- T differs by 0.001 s^2/m at 1 m/s, by the 1 ms that TIGERs' law adds to T |u|.
"""

from typing import NamedTuple

import numpy as np

from omni_control.kinematics import Array
from omni_control.traction_limits import GRAVITY, compute_load_matrix
from omni_mj.config.settings import Settings

# Guesses for loops with integral action. They have no single lag, and friction costs no steady
# speed. They overshoot, so alpha is unknown (0).
INTEGRAL_ACTION_ASSUMPTIONS = {
    "assumed_lag_s": 0.02,
    "assumed_friction_loss_m_s": 0.04,
    "assumed_alpha_forward": 0.0,
    "assumed_alpha_sideways": 0.0,
}
# Part of 1/alpha - 1 at 1 m/s that is not due to creep: viscous friction, rolling radius, battery.
# For six simulated robots, it is 0.013 to 0.023 forward, and 0.021 to 0.047 sideways, where wheel
# loops are softer.
EXCESS_WITHOUT_CREEP = 0.02
MAX_ASSUMPTION = 1.0  # the largest value that [control] allows for lag, loss and creep


class CreepLaw(NamedTuple):
    """Parameters of the creep law K u - v = T |u| v' for forward, sideways and turning motion.

    Attributes:
        drag: Drag that the contacts transmit, (3,), N, N and N m.
        gain: Gain K, (3,).
        coefficient: Coefficient T, (3,), s^2/m.
    """

    drag: Array
    gain: Array
    coefficient: Array


def derive_assumptions(settings: Settings, assumed_creep: float | None) -> dict[str, float]:
    """Return the values of `control.assumed_...` that a robot's settings imply, by name.

    Lag and friction loss are means of both axes, rounded to 0.1 ms and 1 mm/s.

    Args:
        settings: Settings of the robot.
        assumed_creep: Forward creep coefficient that the team assumes, s^2/m. Sideways creep and
            1/alpha - 1 are proportional to it. None: the robot's own.
    """
    law = compute_creep_law(settings)
    creep = round(float(law.coefficient[0]), 4)
    scale = 1.0 if assumed_creep is None else assumed_creep / creep
    without_creep = EXCESS_WITHOUT_CREEP * np.array([1.0, law.coefficient[1] / creep])
    alpha_forward, alpha_sideways = 1 / (1 + scale * (1 / law.gain[:2] - 1 + without_creep))
    values = {
        "assumed_lag_s": round(float(compute_lag(settings).mean()), 4),
        "assumed_friction_loss_m_s": round(float(compute_friction_loss(settings).mean()), 3),
        "assumed_creep_s2_m": creep,
        "assumed_creep_sideways_s2_m": round(scale * float(law.coefficient[1]), 4),
        "assumed_alpha_forward": round(float(alpha_forward), 3),
        "assumed_alpha_sideways": round(float(alpha_sideways), 3),
    }
    if settings.firmware.ki:
        values |= INTEGRAL_ACTION_ASSUMPTIONS
    return {name: min(value, MAX_ASSUMPTION) for name, value in values.items()}


def compute_speed_stiffness(settings: Settings) -> Array:
    """Return the force of wheel loops per missing speed, forward and sideways, (2,), N s/m."""
    cosines = _compute_direction_cosines(settings)
    return (cosines**2).sum(0) / compute_rim_compliance(settings)


def compute_rim_compliance(settings: Settings) -> float:
    """Return the speed R r^2 / (k (kp + k)) that a rim loses per force that it exerts, m/(N s)."""
    motor, kp = settings.motor, settings.firmware.kp
    constant = motor.wheel_back_emf_v_s
    return motor.resistance_ohm * settings.wheels.radius_m**2 / (constant * (kp + constant))


def compute_lag(settings: Settings) -> Array:
    """Return the time constant of small velocity steps forward and sideways, (2,), s."""
    return settings.body.mass_kg / compute_speed_stiffness(settings)


def compute_friction_loss(settings: Settings) -> Array:
    """Return the speed that robots lose to dry friction, forward and sideways, (2,), m/s.

    The friction consists of three parts: the rolling resistance of the carpet, the friction torque
    of gears and motors over the wheel radius, and the friction of the rollers, which turn by the
    motion along the axle.
    """
    cosines = _compute_direction_cosines(settings)
    weight = settings.body.mass_kg * GRAVITY
    roller_fraction = np.sqrt(np.maximum(1 - cosines**2, 0.0)).mean(0)
    roller_friction = settings.drivetrain.roller_friction * weight * roller_fraction
    force = (
        settings.carpet.rolling_resistance * weight
        + roller_friction
        + settings.hub_friction_nm / settings.wheels.radius_m * cosines.sum(0)
    )
    return force / compute_speed_stiffness(settings)


def compute_creep_law(settings: Settings) -> CreepLaw:
    """Return the creep law of a robot on level carpet."""
    wheels, body = settings.wheels.kinematics, settings.body
    loads = compute_normal_forces(settings)
    lever_arms = np.array([1.0, 1.0, wheels.arm])
    inertia = np.array([body.mass_kg, body.mass_kg, body.yaw_inertia_kg_m2])
    axle_loads = (loads[:, None] * np.abs(wheels.axles[:, :2])).sum(0)
    bearing_drag = settings.drivetrain.roller_friction * axle_loads
    carpet_drag = settings.carpet.rolling_resistance * loads.sum() * lever_arms
    drag = carpet_drag + np.append(bearing_drag, 0.0)
    stiffness = wheels.matrix.T @ (loads[:, None] * wheels.matrix)
    compliance = np.linalg.inv(stiffness) / settings.drivetrain.creep_stiffness
    drag_free_coefficient = inertia * np.diag(compliance)  # T0
    gain = 1 / (1 + drag_free_coefficient * lever_arms * drag / inertia)
    return CreepLaw(drag, gain, gain**2 * drag_free_coefficient)


def compute_normal_forces(settings: Settings) -> Array:
    """Return the normal forces of the wheels at rest, (W,), N."""
    body = settings.body
    fractions = compute_load_matrix(settings.wheels.kinematics) @ [1.0, body.com_x_m, 0.0]
    return body.mass_kg * GRAVITY * fractions


def _compute_direction_cosines(settings: Settings) -> Array:
    """Return the absolute cosines between rims and forward or sideways motion, (W, 2)."""
    return np.abs(settings.wheels.kinematics.matrix[:, :2])
