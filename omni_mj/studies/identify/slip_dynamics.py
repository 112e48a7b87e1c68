r"""Motion of a robot on creeping wheels, for many segments and parameter sets at once.

Let nu be the body twist and M the mass matrix. Wheel i has the rim direction d_i = (cosines, arm)
and the normal force N_i. The rim speed r_i exceeds the speed d_i nu of the center along the rim.
The difference is due to the slip s_i of the rubber and to the wheel loops, with the traction f_i:

    r_i - d_i nu = s_i + z f_i,        s_i = |v_i|_c / (C N_i h(s_i)) f_i,        |f_i| <= mu' N_i
    M nu' = sum f_i d_i - drag + slope

C is the creep stiffness, h the softening, |v_i|_c the speed of the contact, mu' the friction along
the rim (all as in `omni_mj.robot.wheel_carpet_forces`), and z the compliance of the wheel loops.
The drag is that of the same module: rolling resistance p N_i against the motion of a wheel, roller
bearings b N_i along its axle, and three terms that grow with speed (see `RobotDynamics`). Normal
forces change with the acceleration, because the center of mass is above the floor. A slope of the
carpet is a constant acceleration in the world frame.

The inputs u are wheel speeds or commands. For wheel speeds, r_i is the rim speed by the encoder
times a scale, and z is 0. For commands, r_i is the commanded rim speed, and z is not 0. Then the
velocity v along an axis follows

    (tau + T0 |v|) (v' + drag / m) = K u - v,
    T0 |v| = m / (C sum N_i d_i^2 h(s_i) / |v_i|_c),    tau = z m / sum d_i^2.

A gyro loop with the gain k turns the commanded turn rate u into (1 + k) u - k w, with the turn rate
w of the robot. In the code, masses and forces are divided by the robot's mass.
"""

from collections.abc import Mapping

import numpy as np

from omni_control.kinematics import Array, body_to_world, world_to_body
from omni_control.traction_limits import GRAVITY, compute_load_distribution, compute_softening
from omni_mj.config import CYCLE_RATE_HZ, CYCLES_PER_FRAME, nominal_model
from omni_mj.config.settings import Settings
from omni_mj.robot.wheel_carpet_forces import AT_REST_M_S
from omni_mj.studies.identify.log_segments import LogSegments

Parameters = dict[str, float]
DEAD_TIME = "dead_time_s"  # name of the parameter
ROLLER_KG = 0.0015  # of models/ssl_robot.xml; all rollers are 1 to 2 % of the robot's mass
DRY_FRICTION_M_S = 0.05  # rim speed below which dry friction fades linearly to zero
# Factors on the drag of rollers, because two of them touch at each handover and because they spin
# up before they carry a load; and drag of compressed rubber over normal force and rim speed, s/m.
# Fitted to three robots on the plant without rolling resistance and roller friction, 0.6 to 1.9 m/s
# in three directions, within 0.04 N.
HANDOVER_FACTOR, SPIN_UP_FACTOR, COMPRESSION_S_M = 1.5, 1.1, 0.004
MIN_COMPLIANCE_S = 1e-4  # smallest compliance z m of a wheel
# Largest delay of a wheel loop relative to its compliance. It keeps the effective mass positive.
MAX_LOOP_DELAY = 0.15
MIN_LOAD = 0.02 * GRAVITY  # smallest normal force of a wheel over the robot's mass, m/s^2
STEP_S = 0.01  # longest integration step
SOFTENING_ITERATIONS = 2


class RobotDynamics:
    """Known properties of a robot with W wheels. Masses and forces are divided by its mass.

    Args:
        settings: Settings of the robot.

    Attributes:
        settings: The settings.
        rim_directions: Rows d_i that map a body twist to the speed along each rim, (W, 3).
        axle_directions: Rows that map a body twist to the speed along each axle, (W, 3).
        mass_matrix: Matrix M (3, 3) of body and rollers.
        loads: Normal forces at rest, (W,) m/s^2.
        load_transfer: Change of normal forces per acceleration forward and sideways, (2, W).
        roller_viscosity: Drag of a wheel's rollers per speed along the axle, 1/s.
        spin_up_drag: Drag of rollers that spin up, per speed along the axle and rim speed, 1/m.
        commutation: Relative increase of a motor's resistance per rim speed, s/m.
        rotor_inertia: Inertia of a motor as a mass at the rim, without unit.
        command_wait: Mean time until the wheel loops use a new command, s.
        loop_delay: Delay of the measured wheel speed, times the loop's contribution to its total
            stiffness (the remainder is back-EMF), s.
        gyro_delay: Delay of the turn rate in the gyro loop, s.
    """

    def __init__(self, settings: Settings) -> None:
        self.settings = settings
        body, wheels, motor = settings.body, settings.wheels, settings.motor
        x, kg, radius = body.com_x_m, body.mass_kg, wheels.radius_m
        n_rollers, roller_radius = wheels.rollers, wheels.roller_radius_m
        self.rim_directions = wheels.kinematics.matrix
        self.axle_directions = wheels.kinematics.axles
        # Mass of a wheel's rollers at its rim
        rim_mass = n_rollers * ROLLER_KG * (1 - roller_radius / radius) ** 2
        body_mass = np.array([[1, 0, 0], [0, 1, x], [0, x, body.yaw_inertia_kg_m2 / kg + x**2]])
        self.mass_matrix = body_mass + rim_mass / kg * self.rim_directions.T @ self.rim_directions
        self.loads = nominal_model.compute_normal_forces(settings) / kg
        load_distribution = compute_load_distribution(wheels.kinematics, body.com_height_m)
        self.load_transfer = load_distribution[1][:, :2].T
        damping = settings.drivetrain.roller_damping_nm_s
        self.roller_viscosity = HANDOVER_FACTOR * damping / roller_radius**2 / kg
        # Radius at which a roller is spun up
        spin_up_radius = roller_radius - radius * (1 - np.cos(np.pi / n_rollers))
        rollers_per_m = n_rollers / (2 * np.pi * radius)
        roller_inertia = 0.4 * ROLLER_KG * (roller_radius / spin_up_radius) ** 2
        self.spin_up_drag = SPIN_UP_FACTOR * rollers_per_m * roller_inertia / kg
        self.commutation = (
            motor.commutation_ohm_s * motor.gear_ratio / motor.resistance_ohm / radius
        )
        self.rotor_inertia = motor.rotor_inertia_kg_m2 * motor.gear_ratio**2 / (radius**2 * kg)
        cycles = round(CYCLE_RATE_HZ / settings.firmware.rate_hz)
        wait_cycles = -CYCLES_PER_FRAME * np.arange(cycles) % cycles
        self.command_wait = float(wait_cycles.mean()) / CYCLE_RATE_HZ
        loop_gain = settings.firmware.kp + motor.wheel_back_emf_v_s
        self.loop_delay = (cycles + 1) / CYCLE_RATE_HZ * settings.firmware.kp / loop_gain
        self.gyro_delay = (cycles / 2 + 1) / CYCLE_RATE_HZ

    def nominal_parameters(self, by_wheels: bool) -> Parameters:
        """Return the parameters of the model for the settings of the robot.

        Args:
            by_wheels: Whether the inputs are wheel speeds, otherwise commands.

        Returns:
            dead_time_s: Delay of the inputs, s.
            scale, arm: Ratios of effective to nominal rim speed, and of effective to nominal arm.
            heading_offset_rad: Angle from the measured heading to the robot's x-axis.
            creep_compliance: 1 / C.
            rolling_resistance, roller_friction: p and b.
            slope_x_m_s2, slope_y_m_s2: Acceleration by the slope of the carpet, world frame.
            friction: Friction coefficient mu.
            compliance_s: Compliance z m of the wheel loops; 0 for wheel speeds.
            dry_friction_m_s: Rim speed lost by dry friction; 0 for wheel speeds.
            turn_rate_gain: Gain k of the gyro loop; 0 for wheel speeds.
        """
        settings = self.settings
        nominal = {
            DEAD_TIME: 0.0,
            "scale": 1.0,
            "arm": 1.0,
            "heading_offset_rad": 0.0,
            "creep_compliance": 1 / settings.drivetrain.creep_stiffness,
            "rolling_resistance": settings.carpet.rolling_resistance,
            "roller_friction": settings.drivetrain.roller_friction,
            "slope_x_m_s2": 0.0,
            "slope_y_m_s2": 0.0,
            "friction": settings.carpet.friction,
        }
        if by_wheels:
            return nominal | {"compliance_s": 0.0, "dry_friction_m_s": 0.0, "turn_rate_gain": 0.0}
        motor, firmware = settings.motor, settings.firmware
        constant, gain = motor.wheel_back_emf_v_s, firmware.kp + motor.wheel_back_emf_v_s
        softness = nominal_model.compute_rim_compliance(settings)
        return nominal | {
            "scale": 1 - (1 - firmware.feedforward) * constant / gain,
            "compliance_s": settings.body.mass_kg * softness,
            "dry_friction_m_s": settings.hub_friction_nm / settings.wheels.radius_m * softness,
            "turn_rate_gain": firmware.turn_rate_gain,
        }


def simulate_segments(
    dynamics: RobotDynamics, segments: LogSegments, p: Mapping[str, Array], initial: Array
) -> Array:
    """Simulate S segments with P parameter sets.

    In each step, the input is its mean and the coefficients are those of the middle of the step.
    The step is then solved with the (0, 2) Pade approximant of the exponential, which is of second
    order and stable for any stiffness.

    Args:
        dynamics: The robot.
        segments: Inputs and times.
        p: Mapping from name to parameter, (P, 1); see `RobotDynamics.nominal_parameters`.
        initial: Pose, twist and acceleration at the first sample, world frame, (S, P, 3, 3).

    Returns:
        Poses at all samples, world frame, (S, P, m, 3).
    """
    delay, heading_offset = p[DEAD_TIME][:, 0], p["heading_offset_rad"][:, 0]
    slope = np.concatenate([p["slope_x_m_s2"], p["slope_y_m_s2"], np.zeros_like(p["friction"])], -1)
    model = _SlipModel(dynamics, segments, p)
    substeps = max(1, int(np.ceil(segments.period / STEP_S)))
    wait = 0 if segments.source == "wheels" else dynamics.command_wait
    inputs, duration = segments.compute_mean_inputs(delay + wait, substeps)
    pose, velocity = initial[..., 0, :], initial[..., 1, :]
    acceleration = world_to_body(initial[..., 2, :], pose[..., 2] + heading_offset)
    poses = [pose]
    for k in range(duration.shape[1]):
        h = duration[:, k, None, None]
        heading = pose[..., 2] + 0.5 * h[..., 0] * (
            velocity[..., 2] + 0.5 * h[..., 0] * acceleration[..., 2]
        )
        body_heading = heading + heading_offset
        start = world_to_body(velocity, body_heading)
        slope_force = world_to_body(slope, body_heading)
        slope_force[..., 2] = dynamics.settings.body.com_x_m * slope_force[..., 1]
        middle = start + 0.5 * h * acceleration
        mass, resistance, force = model.linearize(
            inputs[:, :, k], heading, middle, acceleration, slope_force
        )
        end, displacement = _integrate_step(mass, resistance, force, start, h)
        acceleration = (end - start) / h
        pose = pose + body_to_world(displacement, body_heading)
        velocity = body_to_world(end, body_heading)
        if (k + 1) % substeps == 0:
            poses.append(pose)
    return np.stack(poses, 2)


class _SlipModel:
    """Equation of motion of P parameter sets, linearized to M nu' = force - resistance nu.

    Args:
        dynamics: The robot.
        segments: S segments.
        p: Mapping from name to parameter, (P, 1).
    """

    def __init__(
        self, dynamics: RobotDynamics, segments: LogSegments, p: Mapping[str, Array]
    ) -> None:
        self._dynamics, self._p = dynamics, p
        self._by_wheels = segments.source == "wheels"
        self._in_body = segments.in_body[:, None, None]
        arm_scale = np.concatenate([np.ones((len(p["arm"]), 2)), p["arm"]], 1)[:, None]
        self._rim_directions = dynamics.rim_directions * arm_scale  # (P, W, 3)
        self._friction = np.sqrt(np.maximum(p["friction"] ** 2 - p["roller_friction"] ** 2, 1e-4))

    def linearize(
        self, inputs: Array, heading: Array, twist: Array, acceleration: Array, slope_force: Array
    ) -> tuple[Array, Array, Array]:
        """Return mass (..., 3, 3), resistance (..., 3, 3) and force (S, P, 3) at a body twist.

        Args:
            inputs: Wheel speeds or commands, (S, P, K).
            heading: Measured heading, (S, P).
            twist: Body twist, (S, P, 3).
            acceleration: Acceleration in the previous step, body frame, which changes the normal
                forces, (S, P, 3).
            slope_force: Force by the slope, body frame, (S, P, 3).
        """
        dynamics, p, rims = self._dynamics, self._p, self._rim_directions
        wheels = dynamics.settings.wheels
        rolling_speed, axle_speed = _apply(rims, twist), twist @ dynamics.axle_directions.T
        speed = np.hypot(rolling_speed, axle_speed)
        shift = (acceleration - slope_force)[..., :2] @ dynamics.load_transfer
        load = np.maximum(dynamics.loads + shift, MIN_LOAD)
        contact_speed = np.hypot(rolling_speed, wheels.contact_ratio * axle_speed)
        compliance = p["creep_compliance"] * contact_speed / load
        loop_compliance = np.zeros(())
        if self._by_wheels:
            rim_speed = p["scale"] * wheels.radius_m * inputs
        else:
            rim_speed, loop_compliance = self._wheel_loops(inputs, heading, twist)
        slip_speed = np.maximum(np.abs(rim_speed - rolling_speed), 1e-9)
        compliance = _soften(compliance, loop_compliance, slip_speed / (self._friction * load))
        stiffness = 1 / np.maximum(compliance + loop_compliance, MIN_COMPLIANCE_S)
        # A sliding wheel has the stiffness of a secant through the friction limit.
        stiffness = np.minimum(stiffness, self._friction * load / slip_speed)
        rolling = p["rolling_resistance"] * load / np.maximum(speed, AT_REST_M_S)
        bearing = p["roller_friction"] * load / np.maximum(np.abs(axle_speed), AT_REST_M_S)
        axle_drag = (
            rolling
            + bearing
            + dynamics.roller_viscosity
            + dynamics.spin_up_drag * np.abs(rolling_speed)
        )
        rim_resistance = stiffness + COMPRESSION_S_M * load + rolling
        resistance = _weighted_squares(rim_resistance, rims) + _weighted_squares(
            axle_drag, dynamics.axle_directions
        )
        force = _apply(rims.mT, stiffness * rim_speed) + slope_force
        mass = dynamics.mass_matrix
        if not self._by_wheels:
            gyro = (
                p["turn_rate_gain"]
                * p["scale"]
                * p["arm"]
                * dynamics.rim_directions[0, 2]
                * _apply(rims.mT, stiffness)
            )
            resistance[..., 2] += gyro
            force += gyro * twist[..., 2:]
            mass = self._effective_mass(stiffness, loop_compliance, gyro)
        return mass, resistance, force

    def _wheel_loops(self, inputs: Array, heading: Array, twist: Array) -> tuple[Array, Array]:
        """Return commanded rim speeds and the compliance of the wheel loops, (S, P, W)."""
        p = self._p
        command = np.where(self._in_body, inputs, world_to_body(inputs, heading))
        command[..., 2] += p["turn_rate_gain"][:, 0] * (command[..., 2] - twist[..., 2])
        rim = _apply(self._rim_directions, command)
        compliance = p["compliance_s"] * (1 + self._dynamics.commutation * np.abs(rim))
        friction = p["dry_friction_m_s"] * rim / np.maximum(np.abs(rim), DRY_FRICTION_M_S)
        return p["scale"] * rim - friction, compliance

    def _effective_mass(self, stiffness: Array, loop_compliance: Array, gyro: Array) -> Array:
        """Return the mass matrix with the inertia of rotors and the delays of the loops."""
        dynamics = self._dynamics
        delay = np.minimum(dynamics.loop_delay, MAX_LOOP_DELAY * loop_compliance)
        inertia = stiffness * (dynamics.rotor_inertia * loop_compliance - delay)
        mass = dynamics.mass_matrix + _weighted_squares(inertia, self._rim_directions)
        mass[..., 2] -= dynamics.gyro_delay * gyro
        return mass


def _soften(compliance: Array, loop_compliance: Array, slip: Array) -> Array:
    """Return the compliance of rubber in series with wheel loops, softened by its slip.

    Args:
        compliance: Compliance of rubber that sticks, |v_i|_c / (C N).
        loop_compliance: Compliance of the wheel loops.
        slip: Slip of rubber and loops together, over the friction limit.
    """
    softened = compliance
    for _ in range(SOFTENING_ITERATIONS):
        rubber_slip = slip * softened / np.maximum(softened + loop_compliance, 1e-9)
        full_sliding = np.maximum(3 * compliance, 1e-9)
        softened = compliance / compute_softening(np.minimum(rubber_slip / full_sliding, 1.0))
    return softened


def _integrate_step(
    mass: Array, resistance: Array, force: Array, start: Array, h: Array
) -> tuple[Array, Array]:
    """Integrate mass nu' = force - resistance nu over steps of duration h.

    Args:
        mass: Mass matrices, (..., 3, 3).
        resistance: Resistance matrices, (..., 3, 3).
        force: Forces, (..., 3).
        start: Body twists at the start of the step, (..., 3).
        h: Durations of the step, (S, 1, 1) s.

    Returns:
        Body twists at the end, and displacements, body frame, (..., 3).
    """
    unit = np.eye(3)
    rates = h[..., None] * np.linalg.solve(mass, np.concatenate([resistance, force[..., None]], -1))
    x, impulse = rates[..., :3], rates[..., 3]
    upper = unit + 0.5 * x
    change = _apply(upper, impulse)
    rhs_displacement = h * _apply(upper, start) + 0.5 * h * (2 * change - impulse)
    solution = np.linalg.solve(unit + x @ upper, np.stack([start + change, rhs_displacement], -1))
    end, displacement = np.moveaxis(solution, -1, 0)
    return end, displacement


def _apply(matrix: Array, vectors: Array) -> Array:
    """Multiply matrices (..., m, n) by vectors (..., n)."""
    return (matrix @ vectors[..., None])[..., 0]


def _weighted_squares(weights: Array, directions: Array) -> Array:
    """Return sums of weights (..., W) times outer squares of directions (..., W, 3)."""
    return (directions.mT * weights[..., None, :]) @ directions
