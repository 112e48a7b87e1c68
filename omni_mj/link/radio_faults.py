"""What faults do to packets of the radio: which are lost, and which come behind younger ones."""

from collections.abc import Sequence

import numpy as np

from omni_control.kinematics import Array
from omni_mj.link.noise import Noise, Seed, Stream
from omni_mj.link.schedule import Met, Schedule
from omni_mj.scenarios.faults import Fault, RadioBursts, RadioDuplicates, RadioLoss, RadioOut, RadioReorder


class Mishaps(Met):
    """Of the packets to n robots. Each packet meets each kind by itself; of several of a kind chances join.

    A burst's chain starts without loss in the frame in which its fault begins.

    Args:
        schedule: of these kinds.
        seeds: one per robot; rows with the same seed lose the same packets.
    """

    kinds = RadioLoss, RadioBursts, RadioDuplicates, RadioReorder, RadioOut

    def __init__(self, schedule: Schedule, seeds: Sequence[Seed]) -> None:
        n = len(seeds)
        self._schedule = schedule
        # Drawn for each packet whatever goes on, so that a fault changes nothing of another.
        self._chance = Noise(seeds, Stream.RADIO_FAULTS, lambda rng, count: rng.random((count, 4)))
        self._steps = Noise(seeds, Stream.RADIO_BURSTS, lambda rng, count: rng.random((count, 1)))
        self._passes, self._copied, self._late = np.ones(n), np.zeros(n), np.zeros(n)
        self._copies, self._delays = np.zeros((2, n), int)
        self._chains = dict[tuple[int, Fault], bool]()  # of the bursts that go on: whether in one
        self._bursts = np.ones(n)

    def begin(self, frame: int) -> None:
        """Begin a frame."""
        if (active := self._schedule.at(frame)) is not None:
            self._passes[:], self._copied[:], self._late[:] = 1.0, 0.0, 0.0
            for row, loss in active.of(RadioLoss):
                self._passes[row] *= 1 - loss.probability
            for row, _ in active.of(RadioOut):
                self._passes[row] = 0.0
            for row, copies in active.of(RadioDuplicates):
                self._copied[row], self._copies[row] = copies.probability, copies.frames
            for row, late in active.of(RadioReorder):
                self._late[row], self._delays[row] = late.probability, late.frames
            going = list(active.of(RadioBursts))
            self._chains = {(row, each): self._chains.get((row, each), False) for row, each in going}
        drawn = self._steps.next()[:, 0]
        self._bursts[:] = 1.0
        for (row, fault), inside in self._chains.items():
            assert isinstance(fault, RadioBursts)
            leave = 1 / fault.frames
            enter = leave * fault.share / (1 - fault.share)
            inside = bool(drawn[row] >= leave if inside else drawn[row] < enter)
            self._chains[row, fault] = inside
            self._bursts[row] *= 1 - fault.probability * inside

    def meet(self) -> tuple[np.ndarray, Array]:
        """What becomes of packets that are sent now to all robots.

        Returns:
            Which arrive as usual (n,), and how many frames after that one comes behind the others (n,); 0: none does.
        """
        lost, burst, copied, late = self._chance.next().T
        there = (lost < self._passes) & (burst < self._bursts)
        overtaken, again = there & (late < self._late), there & (copied < self._copied)
        return there & ~overtaken, np.where(overtaken, self._delays, np.where(again, self._copies, 0))
