"""The radio link: a queue in which each command spends k_d frames, more or less, if it is not lost."""

import sys
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from omni_control.kinematics import Array
from omni_mj.link.noise import Noise, Seed, Stream
from omni_mj.link.schedule import Schedule
from omni_mj.scenarios.faults import Delay, Fault, RadioBursts, RadioDuplicates, RadioLoss, RadioReorder
from omni_mj.scenarios.settings import RadioSettings, column


@dataclass(frozen=True)
class Received:
    """What n robots hold of the radio in a frame.

    Args:
        command: newest command that has arrived (n, 3); zero before the first.
        heading: vision's heading that was sent with it (n,), rad; not a number where nothing new arrived.
        age: frames since it was sent (n,).
        new: whether it arrived in this frame (n,); None where all did.
        body: whether its velocities are along the robot's own axes (n,); None where none are.
        wheels: rim speeds asked for in its place (n, wheels) m/s, not a number where it is velocities; None for none.
    """

    command: Array
    heading: Array
    age: np.ndarray
    new: np.ndarray | None = None
    body: np.ndarray | None = None
    wheels: Array | None = None

    @classmethod
    def at_once(cls, command: Array, heading: Array | None = None) -> "Received":
        """Commands (n, 3) without a radio's delay, and headings (n,) if vision sees any."""
        n = len(command)
        seen = np.full(n, np.nan) if heading is None else heading
        return cls(command, seen, np.zeros(n, int), np.ones(n, bool))

    def of(self, robots: np.ndarray, wheels: int) -> "Received":
        """What some of the robots hold, which have so many wheels."""
        return Received(
            self.command[robots],
            self.heading[robots],
            self.age[robots],
            None if self.new is None else self.new[robots],
            None if self.body is None else self.body[robots],
            None if self.wheels is None else self.wheels[robots, :wheels],
        )


def longest(settings: RadioSettings, faults: Sequence[Fault]) -> int:
    """Return how many frames a packet takes at most."""
    delays = [fault.to for fault in faults if isinstance(fault, Delay)]
    behind = [fault.frames for fault in faults if isinstance(fault, (RadioDuplicates, RadioReorder))]
    return max(settings.delay_frames, *delays, 0) + settings.jitter_frames + max(behind, default=0)


class Radio:
    """Packets in flight to n robots: a command, and the heading that vision saw when it was sent.

    With a delay of 2 frames, sending a, b, c, d in frames 0 to 3 delivers nothing, nothing, a, b; nothing is a command
    of zero and a heading that is NaN. With jitter a packet may overtake another: a robot applies the one that was sent
    last of those that have arrived. A packet that is lost never arrives; the robot holds the one before.

    A fault `delay` is the dead time of what is sent while it goes on; of several the last counts. Others may lose
    packets, or have some come after younger ones, or twice: a robot that gets one applies it until the next comes. Each
    packet meets each kind independently; of several faults of a kind that lose packets chances multiply.

    The loop sends to all robots once a frame (`exchange`). Other callers count in ticks of a fraction of a frame:
    `send` to some robots, any number of times a tick, then `deliver` once.

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
        self._usual = column(settings, "delay_frames")[:, 0].astype(int) * ticks
        self._jitter = column(settings, "jitter_frames")[:, 0].astype(int) * ticks
        self._loss = column(settings, "loss_probability")[:, 0]
        self._jitters, self._loses = bool(self._jitter.any()), bool(self._loss.any())
        # Drawn for each packet, or each frame, whatever goes on, so that a fault changes nothing of another.
        self._late, self._losses, self._steps = (
            Noise(seeds, stream, lambda rng, count: rng.random((count, 1)))
            for stream in (Stream.RADIO_JITTER, Stream.RADIO_LOSSES, Stream.RADIO_BURSTS)
        )
        self._chance = Noise(seeds, Stream.RADIO_FAULTS, lambda rng, count: rng.random((count, 4)))
        self._schedule = Schedule(faults, Delay, RadioLoss, RadioBursts, RadioDuplicates, RadioReorder)
        self._fails = bool(set(self._schedule.kinds) - {Delay})
        self._passes, self._outside_burst = np.ones((2, n))  # probabilities of a packet
        self._chains = dict[tuple[int, RadioBursts], bool]()  # of the bursts that go on: whether in one
        self._copied, self._overtaken = np.zeros((2, n))  # probabilities of a packet, and by how many frames
        self._copied_by, self._overtaken_by = np.zeros((2, n), int)

        room = max(map(longest, settings, faults or [()] * n)) * ticks + 1
        # Rings: the tick in which the newest packet was sent that arrives in a tick, and the packets sent.
        self._arrival_ring = np.full((room, n), -1)
        self._packets = np.empty((room, n, len(nothing)))
        self._current = np.tile(np.asarray(nothing, float), (n, 1))
        self._newest = np.full(n, -1)
        self._overtaken_ring = np.full((room, n), -1)  # the same ring of packets that come last of all in a tick
        self._sent_ticks = self._newest  # when the packets that robots hold were sent
        self._robots, self._ticks = np.arange(n), ticks
        self._tick, self._arrival_ticks = 0, set[int]()  # now, and the ticks from now on in which a packet arrives
        self._delay = self._usual  # of what is sent from now on, (n,)
        self._begin_frame()

    def exchange(self, command: Array, heading: Array) -> Received:
        """Send commands (n, 3) and headings (n,); return what the robots hold in this frame."""
        packets = np.empty((len(command), 4))
        packets[:, :3], packets[:, 3] = command, heading
        self.send(packets)
        packets, new, age = self.deliver()
        packets[~new, 3] = np.nan
        return Received(packets[:, :3], packets[:, 3], age, new)

    def send(self, packets: Array, to: np.ndarray | None = None) -> None:
        """Send packets (n, k) to the robots of these numbers, by default to all."""
        tick, ring, late = self._tick, len(self._packets), self._delay
        to = self._robots if to is None else to
        if self._jitters:
            late = late + np.rint((2 * self._jitter + 1) * self._late.next()[:, 0] - (self._jitter + 0.5)).astype(int)
        if self._loses:
            to = to[self._losses.next()[to, 0] >= self._loss[to]]
        self._packets[tick % ring, to] = packets[to]
        if self._fails:
            lost, burst, copied, overtaken = self._chance.next().T
            is_received = (lost < self._passes) & (burst < self._outside_burst)
            is_overtaken = is_received & (overtaken < self._overtaken)
            is_copied = is_received & (copied < self._copied)
            delay_frames = np.where(is_overtaken, self._overtaken_by, np.where(is_copied, self._copied_by, 0))
            receivers = to[delay_frames[to] > 0]
            arrival = tick + late[receivers] + delay_frames[receivers] * self._ticks
            self._overtaken_ring[arrival % ring, receivers] = tick
            self._arrival_ticks.update(arrival.tolist())
            to = to[(is_received & ~is_overtaken)[to]]
        # Later packets overwrite: of two that arrive together the last sent counts.
        arrives = tick + late[to]
        self._arrival_ring[arrives % ring, to] = tick
        self._arrival_ticks.update(arrives.tolist())

    def deliver(self) -> tuple[Array, np.ndarray, np.ndarray]:
        """End a tick; return what robots hold (n, k), whether it arrived now (n,), and its age in ticks (n,)."""
        tick, ring = self._tick, len(self._packets)
        self.wait()
        arrivals = self._arrival_ring[tick % ring]
        new = arrivals > self._newest
        self._newest = np.maximum(self._newest, arrivals)
        sent_ticks = np.where(new, arrivals, self._sent_ticks)
        if self._fails:
            overtaken = self._overtaken_ring[tick % ring]
            has_overtaken = overtaken >= 0
            sent_ticks, new = np.where(has_overtaken, overtaken, sent_ticks), new | has_overtaken
            overtaken[:] = -1
        self._sent_ticks = sent_ticks
        arrivals[:] = -1
        self._current[new] = self._packets[sent_ticks[new] % ring, self._robots[new]]
        return self._current.copy(), new, tick - sent_ticks

    @property
    def quiet(self) -> int:
        """The number of ticks from this one on in which nothing arrives of what was sent until now."""
        return min(self._arrival_ticks) - self._tick if self._arrival_ticks else sys.maxsize

    def wait(self, ticks: int = 1) -> None:
        """End ticks in which all is quiet, without asking what robots hold."""
        for _ in range(ticks):
            self._arrival_ticks.discard(self._tick)
            self._tick += 1
            if self._tick % self._ticks == 0:
                self._begin_frame()

    def _begin_frame(self) -> None:
        """Apply the faults of the frame that begins."""
        if (active := self._schedule.at(self._tick // self._ticks)) is not None:
            self._delay = self._usual.copy()
            self._passes[:], self._copied[:], self._overtaken[:] = 1.0, 0.0, 0.0
            for row, fault in active.of(Delay):
                self._delay[row] = fault.to * self._ticks
            for row, loss in active.of(RadioLoss):
                self._passes[row] *= 1 - loss.probability
            for row, copies in active.of(RadioDuplicates):
                self._copied[row], self._copied_by[row] = copies.probability, copies.frames
            for row, late in active.of(RadioReorder):
                self._overtaken[row], self._overtaken_by[row] = late.probability, late.frames
            self._chains = {chain: self._chains.get(chain, False) for chain in active.of(RadioBursts)}
        if not self._fails:
            return
        drawn = self._steps.next()[:, 0]
        self._outside_burst[:] = 1.0
        for (row, bursts), inside in self._chains.items():
            leave = 1 / bursts.frames
            enter = leave * bursts.share / (1 - bursts.share)
            inside = bool(drawn[row] >= leave if inside else drawn[row] < enter)
            self._chains[row, bursts] = inside
            self._outside_burst[row] *= 1 - bursts.probability * inside
