"""The radio link: a queue in which each command spends k_d frames, more or less, if it is not lost."""

import sys
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from omni_control.kinematics import Array
from omni_mj.link.noise import Noise, Seed, Stream
from omni_mj.link.radio_faults import Mishaps
from omni_mj.link.schedule import Schedule
from omni_mj.scenarios.faults import Delay, Fault, RadioDuplicates, RadioReorder
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
    """How many frames a packet takes at most."""
    delays = [fault.to for fault in faults if isinstance(fault, Delay)]
    behind = [fault.frames for fault in faults if isinstance(fault, (RadioDuplicates, RadioReorder))]
    return max(settings.delay_frames, *delays, 0) + settings.jitter_frames + max(behind, default=0)


class Radio:
    """Packets in flight: a command, and the heading that vision saw when it was sent.

    With a delay of 2 frames, sending a, b, c, d in frames 0 to 3 delivers nothing, nothing, a, b; nothing is a command
    of zero and a heading that is not a number. With jitter a packet may overtake another: a robot obeys the one that
    was sent last of those that have arrived. A packet that is lost never arrives; the robot holds the one before.

    A fault `delay` is the dead time of what is sent while it goes on; of several the last counts. Others may lose
    packets, or have some come after younger ones, or twice: a robot that gets one obeys it until the next comes.

    The loop sends to all robots once a frame (`exchange`). Whoever sends when he likes counts in ticks of a fraction of
    a frame: `send` to some robots, any number of times a tick, then `deliver` once.

    Args:
        settings: dead time, jitter and losses, one per row.
        seeds: one per row; rows with the same seed and jitter have packets that take equally long.
        faults: of each row. [none]
        ticks: of a frame.
        nothing: what a robot holds before the first packet, (k,): a packet is as many numbers.
    """

    def __init__(
        self,
        settings: Sequence[RadioSettings],
        seeds: Sequence[Seed],
        faults: Sequence[Sequence[Fault]] = (),
        ticks: int = 1,
        nothing: Sequence[float] = (0.0, 0.0, 0.0, np.nan),
    ) -> None:
        self._usual = column(settings, "delay_frames")[:, 0].astype(int) * ticks
        self._jitter = column(settings, "jitter_frames")[:, 0].astype(int) * ticks
        self._jitters = bool(self._jitter.any())
        self._late = Noise(seeds, Stream.RADIO_JITTER, lambda rng, count: rng.random((count, 1)))
        self._loss = column(settings, "loss_probability")[:, 0]
        self._loses = bool(self._loss.any())
        self._losses = Noise(seeds, Stream.RADIO_LOSSES, lambda rng, count: rng.random((count, 1)))
        self._schedule, self._ticks = Schedule(faults, Delay), ticks
        self._mishaps = Mishaps.of(faults, seeds)
        room = max(map(longest, settings, faults or [()] * len(settings))) * ticks + 1
        n = len(seeds)
        # Both are rings: the tick in which the newest packet was sent that arrives in a tick, and the packets sent.
        self._arriving = np.full((room, n), -1)
        self._packets = np.empty((room, n, len(nothing)))
        self._holding = np.tile(np.asarray(nothing, float), (n, 1))
        self._newest = np.full(n, -1)
        # Of packets that come last of all in a tick: when they were sent. What a robot holds was sent at `_held`.
        self._behind = None if self._mishaps is None else np.full((room, n), -1)
        self._held = self._newest
        self._robots = np.arange(n)
        self._tick, self._coming = 0, set[int]()  # now, and the ticks from now on in which a packet arrives
        self._delay = self._usual  # of what is sent from now on, (n,)
        self._change()

    def exchange(self, command: Array, heading: Array) -> Received:
        """Send commands (n, 3) and headings (n,); return what the robots hold in this frame."""
        packets = np.empty((len(command), 4))
        packets[:, :3], packets[:, 3] = command, heading
        self.send(packets)
        packet, new, age = self.deliver()
        seen = packet[:, 3]
        if np.count_nonzero(new) < len(new):
            seen[~new] = np.nan
        return Received(packet[:, :3], seen, age, new)

    def send(self, packets: Array, to: np.ndarray | None = None) -> None:
        """Send packets (n, k), to those robots alone whose numbers are given; to all if none are."""
        tick, ring, late = self._tick, len(self._packets), self._delay
        to = self._robots if to is None else to
        if self._jitters:
            late = late + np.rint((2 * self._jitter + 1) * self._late.next()[:, 0] - (self._jitter + 0.5)).astype(int)
        if self._loses:
            to = to[self._losses.next()[to, 0] >= self._loss[to]]
        self._packets[tick % ring, to] = packets[to]
        if self._mishaps is not None:
            to = self._send_amiss(self._mishaps, to, late)
        # Later ones overwrite: of two that arrive together the last sent counts.
        arrives = tick + late[to]
        self._arriving[arrives % ring, to] = tick
        self._coming.update(arrives.tolist())

    def deliver(self) -> tuple[Array, np.ndarray, np.ndarray]:
        """End a tick: what robots hold (n, k), whether it arrived now (n,), and its age in ticks (n,)."""
        tick, ring = self._tick, len(self._packets)
        self.wait()
        arrived = self._arriving[tick % ring]
        new = arrived > self._newest
        self._newest = np.maximum(self._newest, arrived)
        if self._behind is None:
            self._held = self._newest
        else:
            behind = self._behind[tick % ring]
            self._held = np.where(behind >= 0, behind, np.where(new, arrived, self._held))
            new, behind[:] = new | (behind >= 0), -1
        arrived[:] = -1
        if np.count_nonzero(new):
            held = self._packets[self._held % ring, self._robots]
            np.copyto(self._holding, held, where=new[:, None])
        return self._holding.copy(), new, tick - self._held

    @property
    def quiet(self) -> int:
        """For how many ticks from this one on nothing arrives of what was sent until now."""
        return min(self._coming) - self._tick if self._coming else sys.maxsize

    def wait(self, ticks: int = 1) -> None:
        """End ticks in which all is quiet: a `deliver` each of which nobody asks what robots hold."""
        for _ in range(ticks):
            self._coming.discard(self._tick)
            self._tick += 1
            if self._tick % self._ticks == 0:
                self._change()

    def _send_amiss(self, mishaps: Mishaps, to: np.ndarray, late: np.ndarray) -> np.ndarray:
        """See to packets that come behind others, `late` (n,) as they are anyway; return who gets his as usual."""
        assert self._behind is not None
        arrives, behind = mishaps.meet()
        later = to[behind[to] > 0]
        after = self._tick + late[later] + behind[later] * self._ticks
        self._behind[after % len(self._packets), later] = self._tick
        self._coming.update(after.tolist())
        return to[arrives[to]]

    def _change(self) -> None:
        """Take over what happens in the frame that begins."""
        if self._mishaps is not None:
            self._mishaps.begin(self._tick // self._ticks)
        if (active := self._schedule.at(self._tick // self._ticks)) is not None:
            delay = self._usual.copy()
            for row, fault in active.of(Delay):
                delay[row] = fault.to * self._ticks
            self._delay = delay
