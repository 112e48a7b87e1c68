r"""Law of motion of a robot on creeping wheels, solved for many stretches and sets of parameters at once.

Wheel i has the rim direction d_i = (cosines, arm), the load N_i, and travels at |v_i| over the carpet. Its rim speed
r_i and the ground speed d_i nu differ by what its traction f_i costs:

    r_i - d_i nu = (z + |v_i| / (C N_i)) f_i,        |f_i| <= sqrt(mu^2 - b^2) N_i
    M nu' = sum f_i d_i - drag + lean,               nu: body twist

C is the creep stiffness. The drag is that of `omni_mj.robot.carpet`: the pile p N_i against the travel of a wheel,
roller bearings b N_i along its axle, and three terms that grow with speed (see `Body`). Loads shift with the
acceleration, because the centre of mass is above the floor. If encoders are the input, r_i is the measured rim speed
times a scale, and z is 0. If commands are the input, r_i is the commanded rim speed and 1/z the stiffness of the wheel
loops, so that along an axis

    (tau + T0 |v|) (v' + drag / m) = K u - v,        T0 = m / (C sum N_i d_i^2),    tau = z m / sum d_i^2.

Turn rates pass a loop on the gyro, (1 + k) u - k w. All forces are divided by the mass. A sloping carpet pulls with a
constant acceleration in the world frame ("lean").
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Self

import numpy as np

from omni_control.kinematics import Array, body_to_world, world_to_body
from omni_control.traction import GRAVITY, compute_load_distribution
from omni_mj.config import nominal_model
from omni_mj.config.settings import CYCLE_RATE_HZ, FRAME_RATE_HZ, Settings
from omni_mj.robot.carpet import AT_REST_M_S
from omni_mj.robot.motors import Motor
from omni_mj.studies.identify.log_segments import Stretches

Parameters = dict[str, float]
LATE = "latency_s"  # the parameter by which inputs act late
ROLLER_KG = 0.0015  # models/ssl_robot.xml; mass that turns with the rims, 1 to 2 % of the robot's
RUBBED_M_S = 0.05  # wheel speed above which the dry friction of wheel and motor is complete
# Two rollers touch around each handover; rollers spin up before they carry; rubber is pressed.
# Measured on the plant without dry drag: three robots, 0.6 to 1.9 m/s, three directions, within
# 0.04 N.
BOTH_TOUCH, SPUN_EARLY, PRESSED_S_M = 1.5, 1.1, 0.004
STIFFEST_S = 1e-4  # least compliance z m of a wheel
MOST_DELAY = 0.15  # of the give of a wheel loop, so that the mass stays positive
STEP_S = 0.01  # longest integration step


@dataclass(frozen=True, eq=False)
class Body:
    """Known properties of a robot with W wheels; masses and forces are divided by the robot's mass.

    Attributes:
        along: Directions of rims, (W, 3).
        axles: Directions of axles, (W, 3).
        radius: Of the wheels, m.
        centre: Of mass, ahead of the middle of the wheels, m.
        mass: Matrix (3, 3) of a twist.
        loads: At rest, (W,) m/s^2.
        shift: Load per acceleration, (2, W).
        viscous: Drag of a wheel's rollers over its speed along the axle, 1/s.
        spun: Drag of rollers that spin up, over the same and the rim speed, 1/m.
        commutation: By which share a motor's resistance grows with its rim speed, s/m.
        hub: Inertia of a motor, as a mass at the rim.
        wait: Mean time that a command waits for the next run of the wheel loops, s.
        loop_delay: Of the wheel speed that the loops see, times their share of the stiffness, s.
        gyro_delay: Of the turn rate that the loop on the gyro sees, s.
    """

    along: Array
    axles: Array
    radius: float
    centre: float
    mass: Array
    loads: Array
    shift: Array
    viscous: float
    spun: float
    commutation: float
    hub: float
    wait: float
    loop_delay: float
    gyro_delay: float

    @classmethod
    def of(cls, settings: Settings) -> Self:
        """Return the body that the settings describe."""
        body, wheels, motor = settings.body, settings.wheels, Motor.from_settings(settings.motor)
        along, radius, centre, kg = (
            wheels.kinematics.matrix,
            wheels.radius_m,
            body.com_x_m,
            body.mass_kg,
        )
        count, roller = wheels.rollers, wheels.roller_radius_m
        # Mass of a wheel's rollers as seen at its rim
        rims = count * ROLLER_KG * (1 - roller / radius) ** 2
        mass = np.array(
            [[1, 0, 0], [0, 1, centre], [0, centre, body.yaw_inertia_kg_m2 / kg + centre**2]]
        )
        turning = roller - radius * (
            1 - np.cos(np.pi / count)
        )  # radius at which a roller is spun up
        cycles, frame = (
            round(CYCLE_RATE_HZ / settings.firmware.rate_hz),
            CYCLE_RATE_HZ // FRAME_RATE_HZ,
        )
        gain = settings.firmware.kp + motor.wheel_back_emf_constant
        return cls(
            along=along,
            axles=wheels.kinematics.axles,
            radius=radius,
            centre=centre,
            mass=mass + rims / kg * along.T @ along,
            loads=nominal_model.compute_normal_forces(settings) / kg,
            shift=compute_load_distribution(wheels.kinematics, body.com_height_m)[1][:, :2].T,
            viscous=BOTH_TOUCH * settings.drivetrain.roller_damping_nm_s / roller**2 / kg,
            spun=SPUN_EARLY
            * count
            / (2 * np.pi * radius)
            * 0.4
            * ROLLER_KG
            * (roller / turning) ** 2
            / kg,
            commutation=motor.commutation * motor.gear_ratio / (motor.resistance * radius),
            hub=motor.rotor_inertia * motor.gear_ratio**2 / (radius**2 * kg),
            wait=float(np.mean(-frame * np.arange(cycles) % cycles)) / CYCLE_RATE_HZ,
            loop_delay=(cycles + 1) / CYCLE_RATE_HZ * settings.firmware.kp / gain,
            gyro_delay=(cycles / 2 + 1) / CYCLE_RATE_HZ,
        )

    def parameters(self, settings: Settings, by_wheels: bool) -> Parameters:
        """Return the parameters that the settings say, for wheel speeds or for commands as the input."""
        known = {
            LATE: 0.0,
            "scale": 1.0,
            "arm": 1.0,
            "compass_rad": 0.0,
            "creep": 1 / settings.drivetrain.creep_stiffness,
            "rolling_resistance": settings.carpet.rolling_resistance,
            "roller_friction": settings.drivetrain.roller_friction,
            "lean_x_m_s2": 0.0,
            "lean_y_m_s2": 0.0,
            "grip": settings.carpet.friction,
        }
        if by_wheels:
            return known | {"give_s": 0.0, "friction_m_s": 0.0, "turn_rate_gain": 0.0}
        motor, firmware = Motor.from_settings(settings.motor), settings.firmware
        constant, gain = motor.wheel_back_emf_constant, firmware.kp + motor.wheel_back_emf_constant
        softness = nominal_model.compute_rim_compliance(settings)
        return known | {
            "scale": 1 - (1 - firmware.feed_forward) * constant / gain,
            "give_s": settings.body.mass_kg * softness,
            "friction_m_s": settings.hub_friction_nm / self.radius * softness,
            "turn_rate_gain": firmware.turn_rate_gain,
        }


def simulate(body: Body, stretches: Stretches, p: Mapping[str, Array], first: Array) -> Array:
    """Solve the law for S stretches and P sets of parameters.

    Each step takes the mean input over it and the coefficients of its middle, and is solved by the
    (0, 2) Pade approximant of the exponential: second order, and stable for any stiffness.

    Args:
        body: The robot.
        stretches: Inputs and times.
        p: Parameters by name, (P, 1); see `Body.parameters`.
        first: Pose, twist and acceleration at the first sample, world frame, (S, P, 3, 3).

    Returns:
        Poses at all samples, world frame, (S, P, m, 3).
    """
    late, compass = p[LATE][:, 0], p["compass_rad"][:, 0]
    lean = np.concatenate([p["lean_x_m_s2"], p["lean_y_m_s2"], np.zeros_like(p["grip"])], -1)
    # (P, W, 3)
    along = body.along * np.concatenate([np.ones((len(late), 2)), p["arm"]], 1)[:, None]
    cap = np.sqrt(np.maximum(p["grip"] ** 2 - p["roller_friction"] ** 2, 1e-4))
    by_wheels = stretches.are_wheels
    mass = body.mass
    parts = max(1, int(np.ceil(stretches.period / STEP_S)))
    inputs, duration = stretches.mean_inputs(late + (0 if by_wheels else body.wait), parts)
    pose, velocity = first[..., 0, :], first[..., 1, :]
    pull = world_to_body(first[..., 2, :], pose[..., 2] + compass)
    unit = np.eye(3)
    poses = [pose]
    for k in range(duration.shape[1]):
        h = duration[:, k, None, None]
        heading = pose[..., 2] + 0.5 * h[..., 0] * (
            velocity[..., 2] + 0.5 * h[..., 0] * pull[..., 2]
        )
        axes = heading + compass
        before = world_to_body(velocity, axes)
        middle = before + 0.5 * h * pull
        rolling, across = _apply(along, middle), middle @ body.axles.T
        speed = np.hypot(rolling, across)
        down = world_to_body(lean, axes)
        down[..., 2] = body.centre * down[..., 1]
        load = np.maximum(body.loads + (pull - down)[..., :2] @ body.shift, 0.02 * GRAVITY)
        compliance = p["creep"] * speed / load
        if by_wheels:
            rim = p["scale"] * body.radius * inputs[:, :, k]
        else:
            command = inputs[:, :, k]
            command = np.where(
                stretches.in_body[:, None, None], command, world_to_body(command, heading)
            )
            command[..., 2] += p["turn_rate_gain"][:, 0] * (command[..., 2] - middle[..., 2])
            rim = _apply(along, command)
            soft = p["give_s"] * (1 + body.commutation * np.abs(rim))
            rim = p["scale"] * rim - p["friction_m_s"] * rim / np.maximum(np.abs(rim), RUBBED_M_S)
            compliance = compliance + soft
        stiffness = 1 / np.maximum(compliance, STIFFEST_S)
        stiffness = np.minimum(stiffness, cap * load / np.maximum(np.abs(rim - rolling), 1e-9))
        pile = p["rolling_resistance"] * load / np.maximum(speed, AT_REST_M_S)
        bearing = p["roller_friction"] * load / np.maximum(np.abs(across), AT_REST_M_S)
        axle_drag = pile + bearing + body.viscous + body.spun * np.abs(rolling)
        resisting = _weigh(stiffness + PRESSED_S_M * load + pile, along) + _weigh(
            axle_drag, body.axles
        )
        pushing = _apply(along.mT, stiffness * rim) + down
        if (
            not by_wheels
        ):  # the loop on the gyro; motors, which turn with the rims, and loops that see late
            gyro = (
                p["turn_rate_gain"]
                * p["scale"]
                * p["arm"]
                * body.along[0, 2]
                * _apply(along.mT, stiffness)
            )
            resisting[..., 2] += gyro
            pushing += gyro * middle[..., 2:]
            inertia = stiffness * (body.hub * soft - np.minimum(body.loop_delay, MOST_DELAY * soft))
            mass = body.mass + _weigh(inertia, along)
            mass[..., 2] -= body.gyro_delay * gyro
        x = h[..., None] * np.linalg.solve(mass, resisting)
        gain = h * np.linalg.solve(mass, pushing[..., None])[..., 0]
        upper = unit + 0.5 * x
        reach = _apply(upper, gain)
        travel = h * _apply(upper, before) + 0.5 * h * (2 * reach - gain)
        after, moved = np.moveaxis(
            np.linalg.solve(unit + x @ upper, np.stack([before + reach, travel], -1)), -1, 0
        )
        pull = (after - before) / h
        pose, velocity = pose + body_to_world(moved, axes), body_to_world(after, axes)
        if (k + 1) % parts == 0:
            poses.append(pose)
    return np.stack(poses, 2)


def _apply(matrix: Array, vectors: Array) -> Array:
    """Multiply matrices (..., m, n) by vectors (..., n)."""
    product: Array = (matrix @ vectors[..., None])[..., 0]
    return product


def _weigh(weights: Array, directions: Array) -> Array:
    """Return the sums of weights (..., W) times the outer squares of directions (..., W, 3)."""
    return (directions.mT * weights[..., None, :]) @ directions
