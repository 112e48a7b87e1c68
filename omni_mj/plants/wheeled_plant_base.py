"""Base class of the plants with wheels: firmware, variation, disturbances and faults."""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import Any

import numpy as np

from omni_control.kinematics import Array, Kinematics
from omni_mj.config import CYCLES_PER_FRAME
from omni_mj.config.rows import Row
from omni_mj.config.settings import gather
from omni_mj.network.radio import ReceivedCommand, compute_max_delay_frames
from omni_mj.network.random_streams import Noise, Stream
from omni_mj.plants.fault_effects import ChangeableBodies, FaultEffects
from omni_mj.plants.randomization import Disturbances, RobotVariation
from omni_mj.robot.array_ops import select
from omni_mj.robot.electronics import (
    CycleRecord,
    ElectronicsParameters,
    ElectronicsState,
    make_electronics,
)
from omni_mj.robot.firmware_state import FirmwareCommand, FrameInputs, extend_memory
from omni_mj.robot.wheel_carpet_forces import CarpetParameters, make_carpet_parameters


class WheeledPlantBase(ABC):
    """Base class of robots with roller wheels on carpet, driven by their firmware.

    Args:
        rows: Rows of the robots.
        kinematics: Geometry of the wheels.
        variation: Deviations of the robots from their settings.
        heading: Heading at the start, (n,) rad.

    Attributes:
        parameters: Parameters of the robots; those of the electronics are in `electronics`.
        electronics: State of firmware, motors and batteries.
        geometry: Geometry of the wheels when new.
        variation: Deviations of the robots from their settings.
        min_heading_memory: Smallest number of frames for which the firmware stores its headings.
            Older headings from vision cannot correct it.
    """

    parameters: Any
    electronics: ElectronicsState
    geometry: Kinematics | None
    min_heading_memory = 0

    def __init__(
        self,
        rows: Sequence[Row],
        kinematics: Kinematics,
        variation: RobotVariation,
        heading: Array,
    ) -> None:
        self.geometry = kinematics
        self.variation = variation
        self._rows = rows
        self._failed = np.zeros(len(rows), bool)  # on failed robots no force acts
        self._disturbances = Disturbances(rows)
        self._current_setpoint: Array | None = None
        self._fault_effects: FaultEffects | None = None
        seeds = [row.noise_seed for row in rows]
        self._dropout_noise = Noise(seeds, Stream.ENCODER_FAULTS, variation.magnet_factor.shape[1])
        zeros = np.zeros((1, *variation.magnet_factor.T.shape))
        # Record of the latest frame
        self._record = CycleRecord(zeros, zeros, zeros, zeros, zeros[:, 0], zeros[:, 0])
        self._initial_electronics = self._make_electronics(heading)
        self._nominal_carpet = self._make_carpet()

    def _make_electronics(self, heading: Array) -> tuple[ElectronicsParameters, ElectronicsState]:
        """Return parameters and initial state of robots with these headings, (n,) rad."""
        assert self.geometry is not None
        max_delay_frames = max(
            compute_max_delay_frames(row.settings.radio, row.settings.fault) for row in self._rows
        )
        return make_electronics(
            [row.settings for row in self._rows],
            self.geometry,
            heading,
            np.ascontiguousarray(self.variation.magnet_factor.T),
            n_frames=max(max_delay_frames, self.min_heading_memory) + 1,
            has_faults=any(row.faults for row in self._rows),
        )

    def _make_carpet(self) -> CarpetParameters:
        """Return the parameters of the carpet without faults."""
        assert self.geometry is not None
        return make_carpet_parameters(
            [row.settings for row in self._rows],
            self.geometry,
            np.ascontiguousarray(self.variation.friction_factor.T),
            np.ascontiguousarray(self.variation.wear.T),
        )

    def _start_faults(self, bodies: ChangeableBodies, frame: int = 0) -> None:
        """Apply faults from now on. The robots are nominal as they are now.

        Args:
            bodies: Bodies of the robots.
            frame: Number of frames so far.
        """
        self._fault_effects = None
        if any(row.faults for row in self._rows):
            self._fault_effects = FaultEffects(self._rows, self, bodies, frame)

    def change_rows(self, rows: Sequence[Row]) -> None:
        """Change settings and faults of driving robots from the next frame on.

        `omni_mj.simulation.changeable_simulation` lists the settings that must stay. Another
        charge at the start becomes the present one.

        Args:
            rows: The rows, with other settings.
        """
        previous_rows, self._rows = self._rows, rows
        self._disturbances.change_amplitudes(rows)
        state = self.electronics
        frame = int(state.cycle) // CYCLES_PER_FRAME
        parameters, fresh = self._make_electronics(state.firmware.heading)
        charges = (gather(group, "settings.battery.charge") for group in (previous_rows, rows))
        self.electronics = state._replace(
            firmware=extend_memory(state.firmware, fresh.firmware, frame),
            battery=select(np.not_equal(*charges), fresh.battery, state.battery),
        )
        self._nominal_carpet = self._make_carpet()
        self._start_faults(self._change_parameters(parameters), frame)

    @abstractmethod
    def _change_parameters(self, electronics: ElectronicsParameters) -> ChangeableBodies:
        """Set the parameters without faults for changed settings, and return the bodies."""

    def set_motor_currents(self, current: Array) -> None:
        """Let drivers hold currents from the next frame on, in place of the firmware's commands.

        Args:
            current: Motor currents, (n, W) A; NaN where the firmware drives. The battery's voltage
                limits them. With 0 A a robot coasts.
        """
        self._current_setpoint = None if np.isnan(current).all() else np.array(current, float).T

    def _make_command(self, received: ReceivedCommand) -> FirmwareCommand:
        """Return the received command as arrays for the firmware."""
        wheel_speeds = None
        if received.rim_speeds is not None:
            assert self.geometry is not None
            wheel_speeds = received.rim_speeds.T / self.geometry.radius
        velocity = np.array(received.command, float).T
        is_new = np.ones(len(self._rows), bool) if received.is_new is None else received.is_new
        return FirmwareCommand(velocity, is_new, received.in_body_frame, wheel_speeds)

    def _make_inputs(self, vision_heading: Array, heading_age: np.ndarray) -> FrameInputs:
        """Return the inputs of the next frame, with disturbances and faults.

        Args:
            vision_heading: Headings that arrived from vision, (n,) rad; NaN where none arrived.
            heading_age: Frames since these headings were sent, (n,).
        """
        push_force = self._disturbances.draw_push_force()
        fault_gyro_bias: float | Array = 0.0
        current_setpoint = self._current_setpoint
        fault_inputs = {"battery_voltage_factor": np.ones(len(self._rows))}
        if self._fault_effects is not None:
            faults = self._fault_effects
            faults.begin_frame(self._dropout_noise.next().T)
            push_force = push_force + faults.push_force
            fault_gyro_bias = faults.gyro_bias
            fault_inputs = faults.inputs
            current_setpoint = np.where(
                np.isnan(faults.current_setpoint),
                np.nan if current_setpoint is None else current_setpoint,
                faults.current_setpoint,
            )
        push_force = np.where(self._failed[:, None], 0.0, push_force)
        return FrameInputs(
            vision_heading=vision_heading,
            heading_age=heading_age,
            gyro_error=self._disturbances.draw_gyro_error(fault_gyro_bias),
            push_force=push_force.T,
            current_setpoint=current_setpoint,
            has_failed=self._failed if self._failed.any() else None,
            **fault_inputs,
        )
