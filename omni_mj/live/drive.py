"""The loop with robots outside of this program: `Simulation`, seen by SSL-Vision and commanded by radio."""

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from omni_control.errors import OmniError
from omni_control.kinematics import Array, Kinematics, wrap_angle
from omni_mj.link.radio import Received
from omni_mj.live.link import SILENT_S, Link, VisionLostError
from omni_mj.live.radio import Command, Radio
from omni_mj.plants import Plant, Telemetry
from omni_mj.scenarios.rows import Row
from omni_mj.scenarios.scenario import Scenario
from omni_mj.scenarios.settings import FRAME_RATE_HZ, PERIOD_S
from omni_mj.simulate.log import Log
from omni_mj.simulate.simulation import Exchange, See, Simulation

LOST_FRAMES = round(SILENT_S * FRAME_RATE_HZ)  # without being seen, after which a robot is told to stop
LOOKS_AFTER_SILENCE = 7  # in which all robots are seen in turn until vision is taken to be back, and robots to stand
MEMORY_FRAMES = 64  # of turn rates in flight: more than a second
NEAR_M, NEAR_RAD = 0.03, 0.05  # a robot this near to its start need not be brought there
APPROACH = {
    "max_speed_m_s": 1.0,
    "max_acceleration_m_s2": 0.8,
    "max_turn_rate_rad_s": 3.0,
    "shape": "waypoints",
    "mode": "timed",
    "laps": 1,
    "lead_s": 0.0,
    "settle_s": 1.0,
}


class LivePlant:
    """Robots outside of this program, in place of a plant and its camera.

    Args:
        rows: One per robot.
        start: Initial poses, shape (n, 3).
        driven: Whether `Live` drives them.

    Attributes:
        poses: What vision says, extrapolated to the tick, shape (n, 3). Nobody knows the truth.
        measured: What vision saw, shape (n, 3); NaN for robots that were not seen.
        age: How old that is, shape (n,), s.

    Raises:
        OmniError: Nobody drives them.
    """

    def __init__(self, rows: Sequence[Row], start: Array, *, driven: bool = False) -> None:
        if not driven:
            raise OmniError("robots on the live plant are outside of this program: omni-mj drive drives them")
        self.geometry: Kinematics | None = rows[0].settings.wheels.kinematics
        self.poses = np.array(start, float)
        self.measured = np.full_like(self.poses, np.nan)
        self.age: Array | None = None
        self._telemetry = Telemetry.of_no_wheels(len(rows), len(self.geometry.azimuths))

    def __call__(self, pose: Array) -> tuple[Array, np.ndarray]:
        """Return the poses seen, and which robots were seen; see `Camera`."""
        measured = self.measured.copy()
        measured[:, 2] = wrap_angle(measured[:, 2])
        return measured, ~np.isnan(measured[:, 0])

    def pose(self) -> Array:
        """See `Plant`."""
        return self.poses

    def twist(self) -> Array:
        """Return NaN: velocities are unknown."""
        return np.full_like(self.poses, np.nan)

    def advance(self, received: Received) -> dict[int, str]:
        """See `Plant`; the robots go on by themselves."""
        return {}

    def telemetry(self) -> Telemetry:
        """Return NaN: nothing is known of the wheels."""
        return self._telemetry


class Live(Simulation):
    """A simulation whose robots are not simulated.

    Args:
        scenario: What is driven, on the plant "live".
        link: Vision's end, listening.
        radio: The robots' end.
        ids: The robots' numbers, one per row.
        rows: The table of rows, if they are not the scenario's places.
        max_frames: After which it ends, unless its references end before.

    Raises:
        OmniError: As `Simulation`.
    """

    _sent: Array
    _nominal_latency: Array
    _is_lost: np.ndarray

    def __init__(
        self,
        scenario: Scenario,
        link: Link,
        radio: Radio,
        ids: Sequence[int],
        rows: Sequence[Row] | None = None,
        max_frames: float = math.inf,
    ) -> None:
        self.link, self.ids, self.notes = link, list(ids), link.vision.notes
        self._radio, self._max_frames = radio, max_frames
        super().__init__(scenario, rows=rows)

    @property
    def done(self) -> bool:
        """See `Simulation`."""
        return super().done or self.frame >= self._max_frames

    def run(self, after_frame: Callable[[int], None] = lambda frame: None) -> Log:
        """See `Simulation`. Whatever ends the run, robots are told to stand at once."""
        try:
            return super().run(after_frame)
        finally:
            self.stop()

    def step(self, command: Array | None = None) -> None:
        """See `Simulation`."""
        latency, alpha = self.team.latency_hat[:, 2], self.team.alpha_hat[:, 2]
        self._turn_latency = np.where(np.isfinite(latency), latency, self._nominal_latency)
        self._turn_alpha = np.where(np.isfinite(alpha), alpha, 1.0)
        self._look()
        super().step(self._sent if self._is_past else command)
        if self._is_lost.any() or self._is_past:
            self.team.sent(self._sent)

    def exchange(self, command: Array, heading: Array) -> Received:
        """Send commands, shape (n, 3), to robots with headings, shape (n,)."""
        self._send(command, heading)
        if not self._is_past:
            self.link.note_answer()
        return Received.at_once(self._sent, heading)

    def warm_up(self, pose: Array) -> None:
        """Ask the controllers once, for what they make at first, before robots wait; then begin anew."""
        self.team.step(pose)
        self.reset()

    def stop(self) -> None:
        """Tell the robots to stand, more than once as packets are lost."""
        for _ in range(3):
            self._is_past = False
            self._send(np.zeros_like(self._sent), np.zeros(len(self._sent)))

    def approach(self, target: Array) -> None:
        """Bring the robots to poses, shape (n, 3), straight, without regard to anything in between."""
        poses = self.link.now()
        way = target - poses
        way[:, 2] = wrap_angle(way[:, 2])
        if (np.hypot(way[:, 0], way[:, 1]) > NEAR_M).any() or (np.abs(way[:, 2]) > NEAR_RAD).any():
            rows = straight_routes(self.rows, poses, poses + way)
            Live(self.scenario, self.link, self._radio, self.ids, rows).run()

    def _robots(self, start: Array) -> tuple[Plant, See, Exchange]:
        n = len(self.rows)
        self._plant = LivePlant(self.rows, start, driven=True)
        settings = [row.settings for row in self.rows]
        latency = [each.radio.delay_frames + FRAME_RATE_HZ * each.control.lag_s for each in settings]
        self._nominal_latency = self._turn_latency = np.array(latency)
        self._turn_alpha, self._turn_rates = np.ones(n), np.zeros((MEMORY_FRAMES, n))  # newest first
        self._sent, self._is_past = np.zeros((n, 3)), False
        self._unseen, self._is_lost = np.zeros(n, int), np.zeros(n, bool)
        self._tick, self._n_past = (start, np.zeros(n, bool)), 0  # what was seen, frames that went by before it
        return self._plant, self._plant, self

    def _send(self, command: Array, heading: Array) -> None:
        """Send each command with the heading that its robot will have in the middle of the command's frame."""
        if not self._is_past:
            self._sent = np.where(self._is_lost[:, None], 0.0, command)
        in_flight = np.clip(self._turn_latency - np.arange(MEMORY_FRAMES)[:, None], 0.0, 1.0)
        turned = (in_flight * self._turn_rates).sum(0) + self._sent[:, 2] / 2
        headings = heading + self._turn_alpha * turned * PERIOD_S
        self._turn_rates = np.vstack([self._sent[:, 2], self._turn_rates[:-1]])
        if not self._is_past:
            columns = np.column_stack([self._sent, headings]).tolist()
            self._radio.send([Command(number, *values) for number, values in zip(self.ids, columns, strict=True)])

    def _look(self) -> Array:
        """See `Simulation`; waits for the next tick, after frames that went by while this computer was busy."""
        if self._vision is None:
            vision, before = self.link.vision, self._plant.poses
            if self._is_past:
                self._n_past -= 1
            else:
                self._tick = self._see()
                self._n_past = min(self.link.skipped, LOST_FRAMES)
                if self._n_past:
                    self._note("busy", f"this computer was busy, {self._n_past} frames went by")
            poses, seen = self._tick
            self._is_past = self._n_past > 0
            self._plant.poses = before + (poses - before) / (self._n_past + 1) if self._is_past else poses
            seen = seen & (not self._is_past)
            self._plant.age = vision.age
            self._plant.measured = np.where(seen[:, None], poses - vision.extrapolation, np.nan)
            self._unseen = np.where(seen, 0, self._unseen + 1)
            self._is_lost = self._unseen > LOST_FRAMES
            for number in np.flatnonzero(self._unseen == LOST_FRAMES + 1):
                self._note("lost", f"robot {self.ids[number]} is not seen and told to stop", always=True)
        return super()._look()

    def _see(self) -> tuple[Array, np.ndarray]:
        """Wait for the next tick. If vision is silent, wait and bring the robots to where they should have been."""
        while True:
            try:
                return self.link.tick(self.team.twist)
            except VisionLostError:
                self._note("silence", "vision has fallen silent; robots are told to stop until it is back", always=True)
            looks = 0
            while looks < LOOKS_AFTER_SILENCE:
                self.stop()
                looks = 0 if np.isnan(self.link.find(SILENT_S / 5)).any() else looks + 1
            self._note("return", "vision is back", always=True)
            self.approach(self._reference())
            self.link.restart()

    def _note(self, kind: str, text: str, *, always: bool = False) -> None:
        self.notes.add(kind, f"{self.frame * PERIOD_S:.2f} s: {text}", always=always)


def straight_routes(rows: Sequence[Row], start: Array, end: Array) -> list[Row]:
    """Return rows of the same robots that go straight from poses to poses, shape (n, 3) each."""
    result = []
    for i, row in enumerate(rows):
        reference = APPROACH | {"waypoints": [start[i].tolist(), end[i].tolist()]}
        settings = row.settings.replace(reference=reference, world={"places": [[0, 0, 0]]}, fault=())
        result.append(replace(row, world=i, place=0, settings=settings))
    return result
