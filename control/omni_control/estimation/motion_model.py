"""Motion model of a robot: how its velocity follows its commands.

Per axis i of the body (forward, sideways, turning), with u the acting command and v the velocity:

    (tau_i + g_i^2 T_i s) v'_i = u_i + b_i - c_i n_i - g_i v_i

    g    inverse gain, 1 / alpha (equation 8): the command per speed
    T    creep, s^2/m: rubber under traction slides, in proportion to the speed s of the wheel
    tau  lag of the wheel loops, s
    c    speed that dry friction costs, against the direction of motion n
    b    disturbance: whatever else acts like a command (a collision, a slope, a biased gyro)

The velocity deficit u - v turns the robot in two ways. Wheels yield under traction, each to a
different degree (`YawCoupling`). A weak or sliding wheel and an eccentric center of mass add
the coupling k, which acts like a turn rate -k (u - v).

A command acts `latency` frames after it was sent. Of creep, lag and friction only the forward
values are states. The other axes are in proportion, by the directions of the wheels.
"""

import numpy as np

from omni_control.controllers.base import TeamModel
from omni_control.kinematics import Array, Kinematics, body_to_world, world_to_body
from omni_control.traction import GRAVITY, compute_load_distribution

# Layout of the state: pose, velocity and disturbance in the world frame, then parameters.
POSE, VELOCITY, DISTURBANCE = slice(0, 3), slice(3, 6), slice(6, 9)
HEADING, TURN_RATE = 2, 5
COUPLING = slice(9, 11)  # of the turn rate to the velocity deficit forward and sideways, rad/m
INVERSE_GAIN, FORWARD_INVERSE_GAIN, SIDEWAYS_INVERSE_GAIN = slice(11, 14), 11, 12
DEAD_TIME, CREEP, LAG, FRICTION, SIZE = 14, 15, 16, 17, 18

# Typical wheels of the league, for robots with unknown geometry.
LEAGUE_WHEELS = Kinematics(np.radians([60.0, 135.0, 225.0, 300.0]), 0.08, 0.0285)
NORMALIZED_INERTIA = 0.7  # yaw inertia over m l^2 (TIGERs Mannheim)
GYRO_RESIDUAL = 0.5  # fraction of a turn rate disturbance that a gyro loop of gain 1 leaves
UNKNOWN_ALPHA, YAW_ALPHA = (0.91, 0.91), 0.98  # prior of robots with unknown alpha
FORWARD_LAG_RATIO, FORWARD_FRICTION_RATIO = (
    0.75,
    0.8,
)  # ratios of the forward values to the known means
MIN_LAG_S = 5e-3  # vision of 60 Hz cannot distinguish shorter lags
SLOW_M_S = 0.05  # speed below which dry friction is in proportion to the speed
COM_HEIGHT_M = 0.047  # of the center of mass: TIGERs Mannheim's robots have 45 and 49 mm
MIN_LOAD = 0.1  # load of every wheel over the mean load


class MotionModel:
    """Motion model of the robots of a team.

    Args:
        model: Nominal model.

    Attributes:
        prior: Nominal state (18,), at rest.
        arm: Distance from the center to the wheels, m.
    """

    def __init__(self, model: TeamModel) -> None:
        self._period = model.period
        wheels = model.geometry or LEAGUE_WHEELS
        rim_directions, self.arm = wheels.matrix[:, :2], wheels.arm
        forward, sideways = (rim_directions**2).mean(0)
        # Compliance sideways and in turning, over that forward.
        ratio = forward / sideways
        turn_ratio = GYRO_RESIDUAL * NORMALIZED_INERTIA * forward
        side_creep = model.creep_sideways_s2_m
        creep_ratio = side_creep / model.creep_s2_m if side_creep and model.creep_s2_m else ratio
        self._lag_ratios = np.array([1.0, ratio, turn_ratio])
        self._creep_ratios = np.array([1.0, creep_ratio, turn_ratio])
        mean_direction = np.abs(rim_directions[:, 0]).mean()
        turn_friction = GYRO_RESIDUAL / self.arm * forward / mean_direction
        self._friction_ratios = np.array([1.0, ratio, turn_friction])
        self._yaw_coupling = YawCoupling(wheels, GYRO_RESIDUAL if model.geometry else 0.0)

        self.prior = np.array(
            [
                *INVERSE_GAIN.start * [0.0],
                *(1 / np.array([*(model.alpha or UNKNOWN_ALPHA), YAW_ALPHA])),
                model.delay_frames,
                model.creep_s2_m,
                max(FORWARD_LAG_RATIO * model.lag_s, MIN_LAG_S),
                FORWARD_FRICTION_RATIO * model.friction_loss_m_s,
            ]
        )

    def compute_time_constants(self, state: Array, rim_speed: Array) -> Array:
        """Return the time constants of the velocity (..., n, 3), s.

        Args:
            state: States (..., n, 18).
            rim_speed: Speed of the rims that counts for each axis, (..., n, 3 or 1), m/s.
        """
        inverse_gain = state[..., INVERSE_GAIN]
        creep = inverse_gain * self._creep_ratios * state[..., CREEP, None]
        creep[..., 2] *= inverse_gain[..., 0] ** 2
        return self._lag_ratios * state[..., LAG, None] / inverse_gain + creep * rim_speed

    def step(self, state: Array, command: Array, duration: Array | float) -> Array:
        """Return the states (..., n, 18) after commands acted for some time.

        Args:
            state: States (..., n, 18).
            command: Commands (..., n, 3), world frame.
            duration: How long they act, one for all or (..., n), s.
        """
        duration = np.asarray(duration, float)[..., None]
        heading = state[..., HEADING] + state[..., TURN_RATE] * duration[..., 0] / 2
        inverse_gain = state[..., INVERSE_GAIN]
        velocity = world_to_body(state[..., VELOCITY], heading)
        drive = world_to_body(command + state[..., DISTURBANCE], heading)
        time_constant = self.compute_time_constants(state, self._compute_rim_speeds(velocity))
        acceleration = (drive / inverse_gain - velocity) / time_constant
        drive[..., 2] += self._yaw_coupling.compute_turn_rate(
            state, velocity, acceleration, drive - velocity
        )
        decay = np.exp(-duration / time_constant)
        frictionless = velocity + (1 - decay) * (drive / inverse_gain - velocity)
        final = (drive - self._compute_friction(state, frictionless)) / inverse_gain
        excess = velocity - final
        displacement = duration * final + excess * (1 - decay) * time_constant
        result = state.copy()
        result[..., POSE] += body_to_world(displacement, heading)
        result[..., VELOCITY] = body_to_world(final + excess * decay, heading)
        return result

    def invert(self, state: Array, velocity: Array, next_velocity: Array, heading: Array) -> Array:
        """Return the commands (..., n, 3) that lead from one velocity to another in a frame.

        This is the inverse of `step` without disturbance, but for friction, which is that at the
        mean velocity.

        Args:
            state: States (..., n, 18), for their parameters.
            velocity: Velocities at the beginning of the frame (..., n, 3), world frame.
            next_velocity: Velocities at its end, same.
            heading: Headings in its middle, (..., n) rad.
        """
        velocity = world_to_body(velocity, heading)
        next_velocity = world_to_body(next_velocity, heading)
        rim_speed = self._compute_rim_speeds(velocity)
        decay = np.exp(-self._period / self.compute_time_constants(state, rim_speed))
        final = (next_velocity - decay * velocity) / (1 - decay)
        friction = self._compute_friction(state, (velocity + next_velocity) / 2)
        command = final * state[..., INVERSE_GAIN] + friction
        deficit, acceleration = command - velocity, (next_velocity - velocity) / self._period
        command[..., 2] -= self._yaw_coupling.compute_turn_rate(
            state, velocity, acceleration, deficit
        )
        return body_to_world(command, heading)

    def _compute_rim_speeds(self, velocity: Array) -> Array:
        """Return the rim speed that counts for each axis, (..., n, 3) m/s."""
        speed = np.hypot(velocity[..., 0], velocity[..., 1])
        return np.stack([speed, speed, np.hypot(speed, self.arm * velocity[..., 2])], axis=-1)

    def _compute_friction(self, state: Array, velocity: Array) -> Array:
        """Return the speeds (..., n, 3) that dry friction costs at body velocities (..., n, 3)."""
        rim_speed = np.maximum(self._compute_rim_speeds(velocity), SLOW_M_S)
        direction = velocity * [1.0, 1.0, self.arm] / rim_speed
        return self._friction_ratios * state[..., FRICTION, None] * direction


class YawCoupling:
    """Turn rate that driving causes: compliant wheels, and the couplings of the state.

    A wheel k yields along its rim by its traction over a stiffness c_k. Two effects add up: the lag
    of its speed loop, and creep, which is in proportion to the speed of the wheel and inversely to
    its load (Pacejka, Tire and Vehicle Dynamics, brush model). In units that cancel

        1 / c_k = tau + T |V_k| / n_k,    V_k = v + w l d_k,    n_k = load over the mean load

    with lag tau and creep T of driving forward, and the rim's direction d_k. A velocity deficit e
    and a turn rate deficit e_w cause a moment l sum c_k (d_k . e + l e_w). So e turns the robot
    like a commanded turn rate of

        r sum c_k (d_k . e) / (l sum c_k)

    where r is the fraction that a gyro loop leaves. The sum is not zero, for three reasons: rim
    directions need not add up to zero; wheels that turning makes faster yield more; and
    acceleration unloads the wheels on the side towards which it points.

    Args:
        geometry: Geometry of the wheels.
        gyro_residual: Fraction of a turn rate disturbance that a gyro loop leaves.
    """

    def __init__(self, geometry: Kinematics, gyro_residual: float) -> None:
        self._rim_directions = geometry.matrix[:, :2].T  # (2, wheels)
        static, dynamic = compute_load_distribution(geometry, COM_HEIGHT_M)
        n_wheels = len(geometry.azimuths)
        self._static_load = n_wheels * static
        self._load_transfer = n_wheels / GRAVITY * dynamic[:, :2].T
        self._arm, self._lever = geometry.arm, gyro_residual / geometry.arm

    def compute_turn_rate(
        self, state: Array, velocity: Array, acceleration: Array, deficit: Array
    ) -> Array:
        """Return the turn rates (..., n) that act on robots like commands, rad/s.

        Args:
            state: States (..., n, 18), for lag, creep, and couplings.
            velocity: Body velocities (..., n, 3).
            acceleration: Body accelerations (..., n, 3).
            deficit: Commanded minus actual body velocities (..., n, 3).
        """
        # Sums instead of matrix products, which BLAS may round differently in a larger batch.
        rim_x, rim_y = self._rim_directions
        transfer_x, transfer_y = self._load_transfer
        transfer = acceleration[..., :1] * transfer_x + acceleration[..., 1:2] * transfer_y
        load = np.maximum(self._static_load + transfer, MIN_LOAD)
        rim_spin = self._arm * velocity[..., 2:]
        wheel_speed = np.hypot(
            velocity[..., :1] + rim_spin * rim_x, velocity[..., 1:2] + rim_spin * rim_y
        )
        lag, creep = state[..., LAG, None], state[..., CREEP, None]
        stiffness = 1 / (lag + creep * wheel_speed / load)
        traction = stiffness * (deficit[..., :1] * rim_x + deficit[..., 1:2] * rim_y)
        turn_rate: Array = self._lever * traction.sum(-1) / stiffness.sum(-1)
        return turn_rate - (state[..., COUPLING] * deficit[..., :2]).sum(-1)
