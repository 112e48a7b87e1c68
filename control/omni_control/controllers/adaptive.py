"""Adaptive comp-FLC: the paper's controller on a robot model that is identified while driving.

**Lead time.** A robot whose wheels creep responds to a command u with a lag, (lag) v' + g v = u.
Under a correction F(e) of the error alone it would oscillate. The input of the fuzzy controller F
is therefore x = e + T e', the error extrapolated by a lead time:

    T = 2 lag / (g + s),   s = sqrt(g^2 + 2 k lag),   k the slope of F at zero error

- Where F has the slope k, errors decay with a damping ratio of at least 1/sqrt(2). Where it has
  another slope, the damping ratio is at least sqrt(2 g / (g + s)).
- Errors of any size vanish, whatever F is, if it has the sign of x. Since T <= lag / g,
  m = 1 - g T / lag >= 0, and V = int F dx + m lag e'^2 / 2 changes at the rate
  -F^2 T / lag - m g e'^2.
- Where F saturates, there is no damping: a robot far from its reference returns at the speed F / g.
"""

import numpy as np

from omni_control.controllers.base import Controller, Observation, TeamModel
from omni_control.estimation.delayed_measurements import MAX_FRAMES_BEHIND
from omni_control.estimation.motion_model import (
    CREEP,
    DEAD_TIME,
    DISTURBANCE,
    FRICTION,
    INVERSE_GAIN,
    POSE,
    VELOCITY,
)
from omni_control.estimation.robot_ekf import RobotEkf
from omni_control.fuzzy_rules import FuzzyLaw
from omni_control.kinematics import Array, body_to_world, world_to_body, wrap_angle
from omni_control.reference import Reference, ReplannedReference

# Number of planned commands. 20 give the same results in scenarios league, waypoints, slippery.
HORIZON_FRAMES = 10
MAX_UNHEARD_LEAD_M_S = 1.0  # of commands to a robot that does not respond, over its velocity


class InverseFlc(Controller):
    """inverse-flc: inverse and prediction of the nominal robot model, with the fuzzy controller.

    `RobotEkf` predicts pose and velocity for the time when the command will act. The command is the
    inverse of the model for the reference at that time, plus the fuzzy controller's correction of
    the remaining error. The model has the initial parameters of `adaptive-comp-flc`.

    Attributes:
        learns: What is estimated besides pose and velocity: "nothing", "disturbance", or "all",
            which is `adaptive-comp-flc`.
    """

    learns: str = "nothing"

    def __init__(self, model: TeamModel, reference: Reference, n: int) -> None:
        super().__init__(model, reference, n)
        noise = (0.0, 0.0, 0.0) if self.knows_truth else model.vision_noise
        self.filter = RobotEkf(model, n, noise, self.learns)
        self.fuzzy = FuzzyLaw(model.error_range_m, model.speed_range_m_s)
        self.memory_frames = self.filter.memory_frames + MAX_FRAMES_BEHIND
        self._last_twist = np.zeros((n, 3))  # of a replanned reference, in the previous frame

    def command(self, frame: int, observation: Observation) -> Array:
        """See `Controller`."""
        self.filter.update(observation)
        state = self.filter.predict(observation)
        self.predicted_pose = state[:, POSE].copy()
        self._record_estimates()
        return self._restrain(self.track(frame, observation, state))

    def track(self, frame: int, observation: Observation, state: Array) -> Array:
        """Return the commands (n, 3): inverse of the model, fuzzy correction, heading control.

        Args:
            frame: Frame number k.
            observation: State of the robots in frame k.
            state: Predicted states (n, 18) at the time when the commands will act.
        """
        period, ekf = self.model.period, self.filter
        poses, velocities, headings, planned = self.plan_commands(frame, HORIZON_FRAMES, state)
        error = poses[1] - state[:, POSE]
        velocity_error = velocities[0] - state[:, VELOCITY]
        extrapolated_error = error[:, :2] + self._compute_lead(
            velocities[0], velocity_error, headings[0]
        )
        correction = self.fuzzy(extrapolated_error)
        distance, speed = (np.hypot(*vector.T) for vector in (extrapolated_error, correction))
        # The correction decays at the rate at which it reduces the error: speed / distance.
        decay = np.exp(-period * speed / np.maximum(distance, 1e-12))[:, None]
        decays = decay ** np.arange(HORIZON_FRAMES)[:, None, None]
        desired = planned[..., :2] + decays * correction
        command = np.empty_like(error)
        command[:, :2] = anticipate(desired, self.model.limits.acceleration * period)
        command[:, 2] = planned[0, :, 2] + self.model.heading_gain * wrap_angle(error[:, 2])
        return command - ekf.state[:, DISTURBANCE]

    def _restrain(self, command: Array) -> Array:
        """Limit the lead of translation commands (n, 3) over robots that do not respond.

        When a robot receives commands again, its wheels then do not slide and turn it.
        """
        velocity = self.filter.state[:, VELOCITY]
        lead = (command - velocity)[:, :2]
        speed = np.maximum(np.hypot(lead[:, 0], lead[:, 1]), MAX_UNHEARD_LEAD_M_S)
        restrained = velocity[:, :2] + lead * (MAX_UNHEARD_LEAD_M_S / speed)[:, None]
        is_responsive = self.filter.is_responsive[:, None]
        return np.hstack([np.where(is_responsive, command[:, :2], restrained), command[:, 2:]])

    def plan_commands(
        self, frame: int, count: int, state: Array
    ) -> tuple[Array, Array, Array, Array]:
        """Return the reference, and the commands with which the model follows it.

        Args:
            frame: Frame number k.
            count: Number of commands.
            state: Predicted states (n, 18) at the time when the first command will act.

        Returns:
            Poses of the reference (count + 2, n, 3), from the frame before the commands act;
            its velocities at the boundaries of their frames, (count + 1, n, 3); headings of the
            robots expected in the middle of each, (count, n); and the commands, (count, n, 3).
        """
        ekf = self.filter
        poses, twists = self._preview_reference(frame + ekf.dead_time, count)
        velocities = (twists[:-1] + twists[1:]) / 2
        mid_headings = poses[1:-1, :, 2] + twists[1:-1, :, 2] * (self.model.period / 2)
        headings = mid_headings + (state[:, 2] - poses[1, :, 2])
        planned = ekf.dynamics.invert(ekf.state, velocities[:-1], velocities[1:], headings)
        return poses, velocities, headings, planned

    def _preview_reference(self, frame: Array, count: int) -> tuple[Array, Array]:
        """Return poses and twists (2 + count, n, 3) of the reference from `frame` - 1 on.

        A reference that is planned anew in every frame has no pose for `frame` - 1, so that the
        pose of `frame` is repeated. Its twist for `frame` - 1 is that of the previous
        call. It advances by a call of `at`.

        Args:
            frame: Frame at which the commands will act, (n,).
            count: Number of frames after the first two.
        """
        if not isinstance(self.reference, ReplannedReference):
            return self.reference.preview(frame - 1, self.predicted_pose, 2 + count)
        last_twist = self._last_twist[None]
        # In this order, `frame` is planned only once: the preview begins with the plan of `at`.
        _, self._last_twist = self.reference.at(frame, self.predicted_pose)
        poses, twists = self.reference.preview(frame, self.predicted_pose, 1 + count)
        return np.concatenate([poses[:1], poses]), np.concatenate([last_twist, twists])

    def _compute_lead(self, velocity: Array, velocity_error: Array, heading: Array) -> Array:
        """Return the lead T e' of the position error (n, 2), m, world frame.

        Args:
            velocity: Velocity of the reference, (n, 3).
            velocity_error: Reference minus robot, e', (n, 3).
            heading: Headings of the robots, (n,).
        """
        ekf = self.filter
        body_velocity = world_to_body(velocity, heading)
        # tau = lag / g;  T = 2 tau / (1 + sqrt(1 + 2 k tau / g))
        tau = ekf.dynamics.compute_time_constants(ekf.state, body_velocity)
        gain = self.fuzzy.gain_at_zero
        lead_time = 2 * tau / (1 + np.sqrt(1 + 2 * gain * tau / ekf.state[:, INVERSE_GAIN]))
        body_error = world_to_body(velocity_error, heading)
        return body_to_world(lead_time * body_error, heading)[:, :2]

    def _record_estimates(self) -> None:
        """Record the estimated parameters and their standard deviations."""
        ekf = self.filter
        state = ekf.state
        sigma = np.sqrt(np.maximum(np.diagonal(ekf.covariance, axis1=1, axis2=2), 0))
        time_constants = ekf.dynamics.compute_time_constants(state, np.zeros((len(state), 3)))
        lag = time_constants * state[:, INVERSE_GAIN]
        self.alpha_hat = 1 / state[:, INVERSE_GAIN]
        self.latency_hat = ekf.dead_time[:, None] + lag / self.model.period
        self.channels = {
            "alpha_sigma": self.alpha_hat**2 * sigma[:, INVERSE_GAIN],
            "lag": lag,
            "velocity_disturbance": state[:, DISTURBANCE],
            "nis": ekf.mean_nis,
        }
        for name, column in (("dead_time", DEAD_TIME), ("creep", CREEP), ("friction", FRICTION)):
            self.channels |= {name: state[:, column], f"{name}_sigma": sigma[:, column]}


class AdaptiveCompFlc(InverseFlc):
    """adaptive-comp-flc: comp-FLC that identifies latency, alpha, slip and friction online.

    It is `inverse-flc` with model parameters and a disturbance that are estimated while driving.
    """

    learns = "all"


class Oracle(AdaptiveCompFlc):
    """oracle: adaptive-comp-flc that knows the true state in every frame; not a competitor.

    It identifies unknown parameters from true poses. Its error has two causes: disturbances during
    the dead time, and parameters that can be identified only after the first motion.
    """

    knows_truth = True


def anticipate(commands: Array, max_step: float) -> Array:
    """Return the command that minimizes the largest future deviation under a slew-rate limit.

    A command k frames ahead is reachable if it differs from the current command by at most k *
    max_step. The excess is the deviation. The result is the midpoint between the tightest lower
    and upper limits over the horizon, along the direction of the largest deviation and normal to
    it.

    Args:
        commands: Desired velocities, current frame first, (frames, n, 2), m/s.
        max_step: Largest change per frame, m/s.

    Returns:
        Velocities to command now, (n, 2), m/s.
    """
    changes = commands - commands[0]
    reachable = max_step * np.arange(len(commands))[:, None]
    distances = np.hypot(changes[..., 0], changes[..., 1])
    farthest = (distances - reachable).argmax(0), np.arange(commands.shape[1])
    distance = distances[farthest][:, None]
    direction = np.where(distance > 0, changes[farthest] / np.maximum(distance, 1e-300), [1.0, 0.0])
    normal = np.stack([-direction[:, 1], direction[:, 0]], axis=1)
    result = commands[0].copy()
    for axis in (direction, normal):
        component = (changes * axis).sum(-1)
        upper, lower = (component + reachable).min(0), (component - reachable).max(0)
        result += (upper + lower)[:, None] / 2 * axis
    return result
