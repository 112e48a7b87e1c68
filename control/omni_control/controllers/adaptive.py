"""Adaptive comp-FLC: the paper's controller on a plant that is identified while it is driven."""

import numpy as np

from omni_control.controllers.base import Seen, Told
from omni_control.controllers.flc import Flc
from omni_control.delay import CommandsInFlight
from omni_control.estimation.identify import PlantIdentifier
from omni_control.estimation.kalman import KalmanFilter
from omni_control.kinematics import Array, body_to_world, world_to_body, wrap_angle
from omni_control.reference import Reference


class AdaptiveCompFlc(Flc):
    """adaptive-comp-flc: comp-FLC whose prediction and feed-forward use latency, alpha and drag identified online.

    The lag of the wheel loops counts as further dead time: for a reference whose acceleration is bounded by a, a lag
    of tau differs from a dead time of tau by no more than a tau^2 / 2. What the model does not explain, the filter
    knows as drift; it is not predicted, which would amplify more noise than it would take away error.
    """

    def __init__(self, told: Told, reference: Reference, n: int) -> None:
        super().__init__(told, reference, n)
        self.plant = PlantIdentifier(n, told.period, told.latency_frames, told.vision_noise, told.drag_m_s)
        self.memory_frames = self.plant.longest
        self.noise = told.vision_noise
        self._filter: KalmanFilter | None = None

    def command(self, frame: int, seen: Seen) -> Array:
        """See `Controller`."""
        plant, sent = self.plant, seen.sent
        if self._filter is None:
            self._filter = KalmanFilter(seen.pose, self.told.period, self.noise)
        moved = self._displacement(self._filter.pose, sent, sent.acted(plant.latency))
        heading = self._filter.pose[:, 2] + moved[:, 2] / 2
        pose = self._filter.update(seen.measured, moved)
        plant.update(seen.measured, heading, sent)
        predicted = pose + self._displacement(pose, sent, sent.ahead(plant.latency))
        self.predicted, self.alpha_hat, self.latency_hat = predicted, plant.alpha, plant.latency
        return plant.ask(self._wanted(frame, predicted), predicted[:, 2])

    def _displacement(self, pose: Array, sent: CommandsInFlight, share: Array) -> Array:
        """Displacement (n, 3) from poses (n, 3) by a `share` (kept, n, 3) of the commands kept."""
        period, commands = self.told.period, sent.last(sent.length)
        turning = (share * self.plant.alpha * commands)[..., 2] * period
        heading = pose[:, 2] + np.cumsum(turning, axis=0) - turning / 2
        twist = self.plant.respond(commands, heading)
        return body_to_world(share * twist, heading).sum(0) * period

    def _wanted(self, frame: int, predicted: Array) -> Array:
        """Twists (n, 3), world frame, that bring robots to the reference of the times to which they were predicted."""
        latency, heading = self.plant.latency, predicted[:, 2]
        mean = latency.copy()
        mean[:, :2] = latency[:, :2].mean(1, keepdims=True)
        target, feed_forward = self.reference.at(frame + mean, predicted)
        later = (latency - mean) * self.told.period
        error = target - predicted + body_to_world(later * world_to_body(feed_forward, heading), heading)
        turn = self.told.heading_gain * wrap_angle(error[:, 2:])
        return feed_forward + np.concatenate([self.fuzzy(error[:, :2]), turn], axis=1)
