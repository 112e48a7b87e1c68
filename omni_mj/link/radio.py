"""The radio link: a queue in which each command spends k_d frames, more or less."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from omni_control.kinematics import Array
from omni_mj.link.noise import Noise, Seed, Stream
from omni_mj.link.schedule import Schedule
from omni_mj.scenarios.faults import Delay, Fault
from omni_mj.scenarios.settings import RadioSettings, column


@dataclass(frozen=True)
class Received:
    """What n robots hold of the radio in a frame.

    Args:
        command: newest command that has arrived (n, 3); zero before the first.
        heading: vision's heading that was sent with it (n,), rad; not a number where nothing new arrived.
        age: frames since it was sent (n,).
    """

    command: Array
    heading: Array
    age: np.ndarray

    @classmethod
    def at_once(cls, command: Array, heading: Array | None = None) -> "Received":
        """Commands (n, 3) without a radio's delay, and headings (n,) if vision sees any."""
        n = len(command)
        return cls(command, np.full(n, np.nan) if heading is None else heading, np.zeros(n, int))


def longest(settings: RadioSettings, faults: Sequence[Fault]) -> int:
    """How many frames a packet takes at most."""
    delays = [fault.to for fault in faults if isinstance(fault, Delay)]
    return max(settings.delay_frames, *delays, 0) + settings.jitter_frames


class Radio:
    """Packets in flight: a command, and the heading that vision saw when it was sent.

    With a delay of 2 frames, sending a, b, c, d in frames 0 to 3 delivers nothing, nothing, a, b; nothing is a command
    of zero and a heading that is not a number. With jitter a packet may overtake another: a robot obeys the one that
    was sent last of those that have arrived.

    A fault `delay` is the dead time of what is sent while it goes on; of several the last counts.

    Args:
        settings: dead time and jitter, one per row.
        seeds: one per row; rows with the same seed and jitter have packets that take equally long.
        faults: of each row. [none]
    """

    def __init__(
        self, settings: Sequence[RadioSettings], seeds: Sequence[Seed], faults: Sequence[Sequence[Fault]] = ()
    ) -> None:
        self._delay = column(settings, "delay_frames")[:, 0].astype(int)
        self._jitter = column(settings, "jitter_frames")[:, 0].astype(int)
        self._jitters = bool(self._jitter.any())
        self._late = Noise(seeds, Stream.RADIO_JITTER, lambda rng, count: rng.random((count, 1)))
        self._usual, self._schedule = self._delay, Schedule(faults, Delay)
        room = max(map(longest, settings, faults or [()] * len(settings))) + 1
        n = len(seeds)
        # Both are rings: the frame in which the newest packet was sent that arrives in a frame, and the packets sent.
        self._arriving = np.full((room, n), -1)
        self._packets = np.tile([0.0, 0.0, 0.0, np.nan], (room, n, 1))
        self._newest = np.full(n, -1)
        self._robots = np.arange(n)
        self._frame = 0

    def exchange(self, command: Array, heading: Array) -> Received:
        """Send commands (n, 3) and headings (n,); return what the robots hold in this frame."""
        frame, ring = self._frame, len(self._packets)
        self._frame += 1
        self._packets[frame % ring, :, :3], self._packets[frame % ring, :, 3] = command, heading
        if (active := self._schedule.at(frame)) is not None:
            self._delay = self._usual.copy()
            for row, delay in active.of(Delay):
                self._delay[row] = delay.to
        late = self._delay
        if self._jitters:
            late = late + np.rint((2 * self._jitter + 1) * self._late.next()[:, 0] - (self._jitter + 0.5)).astype(int)
        # Later ones overwrite: of two that arrive together the last sent counts.
        self._arriving[(frame + late) % ring, self._robots] = frame
        before, arrived = self._newest, self._arriving[frame % ring]
        self._newest = np.maximum(before, arrived)
        arrived[:] = -1
        packet = self._packets[self._newest % ring, self._robots]
        packet[self._newest < 0] = 0.0, 0.0, 0.0, np.nan
        packet[self._newest == before, 3] = np.nan
        return Received(packet[:, :3], packet[:, 3], frame - self._newest)
