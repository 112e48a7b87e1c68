"""The radio link: a queue in which each command spends k_d frames, more or less, if it is not lost."""

import sys
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from omni_control.kinematics import Array
from omni_mj.config.faults import (
    Fault,
    RadioBurstLoss,
    RadioDelay,
    RadioDuplicates,
    RadioLoss,
    RadioReorder,
)
from omni_mj.config.settings import RadioSettings, gather
from omni_mj.network.fault_schedule import FaultSchedule
from omni_mj.network.random_streams import Seed, Stream, make_uniform_noise


class ReceivedCommand(NamedTuple):
    """What n robots hold of the radio in a frame.

    Args:
        command: newest command that has arrived (n, 3); zero before the first.
        heading: vision's heading that was sent with it (n,), rad; not a number where nothing new
            arrived.
        age: frames since it was sent (n,).
        is_new: whether it arrived in this frame (n,); None where all did.
        in_body_frame: whether its velocities are along the robot's own axes (n,); None where none are.
        rim_speeds: rim speeds asked for in its place (n, wheels) m/s, not a number where it is
            velocities; None for none.
    """

    command: Array
    heading: Array
    age: np.ndarray
    is_new: np.ndarray | None = None
    in_body_frame: np.ndarray | None = None
    rim_speeds: Array | None = None

    @classmethod
    def without_delay(cls, command: Array, heading: Array | None = None) -> "ReceivedCommand":
        """Commands (n, 3) without a radio's delay, and headings (n,) if vision sees any."""
        n = len(command)
        seen = np.full(n, np.nan) if heading is None else heading
        return cls(command, seen, np.zeros(n, int), np.ones(n, bool))


def compute_max_delay_frames(settings: RadioSettings, faults: Sequence[Fault]) -> int:
    """Return how many frames a packet takes at most."""
    delays = [fault.delay_frames for fault in faults if isinstance(fault, RadioDelay)]
    behind = [
        fault.delay_frames for fault in faults if isinstance(fault, (RadioDuplicates, RadioReorder))
    ]
    return max(settings.delay_frames, *delays, 0) + settings.jitter_frames + max(behind, default=0)


class _Flight(NamedTuple):
    """Packets (k, columns) to some robots (k,) that arrive together; `is_last`: after all others of their tick."""

    sent_tick: int
    robots: np.ndarray
    packets: Array
    is_last: bool


class Radio:
    """Packets in flight to n robots: a command, and the heading that vision saw when it was sent.

    With a delay of 2 frames, sending a, b, c, d in frames 0 to 3 delivers nothing, nothing, a, b;
    nothing is a command of zero and a heading that is NaN. With jitter a packet may overtake
    another: a robot applies the one that was sent last of those that have arrived. A packet that is
    lost never arrives; the robot holds the one before.

    A fault `delay` is the dead time of what is sent while it goes on; of several the last counts.
    Others may lose packets, or have some come after younger ones, or twice: a robot that gets one
    applies it until the next comes. Each packet meets each kind independently; of several faults of
    a kind that lose packets chances multiply.

    The loop sends to all robots once a frame (`exchange`). Other callers count in ticks of a
    fraction of a frame: `send` to some robots, any number of times a tick, then `deliver` once.

    Args:
        settings: Dead time, jitter and losses, one per row.
        seeds: One per row; rows with the same seed lose the same packets.
        faults: Of each row. [none]
        ticks: Of a frame.
        nothing: What a robot holds before the first packet, (k,): a packet is as many numbers.
    """

    def __init__(
        self,
        settings: Sequence[RadioSettings],
        seeds: Sequence[Seed],
        faults: Sequence[Sequence[Fault]] = (),
        ticks: int = 1,
        nothing: Sequence[float] = (0.0, 0.0, 0.0, np.nan),
    ) -> None:
        n = len(seeds)
        self._usual = gather(settings, "delay_frames").astype(int) * ticks
        self._jitter = gather(settings, "jitter_frames").astype(int) * ticks
        self._loss = gather(settings, "loss_probability")
        # Drawn for each packet, or each frame, whatever goes on, so that a fault changes nothing of
        # another.
        self._late, self._losses, self._steps = (
            make_uniform_noise(seeds, stream)
            for stream in (Stream.RADIO_JITTER, Stream.RADIO_LOSSES, Stream.RADIO_BURSTS)
        )
        self._chance = make_uniform_noise(seeds, Stream.RADIO_FAULTS, 4)
        self._schedule = FaultSchedule(
            faults, RadioDelay, RadioLoss, RadioBurstLoss, RadioDuplicates, RadioReorder
        )
        self._passes, self._outside_burst = np.ones((2, n))  # probabilities of a packet
        self._chains = dict[
            tuple[int, RadioBurstLoss], bool
        ]()  # of the bursts that go on: whether in one
        self._copied, self._overtaken = np.zeros(
            (2, n)
        )  # probabilities of a packet, and by how many frames
        self._copied_by, self._overtaken_by = np.zeros((2, n), int)
        self._current = np.tile(np.asarray(nothing, float), (n, 1))
        self._sent_ticks = np.full(n, -1)  # when the packets that robots hold were sent
        self._newest = np.full(n, -1)  # the same, of the newest packet that was not overtaken
        self._in_flight = dict[int, list[_Flight]]()  # by tick of arrival, in the order of sending
        self._ticks, self._tick = ticks, 0
        self._delay = self._usual  # of what is sent from now on, (n,)
        self._begin_frame()

    def exchange(self, command: Array, heading: Array) -> ReceivedCommand:
        """Send commands (n, 3) and headings (n,); return what the robots hold in this frame."""
        packets = np.empty((len(command), 4))
        packets[:, :3], packets[:, 3] = command, heading
        self.send(packets)
        packets, new, age = self.deliver()
        packets[~new, 3] = np.nan
        return ReceivedCommand(packets[:, :3], packets[:, 3], age, new)

    def send(self, packets: Array, to: np.ndarray | None = None) -> None:
        """Send packets (n, k) to the robots of these numbers, by default to all."""
        is_sent = np.full(len(self._newest), to is None)
        if to is not None:
            is_sent[to] = True
        jitter = (2 * self._jitter + 1) * self._late.next()[:, 0] - (self._jitter + 0.5)
        arrival = self._tick + self._delay + np.rint(jitter).astype(int)
        lost, burst, copied, overtaken = self._chance.next().T
        is_received = is_sent & (self._losses.next()[:, 0] >= self._loss)
        is_received &= (lost < self._passes) & (burst < self._outside_burst)
        is_overtaken = is_received & (overtaken < self._overtaken)
        is_copied = is_received & (copied < self._copied)
        later = arrival + np.where(is_overtaken, self._overtaken_by, self._copied_by) * self._ticks
        self._launch(packets, is_overtaken | is_copied, later, is_last=True)
        self._launch(packets, is_received & ~is_overtaken, arrival, is_last=False)

    def deliver(self) -> tuple[Array, np.ndarray, np.ndarray]:
        """End a tick; return what robots hold (n, k), whether it arrived now (n,), and its age in ticks (n,)."""
        tick, new = self._tick, np.zeros(len(self._newest), bool)
        for flight in sorted(self._in_flight.pop(tick, ()), key=lambda flight: flight.is_last):
            robots, packets = flight.robots, flight.packets
            if not flight.is_last:
                is_newer = self._newest[robots] <= flight.sent_tick
                robots, packets = robots[is_newer], packets[is_newer]
                self._newest[robots] = flight.sent_tick
            self._current[robots], self._sent_ticks[robots], new[robots] = (
                packets,
                flight.sent_tick,
                True,
            )
        self.skip_ticks()
        return self._current.copy(), new, tick - self._sent_ticks

    @property
    def ticks_to_next_arrival(self) -> int:
        """The number of ticks from this one on in which nothing arrives of what was sent until now."""
        return min(self._in_flight) - self._tick if self._in_flight else sys.maxsize

    def skip_ticks(self, ticks: int = 1) -> None:
        """End ticks in which all is quiet, without asking what robots hold."""
        for _ in range(ticks):
            self._tick += 1
            if self._tick % self._ticks == 0:
                self._begin_frame()

    def _launch(self, packets: Array, to: np.ndarray, arrival: np.ndarray, is_last: bool) -> None:
        """Let packets (n, k) to some robots (n,) arrive in ticks (n,), after all others of the tick or not."""
        while np.count_nonzero(to):
            tick = int(arrival[to][0])
            group = np.flatnonzero(to & (arrival == tick))
            self._in_flight.setdefault(tick, []).append(
                _Flight(self._tick, group, packets[group], is_last)
            )
            to = to & (arrival != tick)

    def _begin_frame(self) -> None:
        """Apply the faults of the frame that begins."""
        if (active := self._schedule.update(self._tick // self._ticks)) is not None:
            self._delay = self._usual.copy()
            self._passes[:], self._copied[:], self._overtaken[:] = 1.0, 0.0, 0.0
            for row, fault in active.of_kind(RadioDelay):
                self._delay[row] = fault.delay_frames * self._ticks
            for row, loss in active.of_kind(RadioLoss):
                self._passes[row] *= 1 - loss.probability
            for row, copies in active.of_kind(RadioDuplicates):
                self._copied[row], self._copied_by[row] = copies.probability, copies.delay_frames
            for row, late in active.of_kind(RadioReorder):
                self._overtaken[row], self._overtaken_by[row] = late.probability, late.delay_frames
            self._chains = {
                chain: self._chains.get(chain, False) for chain in active.of_kind(RadioBurstLoss)
            }
        drawn = self._steps.next()[:, 0]
        self._outside_burst[:] = 1.0
        for (row, bursts), inside in self._chains.items():
            leave = 1 / bursts.mean_burst_frames
            enter = leave * bursts.burst_fraction / (1 - bursts.burst_fraction)
            inside = bool(drawn[row] >= leave if inside else drawn[row] < enter)
            self._chains[row, bursts] = inside
            self._outside_burst[row] *= 1 - bursts.probability * inside
