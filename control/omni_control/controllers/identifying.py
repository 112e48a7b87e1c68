"""What controllers share that identify their robots while they drive them: what is found, said, and comes next."""

import math
from typing import NamedTuple

import numpy as np

from omni_control.controllers.base import Controller, Seen, Told
from omni_control.delay import CommandsInFlight
from omni_control.estimation import motion
from omni_control.estimation.compliance import Compliance
from omni_control.estimation.identify import LATENCY, Identifier
from omni_control.estimation.late import MOST_FRAMES, Late
from omni_control.estimation.motion import Plane, pairs, plane
from omni_control.estimation.turning import GYRO_SHARE, Turning
from omni_control.kinematics import Array, wrap_angle
from omni_control.reference import IteratedReference, Reference


class Arrival(NamedTuple):
    """How n robots are predicted to be when the command that is being computed begins to act.

    Attributes:
        position, velocity: (n,) m and m/s, world frame.
        heading: (n,) rad; counts full turns.
    """

    position: Plane
    velocity: Plane
    heading: Array


class Identifying(Controller):
    """A controller that identifies latency, alpha, slip, dry friction and compass error online; write `wanted`.

    Pose and velocity are predicted to when the command will act, by the law of `estimation.motion` with what was found.

    Attributes:
        noise: standard deviation of what it sees, per axis of a pose.
        plant: the robots and their law, as identified.
        turning: how they turn.
    """

    def __init__(self, told: Told, reference: Reference, n: int) -> None:
        super().__init__(told, reference, n)
        self.noise = told.vision_noise
        self.plant = self._identifier(np.zeros((n, 3)))
        self.turning = self._turning(np.zeros((n, 3)))
        self.memory_frames = self.plant.longest + MOST_FRAMES
        gives_way = told.lag_s > 0 or told.creep_s2_m > 0
        self._compliance = Compliance(told.geometry, GYRO_SHARE) if told.geometry and gives_way else None
        self._started, self._answered = False, np.zeros((n, 3))
        self._arriving: Plane = np.zeros(n, complex)  # velocity as it was predicted in the frame before

    def wanted(self, frame: int, seen: Seen, arrival: Arrival) -> Array:
        """Commands (n, 3) for robots that will have arrived like that when they act; see `Controller.command`."""
        raise NotImplementedError

    def command(self, frame: int, seen: Seen) -> Array:
        """See `Controller`."""
        if not self._started:
            self._started, self.plant, self.turning = True, self._identifier(seen.pose), self._turning(seen.pose)
        for late in seen.steps[:-1]:
            self._identify(None, seen.sent, late)
        self._identify(seen.measured, seen.sent, *seen.steps[-1:])
        arrival = self._predict(seen)
        self.predicted = np.concatenate([pairs(arrival.position), arrival.heading[:, None]], axis=1)
        self._record()
        return self.wanted(frame, seen, arrival)

    def _identify(self, measured: Array | None, sent: CommandsInFlight, late: Late | None = None) -> None:
        """Take in a frame, of which vision reports poses (n, 3); none on the way to that."""
        plant, turning = self.plant, self.turning
        before = turning.heading
        headings = np.full(len(before), np.nan) if measured is None else measured[:, 2]
        positions = None if measured is None else plane(measured[:, :2])
        acted = plant.acted(sent, late)
        back = np.exp(-1j * before)
        shortfall = (plane(acted.command[:, :2].copy()) * plant.turned - plant.velocity) * back
        pulled = self._pulled(plant.velocity * back, turning.rate, plant.gained, shortfall)
        turn, speed = acted.command[:, 2] + pulled, np.abs(plant.velocity)
        later = acted.change[:, 2] / acted.frames
        heard = turning.update(headings, turn, speed, late, shortfall, plant.sliding, later)
        plant.update(positions, (before + turning.heading) / 2, acted, late, heard)
        turning.agree(plant.latency - self.told.delay_frames, plant.variance[:, LATENCY, LATENCY])

    def _pulled(self, velocity: Plane, rate: Array, gained: Plane, shortfall: Plane) -> Array | float:
        """Turn rates that wheels add which give way; see `Compliance.turned`."""
        if self._compliance is None:
            return 0.0
        lag, creep = self.plant.motion.parameters[:, motion.LAG.start], self.turning.creep
        return self._compliance.turned(velocity, rate, gained, shortfall, lag, creep)

    def _predict(self, seen: Seen) -> Arrival:
        """How the commands that are still to act leave the robots."""
        sent, plant, turning, latency = seen.sent, self.plant, self.turning, self.plant.latency
        turning.creep = plant.motion.effort[:, 0] ** 2 * plant.motion.parameters[:, motion.CREEP.start]
        if seen.steps:
            latency = latency + seen.steps[-1].behind
        count = math.ceil(latency.max())
        commands, left = sent.last(count), sent.ahead(latency[:, None])[sent.length - count :, :, 0]
        durations, across = left * self.told.period, plane(commands[..., :2])
        # Velocities change too little meanwhile for what is missing of them to need more than a straight line.
        until = np.add.accumulate(durations[::-1])[::-1]
        whole = np.maximum(until[:1], 1e-12)
        going = self._arriving + (plant.velocity - self._arriving) * (until / whole)
        facing = np.exp(-1j * (turning.heading + turning.rate * (whole - until)))
        shortfalls = (across * plant.turned - going) * facing
        gained = (self._arriving - plant.velocity) / whole * facing
        pulled = self._pulled(going * facing, turning.rate, gained, shortfalls)
        headings = turning.follow(commands[..., 2] + pulled, durations, np.abs(across), shortfalls)
        middles = np.exp(0.5j * (headings[:-1] + headings[1:]))
        position, velocity = plant.follow(across, middles, durations)
        self._arriving = velocity
        return Arrival(position, velocity, headings[-1])

    def around(self, frame: Array, on: int) -> tuple[Array, Array]:
        """The reference's poses and twists (2 + on, n, 3) from the frame before `frame` (n,) until so many after it.

        One that is planned anew in every frame has no before but what it answered last, and goes on by being asked.
        """
        if not isinstance(self.reference, IteratedReference):
            return self.reference.preview(frame - 1, self.predicted, 2 + on)
        poses, twists = self.reference.preview(frame, self.predicted, 1 + on)
        before = self._answered[None]
        _, self._answered = self.reference.at(frame, self.predicted)
        return np.concatenate([poses[:1], poses]), np.concatenate([before, twists])

    def along(self, poses: Array, twists: Array, heading: Array) -> tuple[Plane, Plane]:
        """Velocities of the reference where frames meet, and how robots will face within them, not how they should.

        Args:
            poses: of the reference, from the frame before the one in which the command acts, (frames, n, 3).
            twists: same.
            heading: that robots will have when it begins to act, (n,) rad.

        Returns:
            Velocities (frames - 1, n) m/s, and unit vectors of all frames but the first and last, (frames - 2, n).
        """
        speeds = plane(twists[..., :2])
        middles = poses[1:-1, :, 2] + twists[1:-1, :, 2] * (self.told.period / 2)
        return (speeds[:-1] + speeds[1:]) / 2, np.exp(1j * (middles + (heading - poses[1, :, 2])))

    def turn(
        self, rates: Array, velocities: Plane, facing: Plane, target: Array, heading: Array, planned: Plane
    ) -> Array:
        """Turn rates (n,) to command: the inverse of how robots turn, and a heading hold.

        Args:
            rates: of the reference in the frame before, in the one in which the command acts, and after it, (3, n).
            velocities: of the reference when the command begins to act and a frame later, (2, n) m/s, world frame.
            facing: expected heading in between, unit vectors (n,).
            target: heading of the reference when it begins to act, (n,) rad.
            heading: predicted for that time, (n,) rad.
            planned: command for the way, (n,) m/s, world frame.
        """
        before, after = (rates[:-1] + rates[1:]) / 2
        along, gained = velocities * facing.conj(), (velocities[1] - velocities[0]) * facing.conj() / self.told.period
        shortfall = planned * facing.conj() - along[0]
        pulled = self._pulled(along[0], (before + after) / 2, gained, shortfall)
        asked = self.turning.ask(before, after, np.abs(along[0]), shortfall) - pulled
        return asked + self.told.heading_gain * wrap_angle(target - heading)

    def _record(self) -> None:
        """Say what was found, and how sure it is."""
        plant, turning = self.plant, self.turning
        found, sigma = plant.motion.parameters, plant.sigma
        lag = np.concatenate([plant.motion.lags, turning.lag[:, None]], axis=1)
        self.alpha_hat = 1 / np.concatenate([plant.motion.effort, turning.effort[:, None]], axis=1)
        self.latency_hat = plant.latency[:, None] + lag / self.told.period
        effort_sigma = np.concatenate([sigma[:, motion.EFFORT], turning.sigma[:, 4:5]], axis=1)
        self.channels = {
            "alpha_sigma": self.alpha_hat**2 * effort_sigma,
            "latency_sigma": sigma[:, motion.LATENCY],
            "lag": lag,
            "creep": found[:, motion.CREEP],
            "creep_sigma": sigma[:, motion.CREEP],
            "friction": found[:, motion.FRICTION],
            "friction_sigma": sigma[:, motion.FRICTION],
            "compass": found[:, motion.COMPASS],
            "compass_sigma": sigma[:, motion.COMPASS],
            "coupling": turning.coupling.T,
            "coupling_sigma": turning.sigma[:, 6:8],
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
            told.alpha,
            told.creep_sideways_s2_m,
        )

    def _turning(self, pose: Array) -> Turning:
        told = self.told
        tells = told.alpha is not None
        return Turning(pose[:, 2], told.period, self.noise[2], told.lag_s, told.drag_m_s, told.geometry, tells)
