"""Adaptive comp-FLC: the paper's controller on a robot whose response is identified while it is driven.

**Lead.** A robot that creeps answers to a command u with a lag, (lag) v' + g v = u, and under a correction F(e)
of its error alone would swing. So the fuzzy controller F is asked for x = e + T e', the error a lead time later:

    T = 2 lag / (g + s),   s = sqrt(g^2 + 2 k lag),   k the slope of F at no error

- Where F has that slope, errors decay with a damping ratio of 1/sqrt(2) or more; where it has
  others, of at least sqrt(2 g / (g + s)).
- Whatever F is, if it has the sign of x: T <= lag / g, so that m = 1 - g T / lag >= 0. V = int F dx
  + m lag e'^2 / 2 changes at the rate -F^2 T / lag - m g e'^2, so that errors of any size end.
- Where F saturates nothing is damped: a robot that is far off comes back at the speed F / g that F
  asks for.
"""

from typing import ClassVar

import numpy as np

from omni_control.controllers.base import Controller, Observation, TeamModel
from omni_control.estimation import motion_model
from omni_control.estimation.delayed_measurements import MAX_FRAMES_BEHIND
from omni_control.estimation.motion_model import DISTURBANCE, INVERSE_GAIN, POSE, VELOCITY
from omni_control.estimation.robot_ekf import RobotEkf
from omni_control.fuzzy import FuzzyLaw
from omni_control.kinematics import Array, body_to_world, world_to_body, wrap_angle
from omni_control.reference import IteratedReference, Reference

HORIZON_FRAMES = 10  # with 20 nothing changes, on `league`, `random-waypoints` and `slippery`


class InverseFlc(Controller):
    """inverse-flc: the inverse of the nominal model of a robot, prediction by it, and the fuzzy controller.

    Pose and velocity are predicted to when the command will act (`RobotEkf`). The command is the
    inverse of the model for the reference of that time, and the fuzzy controller's correction of
    the error that is left. It knows what `adaptive-comp-flc` knows of a robot, and learns nothing.
    """

    learns: ClassVar[bool] = False

    def __init__(self, model: TeamModel, reference: Reference, n: int) -> None:
        super().__init__(model, reference, n)
        noise = (0.0, 0.0, 0.0) if self.knows_truth else model.vision_noise
        self.filter = RobotEkf(model, n, noise, self.learns)
        self.fuzzy = FuzzyLaw(model.error_range_m, model.speed_range_m_s)
        self.memory_frames = self.filter.memory_frames + MAX_FRAMES_BEHIND
        self._twist_before = np.zeros((n, 3))  # of a reference planned anew, in the frame before

    def command(self, frame: int, observation: Observation) -> Array:
        """See `Controller`."""
        self.filter.update(observation)
        state = self.filter.predict(observation)
        self.predicted_pose = state[:, POSE].copy()
        self._record()
        return self.track(frame, observation, state)

    def track(self, frame: int, observation: Observation, state: Array) -> Array:
        """Return the commands (n, 3) for robots whose states will be (n, 18) when these act."""
        period, ekf = self.model.period, self.filter
        poses, twists = self.around(frame + ekf.latency, HORIZON_FRAMES)
        velocities, headings = self.expected(poses, twists, state)
        planned = ekf.dynamics.invert(ekf.state, velocities[:-1], velocities[1:], headings)
        error = poses[1] - state[:, POSE]
        leading = error[:, :2] + self._lead(
            velocities[0], velocities[0] - state[:, VELOCITY], headings[0]
        )
        correction = self.fuzzy(leading)
        size, speed = (np.hypot(*vector.T) for vector in (leading, correction))
        fading = np.exp(-period * speed / np.maximum(size, 1e-12))[:, None]
        coming = planned[..., :2] + fading ** np.arange(HORIZON_FRAMES)[:, None, None] * correction
        command = np.empty_like(error)
        command[:, :2] = anticipate(coming, self.model.limits.acceleration * period)
        command[:, 2] = planned[0, :, 2] + self.model.heading_gain * wrap_angle(error[:, 2])
        return command - ekf.state[:, DISTURBANCE]

    def around(self, frame: Array, count: int) -> tuple[Array, Array]:
        """Return the reference's poses and twists (2 + count, n, 3) from the frame before `frame` (n,) on.

        One that is planned anew in every frame has no frame before but its last answer, and must be
        asked to go on.
        """
        if not isinstance(self.reference, IteratedReference):
            return self.reference.preview(frame - 1, self.predicted_pose, 2 + count)
        poses, twists = self.reference.preview(frame, self.predicted_pose, 1 + count)
        before = self._twist_before[None]
        _, self._twist_before = self.reference.at(frame, self.predicted_pose)
        return np.concatenate([poses[:1], poses]), np.concatenate([before, twists])

    def expected(self, poses: Array, twists: Array, state: Array) -> tuple[Array, Array]:
        """Return the reference's velocities where frames meet, and the headings that robots will have in them.

        Args:
            poses: of the reference, from the frame before the one in which the command acts,
                (frames, n, 3).
            twists: same.
            state: of robots when it begins to act, (n, 18).

        Returns:
            Velocities (frames - 1, n, 3), and headings of all frames but the first and last,
            (frames - 2, n).
        """
        middles = poses[1:-1, :, 2] + twists[1:-1, :, 2] * (self.model.period / 2)
        return (twists[:-1] + twists[1:]) / 2, middles + (state[:, 2] - poses[1, :, 2])

    def _lead(self, velocity: Array, behind: Array, heading: Array) -> Array:
        """Return what is added to errors (n, 2) of robots whose velocity is `behind` (n, 3), m, world frame."""
        ekf = self.filter
        speed = np.hypot(velocity[:, 0], velocity[:, 1])
        late = ekf.dynamics.compute_time_constants(ekf.state, speed[:, None])
        times = (
            2
            * late
            / (1 + np.sqrt(1 + 2 * self.fuzzy.stiffness * late / ekf.state[:, INVERSE_GAIN]))
        )
        lead: Array = body_to_world(times * world_to_body(behind, heading), heading)
        return lead[:, :2]

    def _record(self) -> None:
        """Say what was found, and how sure it is."""
        ekf = self.filter
        state, sigma = (
            ekf.state,
            np.sqrt(np.maximum(np.diagonal(ekf.covariance, axis1=1, axis2=2), 0)),
        )
        lag = (
            ekf.dynamics.compute_time_constants(state, np.zeros((len(state), 1)))
            * state[:, INVERSE_GAIN]
        )
        self.alpha_hat = 1 / state[:, INVERSE_GAIN]
        self.latency_hat = ekf.latency[:, None] + lag / self.model.period
        self.channels = {
            "alpha_sigma": self.alpha_hat**2 * sigma[:, INVERSE_GAIN],
            "lag": lag,
            "velocity_disturbance": state[:, DISTURBANCE],
            "nis": ekf.mean_nis,
        }
        for name in ("latency", "creep", "friction"):
            column = getattr(motion_model, name.upper())
            self.channels |= {name: state[:, column], f"{name}_sigma": sigma[:, column]}


class AdaptiveCompFlc(InverseFlc):
    """adaptive-comp-flc: comp-FLC that identifies latency, alpha, slip and friction online.

    It is `inverse-flc` whose model is the one that is found while it drives, with what disturbs the
    robot.
    """

    learns = True


class Oracle(AdaptiveCompFlc):
    """oracle: no competitor: adaptive-comp-flc that knows the true state in every frame.

    What it loses to a perfect robot is the price of the dead time alone: of what has changed since,
    and of what it could not know before it had moved. From true poses it identifies what it is not
    told of the robot.
    """

    knows_truth = True


def anticipate(commands: Array, max_step: float) -> Array:
    """Return the command that minimizes the largest future deviation under a slew-rate limit.

    A command k frames ahead is reachable if it differs from the current command by at most k *
    max_step. The excess is the deviation. The result is the midpoint between the tightest lower and
    upper bound over the horizon, along the direction of the largest deviation and across it.

    Args:
        commands: desired velocities, current frame first, (frames, n, 2), m/s.
        max_step: largest change per frame, m/s.

    Returns:
        Velocities to command now, (n, 2), m/s.
    """
    changes, reach = commands - commands[0], max_step * np.arange(len(commands))[:, None]
    sizes = np.hypot(changes[..., 0], changes[..., 1])
    worst = (sizes - reach).argmax(0), np.arange(commands.shape[1])
    size = sizes[worst]
    along = np.where(
        size[:, None] > 0, changes[worst] / np.maximum(size, 1e-300)[:, None], [1.0, 0.0]
    )
    across = np.stack([-along[:, 1], along[:, 0]], axis=1)
    result: Array = commands[0].copy()
    for direction in (along, across):
        part = (changes * direction).sum(-1)
        result += ((part + reach).min(0) + (part - reach).max(0))[:, None] / 2 * direction
    return result
