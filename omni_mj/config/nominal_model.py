"""How a robot answers, in closed form from its numbers, and what its team is told of it by default.

**Wheel loops.** A wheel gives n k_t (kp + n k_t) / (R r^2) along its rim per m/s of missing speed; all of them that
times sum d^2, with the direction cosines d between rims and motion, which is `hold`. Lag is mass over `hold`, drag is
dry friction over `hold`. Rotors and creep are left out; of a loop that integrates, its gain alone counts.

**Creep.** Wheel i has the direction d_i of its rim and the lever l, a row D_i = (d_i, l) of D; its rim runs by
s_i = |v_i| f_i / (N_i C) faster than the ground passes (`omni_mj.robot.carpet`). Stiff wheel loops let rims
differ from the ground only as a body can move, s = D e, where e = u - v is the twist by the encoders less that of the
body. In translation all |v_i| = |v|, and force and moment of the tractions f_i = N_i C s_i / |v| are

    (F, M) = D^T f = (C / |v|) D^T N D e,        so        e = |v| / C (D^T N D)^-1 (F, M).

Along an axis j of symmetry F = m a + D_j: what speeds the body up, and what drags at it beyond the contacts (pile and
roller bearings; motors and gears act on the hubs). For v > 0

    u = v + T0 v (a + D_j / m),        T0 = m ((D^T N D)^-1)_jj / C,

which is m / (C sum N_i d_ij^2) where other axes do not mix in, and W / (g C sum d_ij^2) for W wheels of equal loads.
As TIGERs write it, K u - v = T |u| v'. Comparing what depends on v' and what does not,

    K = 1 / (1 + T0 D_j / m),        T = K T0 v / u = K^2 T0 / (1 + K T0 a).

A fit over a whole move weighs speeding up (a > 0) and braking alike, over which T is K^2 T0 up to (K T0 a)^2, 2 % at
2 m/s^2. Drag shows in the gain K, not in T: without it K were 1. Turning on the spot, wheels travel at l |w|, and with
J the yaw inertia and M the drag's moment

    u = w + T0 l |w| (w' + M / J),        T0 = J ((D^T N D)^-1)_ww / C = J / (C l^2 m g),

so that a law with T l |u| in place of T |u| has K = 1 / (1 + T0 l M / J) and again T = K^2 T0.

Loads are those of a body at rest on equal springs, N_i = a + b x_i + c y_i; what shifts in speeding up shifts back in
braking. Left out, with what it changes: bearings' viscous friction and the spinning up of rollers, 0.1 to 0.2 N at
1 m/s, and a rolling radius 0.1 % small (K less by up to 0.014); mass that turns with the rims, 1 to 2 % (T); wheel
loops that are not stiff where loads differ, 3 % (T); and the 1 ms in TIGERs' law, 0.001 s^2/m of T at 1 m/s.
"""

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from omni_control.kinematics import Array
from omni_control.traction import GRAVITY, compute_load_matrix

if TYPE_CHECKING:
    from omni_mj.config.settings import Settings

# Where a loop integrates there is no single lag, and nothing that friction costs for good: a guess.
# It overshoots, so that what it reaches is not known either.
INTEGRATING = {
    "assumed_lag_s": 0.02,
    "assumed_drag_m_s": 0.04,
    "assumed_alpha_forward": 0.0,
    "assumed_alpha_sideways": 0.0,
}
# Effort at 1 m/s beyond that of creep in closed form: viscous friction, rolling radius, battery. On
# six robots it is 0.013 to 0.023 ahead and 0.021 to 0.047 aside, where wheels give way more.
OTHER_EFFORT = 0.02


class CreepLaw(NamedTuple):
    """The numbers of the creep law along forward, sideways and turning, (3,) each.

    Attributes:
        drag: Through the contacts, N, N and N m.
        gain: K as TIGERs fit it.
        time: T, s^2/m.
    """

    drag: Array
    gain: Array
    time: Array


def derive_assumptions(
    settings: "Settings", believed_creep: float | None = None
) -> dict[str, float]:
    """Return the fields of `[control]` that follow from a robot's numbers.

    Lag and drag are means of both axes, to 0.1 ms and 1 mm/s.

    Args:
        settings: Of the robot.
        believed_creep: What the team is told of the creep, s^2/m; a team that takes its robots not
            to creep takes them to reach what they are told. [the robot's own]
    """
    law = compute_creep_law(settings)
    own = round(float(law.time[0]), 4)
    share = believed_creep / own if own and believed_creep is not None else 1.0
    effort = np.ones(2)
    if own:
        effort += share * (1 / law.gain[:2] - 1 + OTHER_EFFORT * np.array([1.0, law.time[1] / own]))
    values = {
        "assumed_lag_s": round(float(compute_lag(settings).mean()), 4),
        "assumed_drag_m_s": round(float(compute_drag(settings).mean()), 3),
        "assumed_creep_s2_m": own,
        "assumed_creep_sideways_s2_m": round(share * float(law.time[1]), 4),
        "assumed_alpha_forward": round(float(1 / effort[0]), 3),
        "assumed_alpha_sideways": round(float(1 / effort[1]), 3),
    }
    if settings.firmware.ki:
        values |= INTEGRATING
    return {name: min(value, 1.0) for name, value in values.items()}


def compute_speed_stiffness(settings: "Settings") -> Array:
    """Return the force per missing speed ahead and aside, (2,) N s/m: that of the loops' gain and of back-EMF."""
    return np.asarray((_cosines(settings) ** 2).sum(0) / compute_rim_compliance(settings))


def compute_rim_compliance(settings: "Settings") -> float:
    """Return by how much a rim is slower than told per force that it pulls with, m/s / N.

    A loop of proportional gain k_p with a motor of speed constant k gives way by R r^2 / (k (k_p +
    k)).
    """
    motor, firmware = settings.motor, settings.firmware
    constant = motor.gear_ratio * motor.torque_constant_nm_a
    return (
        motor.resistance_ohm * settings.wheels.radius_m**2 / (constant * (firmware.kp + constant))
    )


def compute_lag(settings: "Settings") -> Array:
    """Return the time constant of small steps ahead and aside, (2,) s."""
    return np.asarray(settings.body.mass_kg / compute_speed_stiffness(settings))


def compute_drag(settings: "Settings") -> Array:
    """Return the speed that dry friction costs ahead and aside, (2,) m/s.

    It is that of pile, of gears and motors, tau / r at a wheel's rim, and of rollers, which turn by
    the motion's part along their wheel's axle.
    """
    cosines, weight = _cosines(settings), settings.body.mass_kg * GRAVITY
    rollers = (
        settings.drivetrain.roller_friction
        * weight
        * np.sqrt(np.maximum(1 - cosines**2, 0.0)).mean(0)
    )
    force = (
        settings.carpet.rolling_resistance * weight
        + rollers
        + settings.hub_friction_nm / settings.wheels.radius_m * cosines.sum(0)
    )
    return np.asarray(force / compute_speed_stiffness(settings))


def compute_creep_law(settings: "Settings") -> CreepLaw:
    """Return the creep law of a robot on level carpet."""
    wheels, body = settings.wheels.kinematics, settings.body
    load, directions, arms = (
        compute_normal_forces(settings),
        wheels.matrix,
        np.array([1.0, 1.0, wheels.arm]),
    )
    inertia = np.array([body.mass_kg, body.mass_kg, body.yaw_inertia_kg_m2])
    bearing = settings.drivetrain.roller_friction * (
        load[:, None] * np.abs(wheels.axles[:, :2])
    ).sum(0)
    resistance = settings.carpet.rolling_resistance * load.sum() * arms + np.append(bearing, 0.0)
    softness = (
        np.linalg.inv(directions.T @ (load[:, None] * directions))
        / settings.drivetrain.creep_stiffness
    )
    time = inertia * np.diag(softness)
    gain = 1 / (1 + time * arms * resistance / inertia)
    return CreepLaw(resistance, gain, gain**2 * time)


def compute_normal_forces(settings: "Settings") -> Array:
    """Return the loads of the wheels at rest, (W,) N."""
    body = settings.body
    share: Array = compute_load_matrix(settings.wheels.kinematics) @ [1.0, body.com_x_m, 0.0]
    return body.mass_kg * GRAVITY * share


def _cosines(settings: "Settings") -> Array:
    """Return the cosines between rims and motion ahead and aside, without sign, (wheels, 2)."""
    return np.abs(settings.wheels.kinematics.matrix[:, :2])
