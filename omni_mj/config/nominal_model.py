"""Closed-form response of a robot, from which the team's assumptions about it are derived.

**Wheel loops.** A wheel that drives exerts the force eta k (kp + k) / (R r^2) along its rim per m/s
of missing speed, with the proportional gain kp, the torque constant k at the wheel (motor's
constant times gear ratio), the resistance R, the wheel radius r and the gear's efficiency eta. All
wheels together exert this force times sum c^2, where c are the direction cosines between rims and
motion. This is the stiffness of `compute_speed_stiffness`. The lag is the mass over this stiffness.
The friction loss is the dry friction force over it. Rotor inertia and creep are neglected. If a
loop has integral action, only its proportional gain is considered.

**Creep.** The rim of wheel i slips by s_i and exerts the traction of the brush model
(`omni_mj.robot.wheel_carpet_forces`)

    f_i = N_i C / |v_i|_c  h(s_i) s_i

with the normal force N_i, the creep stiffness C, the contact speed |v_i|_c and the softening h. All
rims slip like a rigid body, s = G e, where row i of G is the rim direction d_i and the lever arm l.
Tractions balance the force and moment on the body, G^T f = m a + D, with the drag D that contacts
transmit. The solution along an axis is e = |v| g(m a + D). TIGERs write K u - v = T |u| v', so that

    K = 1 / (1 + g(D)),        T = K^2 m g'(D)

are the secant and the tangent at the drag, where rubber has the stiffness N_i C (1 - x_i)^2 /
|v_i|_c with its slip x_i relative to full sliding. `MotionModel` adds the softening beyond. On the
spot T is multiplied by l |u|, and the yaw inertia takes the place of m.
docs/explanation/physics.md names the effects that are neglected.
"""

from typing import NamedTuple

import numpy as np

from omni_control.kinematics import Array
from omni_control.traction_limits import GRAVITY, compute_load_matrix, compute_softening
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
SOFTENING_ITERATIONS = 10
MAX_SLIDING = 0.9  # fraction of full sliding up to which the creep law is linearized


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
    """Return the speed that a rim loses per force that it exerts, m/(N s).

    It is R r^2 / (eta k (kp + k)) while the motor drives, with the gear's efficiency eta.
    """
    motor, kp = settings.motor, settings.firmware.kp
    constant = motor.wheel_back_emf_v_s
    stiffness = settings.drivetrain.efficiency * constant * (kp + constant)
    return motor.resistance_ohm * settings.wheels.radius_m**2 / stiffness


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
    slip, compliance = _solve_slip(settings, loads, drag)
    gain = 1 / (1 + slip)
    return CreepLaw(drag, gain, gain**2 * inertia / lever_arms * compliance)


def _solve_slip(settings: Settings, loads: Array, drag: Array) -> tuple[Array, Array]:
    """Return slip per speed g under drag along each axis, and its change per force g', both (3,).

    The stiffness of the rubber depends on its slip, so the linear equation is solved repeatedly.

    Args:
        settings: Settings of the robot.
        loads: Normal forces of the wheels, (W,) N.
        drag: Drag along each axis, N, N and N m, (3,).
    """
    wheels, drivetrain = settings.wheels.kinematics, settings.drivetrain
    # |v_i|_c at the speed 1 along each axis, (3, W)
    contact_speeds = np.hypot(wheels.matrix.T, settings.wheels.contact_ratio * wheels.axles.T)
    stiffness = loads * drivetrain.creep_stiffness / contact_speeds
    # Rollers stand still on their bearings while the robot turns on the spot.
    bearing_friction = drivetrain.roller_friction * np.array([[1.0], [1.0], [0.0]])
    rim_friction = np.sqrt(np.maximum(settings.carpet.friction**2 - bearing_friction**2, 1e-9))
    sliding_slip = 3 * rim_friction / drivetrain.creep_stiffness * contact_speeds

    def compute_compliance(stiffness: Array) -> Array:
        """Return the inverse of G^T S G for each axis, (3, 3, 3)."""
        weighted = stiffness[..., None] * wheels.matrix
        return np.asarray(np.linalg.inv(wheels.matrix.T @ weighted), float)

    sliding_fraction = np.zeros_like(stiffness)
    for _ in range(SOFTENING_ITERATIONS):
        compliance = compute_compliance(stiffness * compute_softening(sliding_fraction))
        slip = np.einsum("jkj,j->jk", compliance, drag)  # response to the drag along axis j
        sliding_fraction = np.minimum(np.abs(slip @ wheels.matrix.T) / sliding_slip, MAX_SLIDING)
    tangent_compliance = compute_compliance(stiffness * (1 - sliding_fraction) ** 2)
    axes = np.arange(3)
    return slip[axes, axes], tangent_compliance[axes, axes, axes]


def compute_normal_forces(settings: Settings) -> Array:
    """Return the normal forces of the wheels at rest, (W,), N."""
    body = settings.body
    fractions = compute_load_matrix(settings.wheels.kinematics) @ [1.0, body.com_x_m, 0.0]
    return body.mass_kg * GRAVITY * fractions


def _compute_direction_cosines(settings: Settings) -> Array:
    """Return the absolute cosines between rims and forward or sideways motion, (W, 2)."""
    return np.abs(settings.wheels.kinematics.matrix[:, :2])
