"""Motion model of a robot: how its velocity follows its commands.

For each body axis i (forward, sideways, turning), with the acting command u and the velocity v:

    tau_i v'_i + sum_j g_i S_ij g_j v'_j = u_i + b_i - f_i sgn(v)_i - g_i v_i

    g    inverse gain 1 / alpha (equation 8 of the paper): command per steady velocity
    tau  lag of the wheel loops, s
    S    lag by creep, s (`Creep`): rubber under traction slips in proportion to speed, and softens
    f    dry friction: command that it cancels, against the direction of motion sgn(v) = v / s
    b    disturbance: everything else that acts like a command (a collision, a slope, a biased gyro)

A velocity deficit u - v turns the robot in two ways. The wheels yield under traction, each to a
different degree (`YawCoupling`). A weak or sliding wheel and an eccentric center of mass act like
a commanded turn rate of -kappa (u - v), with the coupling kappa.

A command acts one dead time after it was sent. Of lag, creep coefficient and friction only the
forward values are states. The values of the other axes follow by ratios that depend on the
geometry.
"""

import numpy as np

from omni_control.controllers.base import TeamModel
from omni_control.kinematics import Array, Kinematics, body_to_world, world_to_body
from omni_control.traction_limits import GRAVITY, compute_load_distribution

# Layout of the state: pose, velocity and disturbance in the world frame, then parameters.
POSE, VELOCITY, DISTURBANCE = slice(0, 3), slice(3, 6), slice(6, 9)
HEADING, TURN_RATE = 2, 5
# kappa: a velocity deficit adds the turn rate -kappa (u - v); forward and sideways, rad/m.
COUPLING = slice(9, 11)
INVERSE_GAIN = slice(11, 14)
FORWARD_INVERSE_GAIN, SIDEWAYS_INVERSE_GAIN = 11, 12
DEAD_TIME = 14  # frames
CREEP, LAG, FRICTION = 15, 16, 17  # forward: s^2/m, s, m/s
STATE_SIZE = 18

# Typical wheels of the league, for robots with unknown geometry.
LEAGUE_WHEELS = Kinematics(np.radians([60.0, 135.0, 225.0, 300.0]), 0.08, 0.0285)
NORMALIZED_INERTIA = 0.7  # yaw inertia over mass times arm^2 (TIGERs Mannheim)
GYRO_RESIDUAL = 0.5  # fraction of a turn rate disturbance that a gyro loop of gain 1 leaves
UNKNOWN_ALPHA = 0.91, 0.91  # prior forward and sideways, if the team does not know alpha
YAW_ALPHA = 0.98  # prior in turning
# Forward values over those of the nominal model, which are means over all directions.
FORWARD_LAG_RATIO, FORWARD_FRICTION_RATIO = 0.75, 0.8
MIN_LAG_S = 5e-3  # vision of 60 Hz cannot distinguish shorter lags
SLOW_M_S = 0.05  # wheel speed below which dry friction is proportional to the speed
COM_HEIGHT_M = 0.047  # height of the center of mass; robots of TIGERs Mannheim: 45 and 49 mm
# Length of a wheel's contact along the rim over that along the axle, by Hertz's theory: the radius
# of the wheel over that of its rollers, about 4.8, to the power 2/3
CONTACT_RATIO = 2.8
MIN_LOAD = 0.1  # lowest load of a wheel, relative to the mean load
MIN_CONTACT_M_S = 1e-6  # lowest speed through a contact: wheels at rest do not creep
MAX_DRAG_SLIDING = 0.3  # largest part of a contact that slides in steady driving
SLIDING_ITERATIONS = 10  # for the part that slides in steady driving of the nominal robot
# Lowest stiffness of rubber over that in steady driving. A lower one, of wheels that are about to
# slide, would turn small deficits of acceleration into large commands, with which they slide.
MIN_STIFFNESS = 0.67
INVERSE_ITERATIONS = 3  # for the softening in `MotionModel.invert`


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
        self._wheels = wheels = model.geometry or LEAGUE_WHEELS
        rim_directions, self.arm = wheels.matrix[:, :2], wheels.arm
        # The traction of a wheel is proportional to the velocity deficit along its rim. With rim
        # directions d, the force on the body is therefore proportional to the mean of d_x^2 forward
        # and of d_y^2 sideways, and the moment to arm^2. A lag is the inertia over that stiffness.
        forward_stiffness, sideways_stiffness = (rim_directions**2).mean(0)
        sideways_ratio = forward_stiffness / sideways_stiffness
        # Turning: the inertia is NORMALIZED_INERTIA m arm^2, and the gyro loop reduces deviations.
        turning_ratio = GYRO_RESIDUAL * NORMALIZED_INERTIA * forward_stiffness
        self._lag_ratios = np.array([1.0, sideways_ratio, turning_ratio])
        creep_ratio = 0.0
        if model.creep_sideways_s2_m and model.creep_s2_m:
            creep_ratio = model.creep_sideways_s2_m / model.creep_s2_m
        prior_gain = 1 / np.array([*(model.alpha or UNKNOWN_ALPHA), YAW_ALPHA])
        self._softening = Softening(wheels, model, prior_gain)
        self._creep = Creep(wheels, creep_ratio)
        # The command that dry friction cancels is its force or moment over the stiffness. Friction
        # forces of the rims add up to the mean of |d_x| forward, and to the moment arm in turning.
        mean_forward_component = np.abs(rim_directions[:, 0]).mean()
        turning_friction_ratio = (
            GYRO_RESIDUAL / self.arm * forward_stiffness / mean_forward_component
        )
        self._friction_ratios = np.array([1.0, sideways_ratio, turning_friction_ratio])
        # Without known wheel angles, compliant wheels are assumed not to turn the robot.
        self._yaw_coupling = YawCoupling(wheels, GYRO_RESIDUAL if model.geometry else 0.0)

        self.prior = np.array(
            [
                *np.zeros(INVERSE_GAIN.start),
                *prior_gain,
                model.delay_frames,
                model.creep_s2_m,
                max(FORWARD_LAG_RATIO * model.lag_s, MIN_LAG_S),
                FORWARD_FRICTION_RATIO * model.friction_loss_m_s,
            ]
        )

    def compute_time_constants(self, state: Array, velocity: Array) -> Array:
        """Return the time constants of the velocity (..., n, 3), s, each axis by itself.

        Args:
            state: States (..., n, 18).
            velocity: Body velocities (..., n, 3) at which the wheels creep.
        """
        contact_speed = compute_contact_speeds(self._wheels, velocity)
        return self._compute_lags(state, contact_speed)[0] / state[..., INVERSE_GAIN]

    def _compute_lags(self, state: Array, contact_speed: Array) -> tuple[Array, Array]:
        """Return the lags of the axes (..., n, 3), and that between forward and sideways, s."""
        inverse_gain = state[..., INVERSE_GAIN]
        speeds, cross_speed = self._creep.compute_effective_speeds(contact_speed)
        creep = state[..., CREEP, None] * speeds
        # In turning, the speed applies to the creep g_0^2 c of forward motion.
        gains = inverse_gain.copy()
        gains[..., 2] *= inverse_gain[..., 0]
        lags = self._lag_ratios * state[..., LAG, None] + gains**2 * creep
        cross_lag = state[..., CREEP] * cross_speed * inverse_gain[..., 0] * inverse_gain[..., 1]
        return lags, cross_lag[..., None]

    def step(self, state: Array, command: Array, duration: Array | float) -> Array:
        """Return the states (..., n, 18) after commands have acted for a duration.

        Only pose and velocity change.

        Args:
            state: States (..., n, 18).
            command: Acting commands (..., n, 3), world frame: those sent one dead time earlier.
            duration: Time for which the commands act, one for all or (..., n), s.
        """
        duration = np.asarray(duration, float)[..., None]
        heading = state[..., HEADING] + state[..., TURN_RATE] * duration[..., 0] / 2
        inverse_gain = state[..., INVERSE_GAIN]
        velocity = world_to_body(state[..., VELOCITY], heading)
        drive = world_to_body(command + state[..., DISTURBANCE], heading)
        residual = drive - inverse_gain * velocity
        deficit = residual - self._compute_friction(state, velocity)
        contact_speed = compute_contact_speeds(self._wheels, velocity)
        contact_speed = self._softening.scale(contact_speed, state, velocity, deficit)
        lags, cross_lag = self._compute_lags(state, contact_speed)
        time_constant = lags / inverse_gain
        # The initial acceleration solves the equations of forward and sideways motion together.
        acceleration = residual / lags
        determinant = lags[..., :1] * lags[..., 1:2] - cross_lag**2
        acceleration[..., :2] = (
            lags[..., 1::-1] * residual[..., :2] - cross_lag * residual[..., 1::-1]
        ) / determinant
        drive[..., 2] += self._yaw_coupling.compute_turn_rate(
            state, contact_speed, acceleration, drive - velocity
        )
        drive[..., :2] -= cross_lag * acceleration[..., 1::-1]
        decay = np.exp(-duration / time_constant)
        # An exponential approach: v(t) = steady velocity + initial excess exp(-t / time constant).
        frictionless_velocity = velocity + (1 - decay) * (drive / inverse_gain - velocity)
        # Dry friction can stop a robot, but not reverse it.
        stopping = inverse_gain * np.abs(frictionless_velocity) / np.maximum(1 - decay, 1e-12)
        friction = np.clip(
            self._compute_friction(state, frictionless_velocity), -stopping, stopping
        )
        steady_velocity = (drive - friction) / inverse_gain
        initial_excess = velocity - steady_velocity
        displacement = duration * steady_velocity + initial_excess * (1 - decay) * time_constant
        result = state.copy()
        result[..., POSE] += body_to_world(displacement, heading)
        result[..., VELOCITY] = body_to_world(steady_velocity + initial_excess * decay, heading)
        return result

    def invert(self, state: Array, velocity: Array, next_velocity: Array, heading: Array) -> Array:
        """Return the commands (..., n, 3) that lead from one velocity to another in a frame.

        This inverts `step` with zero disturbance, except that friction is evaluated at the mean of
        both velocities.

        Args:
            state: States (..., n, 18); only their parameters are used.
            velocity: Velocities at the start of the frame, (..., n, 3), world frame.
            next_velocity: Velocities at the end of the frame, (..., n, 3), world frame.
            heading: Headings in the middle of the frame, (..., n) rad.
        """
        velocity = world_to_body(velocity, heading)
        next_velocity = world_to_body(next_velocity, heading)
        steady_command = state[..., INVERSE_GAIN] * velocity + self._compute_friction(
            state, velocity
        )
        mean_friction = self._compute_friction(state, (velocity + next_velocity) / 2)
        sticking_speed = contact_speed = compute_contact_speeds(self._wheels, velocity)
        # The softening depends on the command, so that the equation is solved repeatedly.
        for _ in range(INVERSE_ITERATIONS):
            lags, cross_lag = self._compute_lags(state, contact_speed)
            time_constant = lags / state[..., INVERSE_GAIN]
            decay = np.exp(-self._period / time_constant)
            steady_velocity = (next_velocity - decay * velocity) / (1 - decay)
            command = steady_velocity * state[..., INVERSE_GAIN] + mean_friction
            acceleration = (steady_velocity - velocity) / time_constant
            command[..., :2] += cross_lag * acceleration[..., 1::-1]
            deficit = command - steady_command
            contact_speed = self._softening.scale(sticking_speed, state, velocity, deficit)
        command[..., 2] -= self._yaw_coupling.compute_turn_rate(
            state, contact_speed, acceleration, command - velocity
        )
        return body_to_world(command, heading)

    def _compute_friction(self, state: Array, velocity: Array) -> Array:
        """Return the commands that dry friction cancels at body velocities, both (..., n, 3)."""
        speed = np.hypot(velocity[..., 0], velocity[..., 1])
        rim_speed = np.hypot(speed, self.arm * velocity[..., 2])
        friction = state[..., FRICTION, None] * (self._friction_ratios * velocity)
        friction[..., :2] /= np.maximum(speed, SLOW_M_S)[..., None]
        friction[..., 2] *= self.arm / np.maximum(rim_speed, SLOW_M_S)
        return friction


def compute_contact_speeds(geometry: Kinematics, velocity: Array) -> Array:
    """Return the speeds |V_i|_c (`Creep`) of all wheels (..., n, W), m/s.

    Args:
        geometry: Geometry of the wheels.
        velocity: Body velocities (..., n, 3).
    """
    # Sums instead of matrix products, which BLAS may round differently in a larger batch.
    rim_x, rim_y = geometry.matrix[:, :2].T
    axle_x, axle_y = geometry.axles[:, :2].T
    forward, sideways, turn = velocity[..., :1], velocity[..., 1:2], velocity[..., 2:]
    return np.hypot(
        forward * rim_x + sideways * rim_y + geometry.arm * turn,
        CONTACT_RATIO * (forward * axle_x + sideways * axle_y),
    )


class Creep:
    """Creep of wheels in any direction of travel (Pacejka, Tire and Vehicle Dynamics, brush model).

    Rubber slips in proportion to the traction of its wheel, and to the speed |V|_c at which it
    passes through the contact. The contact is an ellipse, which rubber leaves sooner along the
    axle, by the factor rho:

        |V_i|_c^2 = (V_i . d_i)^2 + rho^2 (V_i . a_i)^2,    V_i = v + w l d_i

    with the directions d_i of the rim and a_i of the axle, the arm l and the turn rate w. All
    wheels together have the stiffness sum N_i d_i d_i^T / |V_i|_c against slip of the body, with
    the loads N_i. The lag by creep is the inverse of this matrix, up to a factor. The creep
    coefficient contains this factor, so that the lag of a robot that drives forward is that
    coefficient times its speed.

    Args:
        geometry: Geometry of the wheels.
        sideways_ratio: Creep coefficient sideways over that forward; 0: of this law.
    """

    def __init__(self, geometry: Kinematics, sideways_ratio: float) -> None:
        self._rim_directions = geometry.matrix[:, :2].T  # (2, wheels)
        self._loads = len(geometry.azimuths) * compute_load_distribution(geometry, 0.0)[0]
        unit_speeds = compute_contact_speeds(geometry, np.eye(3)[:2])
        forward, sideways = np.diagonal(self._compute_compliance(unit_speeds)[0])
        self._scale = np.array([1.0, sideways_ratio or sideways / forward]) / [forward, sideways]

    def compute_effective_speeds(self, contact_speed: Array) -> tuple[Array, Array]:
        """Return the speeds by which the creep coefficient is multiplied, m/s.

        They are the inverse of the stiffness matrix, scaled. In forward motion the first is the
        speed of the robot, in sideways motion the second is that speed times the ratio.

        Args:
            contact_speed: Speeds |V_i|_c, (..., n, W) m/s.

        Returns:
            Speeds of the three axes, (..., n, 3), and that between forward and sideways, (..., n).
        """
        compliance, cross_compliance, turning = self._compute_compliance(contact_speed)
        forward_scale, sideways_scale = self._scale
        turning = GYRO_RESIDUAL * NORMALIZED_INERTIA * forward_scale * turning
        speeds = np.concatenate([self._scale * compliance, turning[..., None]], axis=-1)
        return speeds, np.sqrt(forward_scale * sideways_scale) * cross_compliance

    def _compute_compliance(self, contact_speed: Array) -> tuple[Array, Array, Array]:
        """Return the compliance forward and sideways (..., 2), between them, and in turning."""
        stiffness = self._loads / np.maximum(contact_speed, MIN_CONTACT_M_S)
        rim_x, rim_y = self._rim_directions
        forward = (stiffness * rim_x**2).sum(-1)
        sideways = (stiffness * rim_y**2).sum(-1)
        cross = (stiffness * (rim_x * rim_y)).sum(-1)
        determinant = forward * sideways - cross**2
        compliance = np.stack([sideways, forward], axis=-1) / determinant[..., None]
        return compliance, -cross / determinant, 1 / stiffness.sum(-1)


class Softening:
    """Softening of rubber under traction (`compute_softening`), relative to steady driving.

    A part x of a contact slides, and its traction is 1 - (1 - x)^3 of the friction limit. Drag
    alone lets x_D slide, since rims slip by (g - 1) v in steady driving. A command adds a deficit,
    and changes x by the traction of sticking rubber over three times the friction limit. The
    stiffness of the secant, the mean of (1 - |x|)^2 between both, takes the place of that of the
    tangent, (1 - x_D)^2, which the creep coefficient contains.

    Args:
        geometry: Geometry of the wheels.
        model: Nominal model. With friction 0, rubber does not soften.
        inverse_gain: Nominal inverse gains g, (3,).
    """

    def __init__(self, geometry: Kinematics, model: TeamModel, inverse_gain: Array) -> None:
        self._rim_directions = geometry.matrix[:, :2].T  # (2, wheels)
        rims = np.abs(self._rim_directions[0])
        speeds = compute_contact_speeds(geometry, np.array([1.0, 0.0, 0.0]))
        loads = compute_load_distribution(geometry, 0.0)[0]
        stiffness, forward_stiffness = loads * rims**2 / speeds, (loads * rims**2).sum()
        self._contact_scale = stiffness.sum() / forward_stiffness
        max_traction = 3 * (model.friction or np.inf) * GRAVITY * forward_stiffness
        creep_lags = max(model.creep_s2_m, MIN_CONTACT_M_S) * self._contact_scale * speeds
        drag_sliding = (inverse_gain[0] - 1) * rims / (inverse_gain[0] ** 2 * creep_lags)
        # The part that slides depends on the creep of sticking rubber, and this on that part.
        sticking_ratio = 1.0
        for _ in range(SLIDING_ITERATIONS):
            sliding = np.minimum(
                abs(drag_sliding) / (max_traction * sticking_ratio), MAX_DRAG_SLIDING
            )
            sticking_ratio = np.average((1 - sliding) ** 2, weights=stiffness)
        # The creep coefficient c of a model is that of steady driving. Sticking rubber of a robot
        # with the gain g has the coefficient g^2 c times that ratio.
        self._max_traction = max_traction * sticking_ratio * inverse_gain[0] ** 2

    def scale(self, contact_speed: Array, state: Array, velocity: Array, deficit: Array) -> Array:
        """Return the speeds |V_i|_c over the stiffness of the rubber, (..., n, W) m/s.

        The stiffness is relative to that in steady driving.

        Args:
            contact_speed: Speeds |V_i|_c (`Creep`), (..., n, W) m/s.
            state: States (..., n, 18); inverse gain, creep and lag are used.
            velocity: Body velocities (..., n, 3).
            deficit: Commands in excess of those of steady driving, (..., n, 3).
        """
        creep_lag = np.maximum(
            state[..., CREEP, None] * (self._contact_scale * contact_speed), MIN_CONTACT_M_S
        )
        slip = self._project_on_rims((state[..., INVERSE_GAIN] - 1) * velocity)
        drag_sliding = slip / (self._max_traction * creep_lag)
        drag_sliding = np.maximum(np.minimum(drag_sliding, MAX_DRAG_SLIDING), -MAX_DRAG_SLIDING)
        creep_lag += state[..., LAG, None]
        half_change = self._project_on_rims(deficit) / (2 * self._max_traction * creep_lag)
        sticking = 1 - np.minimum(abs(drag_sliding + half_change), 1.0)
        # The mean of (1 - |x|)^2 from x_D to x, exact if both have the same sign
        secant = sticking**2 + half_change**2 / 3
        tangent = (1 - abs(drag_sliding)) ** 2
        return contact_speed / np.maximum(secant / tangent, MIN_STIFFNESS)

    def _project_on_rims(self, velocity: Array) -> Array:
        """Return the components along the rims, (..., n, W), of body velocities (..., n, 3)."""
        # Sums instead of matrix products, which BLAS may round differently in a larger batch.
        rim_x, rim_y = self._rim_directions
        return velocity[..., :1] * rim_x + velocity[..., 1:2] * rim_y


class YawCoupling:
    """Turn rate that driving causes: compliant wheels, and the coupling states.

    Wheel i yields along its rim by its traction over its stiffness K_i. Two effects add up: the lag
    of its speed loop, and creep, which is inversely proportional to the load. Except for a common
    factor that cancels,

        1 / K_i = tau + c |V_i|_c / N_i

    with the forward lag tau and creep coefficient c, the speed |V_i|_c through the contact
    (`Creep`), and the load N_i over the mean load. The coefficient c is that of the whole robot, so
    |V_i|_c is relative to its mean in forward motion. With directions d_i and arm l, a velocity
    deficit e and a turn rate deficit e_w cause the moment l sum K_i (d_i . e + l e_w). So e turns
    the robot like a commanded turn rate of

        r sum K_i (d_i . e) / (l sum K_i)

    where r is the fraction that a gyro loop leaves. The sum is not zero, for three reasons: the rim
    directions need not add up to zero; wheels that turning makes faster yield more; and
    acceleration unloads the wheels on the side towards which it points.

    Args:
        geometry: Geometry of the wheels.
        gyro_residual: Fraction of a turn rate disturbance that a gyro loop leaves.
    """

    def __init__(self, geometry: Kinematics, gyro_residual: float) -> None:
        self._rim_directions = geometry.matrix[:, :2].T  # (2, wheels)
        forward_speed = compute_contact_speeds(geometry, np.array([1.0, 0.0, 0.0]))
        squares = self._rim_directions[0] ** 2
        self._contact_scale = (squares / forward_speed).sum() / squares.sum()
        static, dynamic = compute_load_distribution(geometry, COM_HEIGHT_M)
        n_wheels = len(geometry.azimuths)
        self._static_load = n_wheels * static
        self._load_transfer = n_wheels / GRAVITY * dynamic[:, :2].T
        self._turn_rate_per_rim_speed = gyro_residual / geometry.arm

    def compute_turn_rate(
        self, state: Array, contact_speed: Array, acceleration: Array, deficit: Array
    ) -> Array:
        """Return the turn rates (..., n) that driving adds to the commanded ones, rad/s.

        Args:
            state: States (..., n, 18); lag, creep and coupling are used.
            contact_speed: Speeds |V_i|_c (`Creep`), (..., n, W) m/s.
            acceleration: Body accelerations (..., n, 3).
            deficit: Commanded minus actual body velocities (..., n, 3).
        """
        # Sums instead of matrix products, which BLAS may round differently in a larger batch.
        rim_x, rim_y = self._rim_directions
        transfer_x, transfer_y = self._load_transfer
        transfer = acceleration[..., :1] * transfer_x + acceleration[..., 1:2] * transfer_y
        load = np.maximum(self._static_load + transfer, MIN_LOAD)
        relative_speed = self._contact_scale * contact_speed
        lag, creep = state[..., LAG, None], state[..., CREEP, None]
        stiffness = 1 / (lag + creep * relative_speed / load)
        traction = stiffness * (deficit[..., :1] * rim_x + deficit[..., 1:2] * rim_y)
        turn_rate = self._turn_rate_per_rim_speed * traction.sum(-1) / stiffness.sum(-1)
        return turn_rate - (state[..., COUPLING] * deficit[..., :2]).sum(-1)
