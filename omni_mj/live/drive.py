"""The loop with robots outside of this program: `Simulation`, seen by SSL-Vision and commanded by a radio."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from omni_control.delay import CommandsInFlight
from omni_control.kinematics import Array, wrap_angle
from omni_mj.link.radio import Received
from omni_mj.live.link import SILENT_S, Link, VisionLostError
from omni_mj.live.notes import Notes
from omni_mj.live.plant import LivePlant
from omni_mj.live.radio import Command, Radio
from omni_mj.plants import Plant
from omni_mj.scenarios.rows import Row
from omni_mj.scenarios.scenario import Scenario
from omni_mj.scenarios.settings import FRAME_RATE_HZ, PERIOD_S, Settings
from omni_mj.simulate.log import Log
from omni_mj.simulate.simulation import Exchange, See, Simulation
from omni_mj.simulate.teams import told

LOST_FRAMES = round(SILENT_S * FRAME_RATE_HZ)  # without being seen, after which a robot is told to stop
BACK_LOOKS = 7  # in which all robots are seen, one after the other, until vision is taken to be back, and they to stand
REMEMBERED = 64  # commands, for the heading that a robot will have: more than a second
NEAR_M, NEAR_RAD = 0.03, 0.05  # from where it starts, from which on a robot need not be brought there
APPROACH = {"max_speed_m_s": 1.0, "max_acceleration_m_s2": 0.8, "max_turn_rate_rad_s": 3.0}


class Outbound:
    """In the place of the radio of a simulation: commands leave at once, and what they meet is not known.

    Args:
        radio: by which they leave.
        ids: of the robots, n of them.
        latency: until commands act, as far as the team knows, (n,) frames.

    Attributes:
        lost: which robots have not been seen for a while, (n,); they are told to stop.
        latency, alpha: until robots' turning answers, frames, and how much it does; (n,) each.
        held: whether the frame has gone by: nothing leaves, what left before is held.
        sent: commands that left last (n, 3).
    """

    def __init__(self, radio: Radio, ids: Sequence[int], latency: Array) -> None:
        self._radio, self._ids, n = radio, ids, len(ids)
        self.latency, self.alpha, self.lost = latency, np.ones(n), np.zeros(n, bool)
        self.held, self.sent = False, np.zeros((n, 3))
        self._before = CommandsInFlight(n, REMEMBERED)

    def exchange(self, command: Array, heading: Array) -> Received:
        """See `Exchange`; each command leaves with the heading that its robot will have in the middle of its frame."""
        self.sent = self.sent if self.held else np.where(self.lost[:, None], 0.0, command)
        latency = np.clip(self.latency, 0, REMEMBERED - 1)[:, None, None]
        ahead = self._before.ahead(np.broadcast_to(latency[:, 0], (len(command), 3)))
        turned = (ahead * self._before.last(REMEMBERED)).sum(0)[:, 2] + self.sent[:, 2] / 2
        acting = heading + self.alpha * turned * PERIOD_S
        self._before.push(self.sent)
        columns = np.column_stack([self.sent, acting]).tolist()
        if not self.held:
            self._radio.send([Command(number, *values) for number, values in zip(self._ids, columns, strict=True)])
        return Received.at_once(self.sent, heading)

    def stop(self) -> None:
        """Tell all robots to stand."""
        self.held = False
        self.exchange(np.zeros_like(self.sent), np.zeros(len(self.sent)))


@dataclass
class Sight:
    """What vision reports at a tick; see `Camera`."""

    measured: Array
    age: Array | None

    def __call__(self, pose: Array) -> tuple[Array, np.ndarray]:
        """See `Camera`; where robots are nobody knows."""
        measured = self.measured.copy()
        measured[:, 2] = wrap_angle(measured[:, 2])
        return measured, ~np.isnan(measured[:, 0])


class Live(Simulation):
    """A simulation whose robots are not simulated.

    Args:
        scenario: what is driven, on the plant "live".
        link: vision's end, listening.
        radio: the robots' end.
        ids: the robots' numbers, one for each row.
        notes: of what goes wrong.
        rows: the table of rows, where they are not the scenario's places.
        most_frames: after which it ends, if its references have not before.

    Raises:
        OmniError: as `Simulation`.
    """

    def __init__(
        self,
        scenario: Scenario,
        link: Link,
        radio: Radio,
        ids: Sequence[int],
        notes: Notes,
        rows: Sequence[Row] | None = None,
        most_frames: float = math.inf,
    ) -> None:
        self.link, self.ids, self.notes = link, list(ids), notes
        self._radio, self._most = radio, most_frames
        self._unseen = np.zeros(len(self.ids), int)  # frames since each was seen
        self._ticks: list[tuple[Array, np.ndarray, Array, Array]] = []  # that are still to be answered
        super().__init__(scenario, rows=rows)

    @property
    def done(self) -> bool:
        """See `Simulation`."""
        return super().done or self.frame >= self._most

    def _look(self) -> Array:
        """See `Simulation`; waits for the next tick."""
        if self._vision is None:
            if not self._ticks:
                self._ticks = self._next()
            pose, seen, brought, age = self._ticks.pop(0)
            self.live.seen = pose, seen
            self.outbound.held = bool(self._ticks)
            self._unseen = np.where(seen, 0, self._unseen + 1)
            self._sight.measured, self._sight.age = np.where(seen[:, None], pose - brought, np.nan), age
            self.outbound.lost = self._unseen > LOST_FRAMES
            for number in np.flatnonzero(self._unseen == LOST_FRAMES + 1):
                text = f"{self.frame * PERIOD_S:.2f} s: robot {self.ids[number]} is not seen and told to stop"
                self.notes.add("lost", text, always=True)
        return super()._look()

    def run(self, after_frame: Callable[[int], None] = lambda frame: None) -> Log:
        """See `Simulation`; whatever ends it, robots are told to stand at once."""
        try:
            return super().run(after_frame)
        finally:
            self.stop()

    def exchange(self, command: Array, heading: Array) -> Received:
        """See `Exchange`."""
        received = self.outbound.exchange(command, heading)
        if not self.outbound.held:
            self.link.answered()
        return received

    def step(self, command: Array | None = None) -> None:
        """See `Simulation`."""
        turning, alpha = self.team.latency_hat[:, 2], self.team.alpha_hat[:, 2]
        self.outbound.latency = np.where(np.isfinite(turning), turning, self._told)
        self.outbound.alpha = np.where(np.isfinite(alpha), alpha, 1.0)
        self._look()
        super().step(self.outbound.sent if self.outbound.held else command)
        if self.outbound.lost.any() or self.outbound.held:
            self.team.sent(self.outbound.sent)

    def warm(self, pose: Array) -> None:
        """Ask the controllers once, so that what they make at first is made before robots wait; then begin anew."""
        self.team.step(pose)
        self.reset()

    def stop(self) -> None:
        """Tell the robots to stand, more than once as packets are lost."""
        for _ in range(3):
            self.outbound.stop()

    def approach(self, target: Array) -> None:
        """Bring the robots to poses (n, 3), straight, without regard to anything in between."""
        seen = self.link.now()
        away = target - seen
        away[:, 2] = wrap_angle(away[:, 2])
        if (np.hypot(away[:, 0], away[:, 1]) < NEAR_M).all() and (np.abs(away[:, 2]) < NEAR_RAD).all():
            return
        there = Live(self.scenario, self.link, self._radio, self.ids, self.notes, ways(self.rows, seen, seen + away))
        there.run()

    def _robots(self, start: Array) -> tuple[Plant, See, Exchange]:
        n = len(self.rows)
        self.live = LivePlant(self.rows, start, driven=True)
        geometry = self.rows[0].settings.wheels.kinematics
        self._told = np.array([told(row.settings, geometry, True).latency_frames for row in self.rows])
        self.outbound = Outbound(self._radio, self.ids, self._told)
        self._unseen = np.zeros(n, int)
        self._sight = Sight(np.full((n, 3), np.nan), np.zeros(n))
        self._ticks = []
        return self.live, self._sight, self

    def _next(self) -> list[tuple[Array, np.ndarray, Array, Array]]:
        """What is seen at the next tick, after what is not of those that went by while this computer was busy.

        Poses and which were seen; how far they were brought from where they were seen, and how long ago that was.
        """
        before, _ = self.live.seen
        pose, seen = self._tick()
        skipped = min(self.link.skipped, LOST_FRAMES)
        if skipped:
            text = f"{self.frame * PERIOD_S:.2f} s: this computer was busy, {skipped} frames went by"
            self.notes.add("busy", text)
        between = [before + (pose - before) * (i + 1) / (skipped + 1) for i in range(skipped)]
        none, vision = np.zeros_like(pose), self.link.vision
        unseen = [(each, np.zeros(len(pose), bool), none, none[:, 0]) for each in between]
        return [*unseen, (pose, seen, vision.brought, vision.age)]

    def _tick(self) -> tuple[Array, np.ndarray]:
        while True:
            try:
                return self.link.tick(self.team.twist)
            except VisionLostError:
                self._recover()

    def _recover(self) -> None:
        """Wait until vision is back, and bring the robots to where they should have been."""
        at = f"{self.frame * PERIOD_S:.2f} s"
        text = f"{at}: vision has fallen silent; robots are told to stop until it is back"
        self.notes.add("silence", text, always=True)
        looks = 0
        while looks < BACK_LOOKS:
            self.outbound.stop()
            pose = self.link.find(SILENT_S / 5)
            looks = 0 if np.isnan(pose).any() else looks + 1
        self.notes.add("return", f"{at}: vision is back", always=True)
        self.approach(self._reference())
        self.link.restart()


def ways(rows: Sequence[Row], start: Array, end: Array) -> list[Row]:
    """The same robots, to go straight from where they are to where they shall be, (n, 3) each."""
    return [replace(row, world=i, place=0, settings=_way(row.settings, start[i], end[i])) for i, row in enumerate(rows)]


def _way(settings: Settings, start: Array, end: Array) -> Settings:
    way = {**APPROACH, "shape": "waypoints", "mode": "timed", "laps": 1, "lead_s": 0.0, "settle_s": 1.0}
    way["waypoints"] = [start.tolist(), end.tolist()]
    return settings.replace(reference=way, world={"places": [[0, 0, 0]]}, fault=())
