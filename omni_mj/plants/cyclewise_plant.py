"""Base class of the plants with wheels that advance cycle by cycle."""

from abc import abstractmethod

import numpy as np

from omni_control.kinematics import Array
from omni_mj.config import CYCLES_PER_FRAME
from omni_mj.network.radio import ReceivedCommand
from omni_mj.plants.wheeled_plant_base import WheeledPlantBase
from omni_mj.robot.array_ops import stack_records
from omni_mj.robot.electronics import CycleRecord, end_frame, receive_command
from omni_mj.robot.firmware import set_heading
from omni_mj.robot.firmware_state import FrameInputs


class CyclewisePlant(WheeledPlantBase):
    """Robots with wheels whose frames can be advanced in several parts."""

    def _start_cycles(self) -> None:
        """Begin with a new frame."""
        n = len(self._rows)
        self._cycle = 0  # number of cycles so far in this frame
        self._records = list[CycleRecord]()
        # Vision's headings that arrived in this frame, rad, NaN if none, and ages in frames, (n,)
        self._no_vision: tuple[Array, np.ndarray] = np.full(n, np.nan), np.zeros(n, int)
        self._vision = self._no_vision

    @property
    def cycles_left(self) -> int:
        """Number of cycles to the end of the frame; 0 at its beginning."""
        return -self._cycle % CYCLES_PER_FRAME

    def advance_cycles(self, n_cycles: int, received: ReceivedCommand | None) -> dict[int, str]:
        """Advance by some cycles of 1/960 s, at most to the end of the frame.

        Args:
            n_cycles: Number of cycles.
            received: Commands that apply from now on, or None if none arrived. Vision's headings in
                them are used at the beginning of the next frame.

        Returns:
            At the end of a frame a mapping from failed row to cause, as `advance`; otherwise empty.
        """
        if received is not None:
            self._receive(received)
        if self._cycle == 0:
            self._begin_frame()
        self._records += [self._advance_cycle() for _ in range(n_cycles)]
        self._cycle = (self._cycle + n_cycles) % CYCLES_PER_FRAME
        return {} if self._cycle else self._complete_frame()

    def _complete_frame(self) -> dict[int, str]:
        """Advance what changes from frame to frame; return a mapping from failed row to cause."""
        self._record = stack_records(self._records)
        self.electronics = end_frame(self.parameters.electronics, self.electronics, self._record)
        self._records.clear()
        return self._end_frame()

    def set_heading_estimate(self, robot: int, heading: float) -> None:
        """Set the heading estimate of a robot's firmware.

        Args:
            robot: Row of the robot.
            heading: New estimate, rad.
        """
        mask = np.arange(len(self._rows)) == robot
        firmware = set_heading(self.electronics.firmware, mask, np.array(heading))
        self.electronics = self.electronics._replace(firmware=firmware)

    @abstractmethod
    def _begin_frame(self) -> None:
        """Apply changes from frame to frame: faults, disturbances, vision's headings, heat."""

    @abstractmethod
    def _advance_cycle(self) -> CycleRecord:
        """Advance by a cycle, and return its record."""

    @abstractmethod
    def _end_frame(self) -> dict[int, str]:
        """Stop rows that have failed in the frame, and return a mapping from row to cause."""

    def _take_inputs(self) -> FrameInputs:
        """Return the inputs of the frame that begins, with vision's headings so far."""
        # Headings that arrive from now on are for the next frame.
        vision, self._vision = self._vision, self._no_vision
        return self._make_inputs(*vision)

    def _receive(self, received: ReceivedCommand) -> None:
        """Pass commands to the firmware, and store vision's headings until the next frame."""
        command = self._make_command(received)
        self.electronics = receive_command(self.parameters.electronics, self.electronics, command)
        heading, age = self._vision
        is_missing = np.isnan(received.heading)
        self._vision = (
            np.where(is_missing, heading, received.heading),
            np.where(is_missing, age, received.age),
        )
