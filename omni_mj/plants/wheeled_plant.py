"""What plants with wheels share: parameters and state of their robots, chance, faults, held currents."""

from collections.abc import Sequence

import numpy as np

from omni_control.kinematics import Array, Kinematics
from omni_mj.config.rows import Row
from omni_mj.network.radio import ReceivedCommand, compute_max_delay_frames
from omni_mj.plants import Telemetry
from omni_mj.plants.domain_randomization import Chance, Drawn
from omni_mj.plants.fault_effects import Faults, Faulty
from omni_mj.robot.firmware import Command
from omni_mj.robot.onboard import (
    CycleRecord,
    FrameInputs,
    OnboardParameters,
    OnboardState,
    onboard,
    telemetry_rows,
)


class WheeledPlant:
    """Robots with roller wheels on carpet, driven by their firmware.

    Attributes:
        geometry: Of the wheels, as they are when new.
        drawn: What the robots' seeds drew for them.
    """

    geometry: Kinematics | None
    # For which robots remember their headings at least; vision may be that late
    remembered_frames = 0

    def __init__(
        self, rows: Sequence[Row], kinematics: Kinematics, drawn: Drawn, heading: Array
    ) -> None:
        self.geometry, self.drawn, self._rows = kinematics, drawn, rows
        self._chance = Chance(rows)
        self._held: Array | None = None
        self._faults: Faults | None = None
        none = np.zeros((1, *drawn.strength.T.shape))
        self._record = CycleRecord(
            none, none, none, none, none[:, 0], none[:, 0]
        )  # of the frame just past
        frames = (
            max(
                *(compute_max_delay_frames(row.settings.radio, row.settings.fault) for row in rows),
                self.remembered_frames,
            )
            + 1
        )
        self._onboard: tuple[OnboardParameters, OnboardState] = onboard(
            [row.settings for row in rows],
            kinematics,
            heading,
            by_wheel(drawn.strength),
            (frames, any(row.faults for row in rows)),
        )

    def _start_faults(self, bodies: Faulty) -> None:
        """Let faults act on robots as they are now."""
        if any(row.faults for row in self._rows):
            self._faults = Faults(self._rows, self, bodies)

    def hold(self, current: Array | None) -> None:
        """Have drivers hold currents from the next frame on, whatever the firmware commands.

        Args:
            current: (n, wheels) A, as far as the battery's voltage drives it; NaN where the
                firmware drives. None for all. With none, a robot rolls out.
        """
        self._held = (
            None if current is None or np.isnan(current).all() else np.array(current, float).T
        )

    def _command(self, received: ReceivedCommand) -> Command:
        n = len(self._rows)
        wheels = None
        if received.rim_speeds is not None:
            assert self.geometry is not None
            wheels = received.rim_speeds.T / self.geometry.radius
        x, y, turn = np.array(received.command, float).T
        is_new = np.ones(n, bool) if received.is_new is None else received.is_new
        return Command(x, y, turn, is_new, received.in_body_frame, wheels)

    def _inputs(self, seen_heading: Array, age: np.ndarray, stopped: np.ndarray) -> FrameInputs:
        """Return what acts in the next frame; nothing pushes robots that were `stopped` (n,)."""
        push, gyro_bias, held, extra = self._chance.push(), self._chance.gyro_bias, self._held, {}
        if self._faults is not None:
            faults = self._faults
            faults.begin()
            push, gyro_bias, extra = push + faults.push, gyro_bias + faults.gyro_bias, faults.inputs
            off = faults.off_current
            held = off if held is None else np.where(np.isnan(off), held, off)
        push = np.where(stopped[:, None], 0.0, push)
        inputs = FrameInputs(
            seen_heading=seen_heading,
            age=np.asarray(age),
            gyro_error=self._chance.gyro_error(gyro_bias),
            push_x=push[:, 0],
            push_y=push[:, 1],
            power_share=np.ones(len(self._rows)),
            held_current=held,
            is_stopped=stopped if stopped.any() else None,
        )
        return inputs._replace(**extra)

    def _telemetry(self, state: OnboardState, angle: Array, speed: Array, slip: Array) -> Telemetry:
        """Return telemetry of the frame just past, or at the start, from angles, speeds and slips (W, n)."""
        return Telemetry(telemetry_rows(state, self._record, angle, speed, slip).T)


def by_wheel(values: Array) -> Array:
    """Return a contiguous copy of (n, W) as (W, n)."""
    return np.array(values.T, order="C")
