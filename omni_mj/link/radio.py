"""The radio link: a queue in which each command spends k_d frames, more or less."""

from dataclasses import dataclass

import numpy as np

from omni_control.kinematics import Array
from omni_mj.link.noise import Stream, draw
from omni_mj.scenarios.settings import RadioSettings


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


class Radio:
    """Packets in flight: a command, and the heading that vision saw when it was sent.

    With a delay of 2 frames, sending a, b, c, d in frames 0 to 3 delivers nothing, nothing, a, b; nothing is a command
    of zero and a heading that is not a number. With jitter a packet may overtake another: a robot obeys the one that
    was sent last of those that have arrived.

    Args:
        settings: dead time and jitter.
        seeds: one per robot; robots with the same seed have the same jitter.
        frames: frames of the run.
    """

    def __init__(self, settings: RadioSettings, seeds: list[int], frames: int) -> None:
        delay, jitter = settings.delay_frames, settings.jitter_frames
        late = draw(seeds, Stream.RADIO_JITTER, lambda rng: rng.uniform(-jitter - 0.5, jitter + 0.5, (frames, 1)))
        late = np.rint(late[..., 0]).astype(int)
        newest = np.full((frames + delay + jitter, len(seeds)), -1)
        robots = np.arange(len(seeds))
        for sent in range(frames):  # later ones overwrite: two that arrive together leave the one sent last
            newest[sent + delay + late[sent], robots] = sent
        self._newest = np.maximum.accumulate(newest)
        self._packets = np.tile([0.0, 0.0, 0.0, np.nan], (delay + jitter + 1, len(seeds), 1))
        self._robots = robots

    def exchange(self, frame: int, command: Array, heading: Array) -> Received:
        """Send commands (n, 3) and headings (n,) in `frame`; return what the robots hold then."""
        self._packets[frame % len(self._packets)] = np.column_stack([command, heading])
        newest = self._newest[frame]
        packet = self._packets[newest % len(self._packets), self._robots]
        packet[newest < 0] = 0.0, 0.0, 0.0, np.nan
        if frame:
            packet[newest == self._newest[frame - 1], 3] = np.nan
        return Received(packet[:, :3], packet[:, 3], frame - newest)
