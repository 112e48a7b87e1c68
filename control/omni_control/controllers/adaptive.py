"""Adaptive comp-FLC: the paper's controller on a robot whose response is identified while it is driven."""

import math

import numpy as np

from omni_control.controllers.base import Seen, Told
from omni_control.controllers.flc import Flc
from omni_control.delay import CommandsInFlight
from omni_control.estimation import motion
from omni_control.estimation.identify import Identifier
from omni_control.estimation.motion import Plane, pairs, plane
from omni_control.estimation.turning import Turning
from omni_control.kinematics import Array, wrap_angle
from omni_control.limits import within_rate
from omni_control.reference import IteratedReference, Reference

LOOK_FRAMES = 10  # ahead and back, over which a command that changes too fast is spread
RATE_SHARE = 0.75  # of what commands may change by, that the reference may ask for; the rest is the feedback's
STIFFNESS = 12.0  # 1/s: of the fuzzy controller near zero error, for which the damping is made


class AdaptiveCompFlc(Flc):
    """adaptive-comp-flc: comp-FLC that identifies latency, alpha, slip, dry friction and compass error online.

    Pose and velocity are predicted to when the command will act, by the law of `estimation.motion`. What is sent is the
    inverse of that law for the reference of that time; the fuzzy controller's correction of the position that is left,
    and the damping that goes with it: a robot that creeps answers to a command u with a lag, (lag) v' + g v = u, and
    under a correction of stiffness k alone would swing. With the gain

        k_v = -g + sqrt(g^2 + 2 k lag)

    on the difference of velocities, errors decay with a damping ratio of at least 1/sqrt(2), the most at no lag.

    A reference whose acceleration jumps asks for a command that jumps, by lag times that. Commands cannot, so that
    the jump is spread over the frames before and after it (`limits.within_rate`).
    """

    def __init__(self, told: Told, reference: Reference, n: int) -> None:
        super().__init__(told, reference, n)
        self.noise = told.vision_noise
        self.plant = self._identifier(np.zeros((n, 3)))
        self.turning = self._turning(np.zeros((n, 3)))
        self.memory_frames = self.plant.longest
        self._started, self._answered = False, np.zeros((n, 3))

    def command(self, frame: int, seen: Seen) -> Array:
        """See `Controller`."""
        if not self._started:
            self._started, self.plant, self.turning = True, self._identifier(seen.pose), self._turning(seen.pose)
        plant, turning = self.plant, self.turning
        before = turning.heading
        felt = seen.sent.felt(plant.latency[:, None])
        turning.update(seen.measured[:, 2], felt[:, 2])
        plant.update(plane(seen.measured[:, :2]), (before + turning.heading) / 2, seen.sent)
        position, velocity, heading = self._predict(seen.sent)
        self.predicted = np.concatenate([pairs(position), heading[:, None]], axis=1)
        self._record()
        return self._wanted(frame, position, velocity, heading)

    def _predict(self, sent: CommandsInFlight) -> tuple[Plane, Plane, Array]:
        """Positions, velocities and headings (n,) when the command that is being computed begins to act."""
        plant, turning = self.plant, self.turning
        position, velocity, heading, rate = plant.position, plant.velocity, turning.heading, turning.rate
        count = math.ceil(plant.latency.max())
        left = sent.ahead(plant.latency[:, None])[-count:, :, 0] if count else np.empty((0, len(heading)))
        commands = sent.last(count)
        durations, across, turns = left * self.told.period, plane(commands[..., :2]), commands[..., 2]
        for duration, command, turn in zip(durations, across, turns, strict=True):
            acts = duration > 0  # not on robots that answer sooner than others: not even rounding may touch them
            later, faster = turning.step(heading, rate, turn, duration)
            middle = np.exp(0.5j * (heading + later))
            moved, gained = plant.step(position, velocity, command, middle, duration[:, None])
            heading, rate = np.where(acts, later, heading), np.where(acts, faster, rate)
            position, velocity = np.where(acts, moved, position), np.where(acts, gained, velocity)
        return position, velocity, heading

    def _wanted(self, frame: int, position: Plane, velocity: Plane, heading: Array) -> Array:
        """Commands (n, 3) that bring robots, predicted to be and go so, to the reference of that time."""
        period, law, now = self.told.period, self.plant.motion, LOOK_FRAMES + 1
        poses, twists = self._around(frame + self.plant.latency, now)
        speeds = plane(twists[..., :2])
        edges, rates = (speeds[:-1] + speeds[1:]) / 2, twists[now - 1 : now + 2, :, 2]
        middles = poses[1:-1, :, 2] + twists[1:-1, :, 2] * period / 2
        facing = np.exp(1j * (middles + (heading - poses[now, :, 2])))  # as the robot will, not as it should
        asked = pairs(law.ask(edges[:-1], edges[1:], facing, period))
        planned = plane(within_rate(asked, RATE_SHARE * self.told.limits.acceleration * period))

        effort, lag = law.effort, law.lag(np.abs(edges[now - 1]))
        damping = np.sqrt(effort**2 + 2 * STIFFNESS * lag) - effort
        late = pairs((edges[now - 1] - velocity) * facing[now - 1].conj())
        error = plane(poses[now, :, :2]) - position
        corrected = plane(self.fuzzy(pairs(error))) + plane(damping * late) * facing[now - 1]
        across = pairs(self.plant.ask(planned + corrected))
        turn = self.turning.ask(*(rates[:-1] + rates[1:]) / 2) + self.told.heading_gain * wrap_angle(
            poses[now, :, 2] - heading
        )
        return np.concatenate([across, turn[:, None]], axis=1)

    def _around(self, frame: Array, reach: int) -> tuple[Array, Array]:
        """The reference's poses and twists (2 reach + 1, n, 3) in `reach` frames before `frame` (n,), in it and after.

        One that is planned anew in every frame has no before but what it answered last, and goes on by being asked.
        """
        if not isinstance(self.reference, IteratedReference):
            return self.reference.preview(frame - reach, self.predicted, 2 * reach + 1)
        poses, twists = self.reference.preview(frame, self.predicted, reach + 1)
        before = np.repeat(self._answered[None], reach, axis=0)
        _, self._answered = self.reference.at(frame, self.predicted)
        return np.concatenate([np.repeat(poses[:1], reach, axis=0), poses]), np.concatenate([before, twists])

    def _record(self) -> None:
        """Say what was found, and how sure it is."""
        plant, turning = self.plant, self.turning
        found, sigma = plant.motion.parameters, plant.sigma
        lag = np.column_stack([plant.motion.lags, turning.lag])
        self.alpha_hat = 1 / np.column_stack([plant.motion.effort, turning.effort])
        self.latency_hat = plant.latency[:, None] + lag / self.told.period
        self.channels = {
            "alpha_sigma": self.alpha_hat**2 * np.column_stack([sigma[:, motion.EFFORT], turning.sigma[:, 4]]),
            "latency_sigma": sigma[:, motion.LATENCY],
            "lag": lag,
            "creep": found[:, motion.CREEP],
            "creep_sigma": sigma[:, motion.CREEP],
            "friction": found[:, motion.FRICTION],
            "friction_sigma": sigma[:, motion.FRICTION],
            "compass": found[:, motion.COMPASS],
            "compass_sigma": sigma[:, motion.COMPASS],
            "sliding": plant.sliding,
            "surprise": plant.surprise,
        }

    def _identifier(self, pose: Array) -> Identifier:
        told = self.told
        return Identifier(
            plane(pose[:, :2]),
            told.period,
            told.delay_frames,
            self.noise[0],
            told.lag_s,
            told.creep_s2_m,
            told.drag_m_s,
            told.geometry,
        )

    def _turning(self, pose: Array) -> Turning:
        return Turning(pose[:, 2], self.told.period, self.noise[2], self.told.lag_s)
