"""The control loop with external robots: measured by SSL-Vision and commanded by radio."""

import math
from collections.abc import Callable, Sequence

import numpy as np

from omni_control.controllers.base import Observation
from omni_control.errors import OmniError
from omni_control.kinematics import Array, Kinematics, compute_pose_error
from omni_mj.config import FRAME_RATE_HZ, PERIOD_S
from omni_mj.config.rows import Row
from omni_mj.config.scenario import Scenario
from omni_mj.live.frame_clock import LOST_S, SILENT_S, FrameClock
from omni_mj.live.team_radio import TeamRadio, VelocityCommand
from omni_mj.network.radio import ReceivedCommand
from omni_mj.plants import Plant
from omni_mj.plants.telemetry import Telemetry
from omni_mj.simulation.log import Log
from omni_mj.simulation.simulation import CameraModel, RadioModel, Simulation

SILENT_FRAMES, LOST_FRAMES = round(SILENT_S * FRAME_RATE_HZ), round(LOST_S * FRAME_RATE_HZ)
MEMORY_FRAMES = 64  # number of stored turn rates, which exceeds the longest latency


class LivePlant:
    """External robots in place of a plant and its camera.

    Args:
        rows: One per robot.
        start: Initial poses, shape (n, 3), m and rad.
        driven: Whether `Live` drives the robots.

    Attributes:
        measured: Poses measured by vision, shape (n, 3), NaN for robots that were not detected.
        measurement_age: Ages of the measurements, shape (n,), s.
        unseen: Number of frames since each robot was last detected, shape (n,).

    Raises:
        OmniError: The plant is used outside of `omni-mj drive`.
    """

    def __init__(self, rows: Sequence[Row], start: Array, *, driven: bool = False) -> None:
        if not driven:
            raise OmniError("the plant 'live' stands for external robots; use omni-mj drive")
        self.geometry: Kinematics | None = rows[0].settings.wheels.kinematics
        self._start = start
        self.measured = np.array(start)
        self.measurement_age = np.zeros(len(rows))
        self.unseen = np.zeros(len(rows), int)
        self._telemetry = Telemetry.without_wheels(len(rows), len(self.geometry.azimuths))

    def __call__(self, pose: Array) -> tuple[Array, Array]:
        """Return measured poses and their ages; see `CameraModel`."""
        return self.measured.copy(), self.measurement_age

    def pose(self) -> Array:
        """Return the initial poses, because the true ones are unknown."""
        return self._start

    def twist(self) -> Array:
        """Return NaN: velocities are unknown."""
        return np.full_like(self._start, np.nan)

    def advance(self, received: ReceivedCommand) -> dict[int, str]:
        """Return a mapping from the row of each robot that vision has just lost to the reason."""
        self.unseen = np.where(np.isnan(self.measured[:, 0]), self.unseen + 1, 0)
        return {
            int(row): f"was not detected for {LOST_S:g} s"
            for row in np.flatnonzero(self.unseen == LOST_FRAMES)
        }

    def telemetry(self) -> Telemetry:
        """Return NaN: the state of the wheels is unknown."""
        return self._telemetry


class Live(Simulation):
    """The loop of `Simulation` with external robots.

    A robot that vision no longer detects gets a command to stop after 0.5 s, and fails after 3 s.

    Args:
        scenario: Scenario with the plant "live".
        frame_clock: Source of vision packets and frames. Its `vision.ids` are the numbers of the
            robots, one per row.
        radio: Sender of the commands.
        max_frames: Number of frames after which the run ends. Default: the end of its references.

    Attributes:
        measurements: Of each frame, the poses that the outlier gate accepts, (n, 3), and their
            ages, (n,) s.

    Raises:
        OmniError: See `Simulation`.
    """

    has_true_poses = False
    measurements: list[tuple[Array, Array]]
    _sent: Array
    _turn_rates: Array  # newest first
    _commands: Sequence[VelocityCommand]

    def __init__(
        self,
        scenario: Scenario,
        frame_clock: FrameClock,
        radio: TeamRadio,
        max_frames: float = math.inf,
    ) -> None:
        self.frame_clock, self.ids = frame_clock, frame_clock.vision.ids
        self.messages = frame_clock.vision.messages
        self._radio, self._max_frames = radio, max_frames
        super().__init__(scenario)

    @property
    def done(self) -> bool:
        """See `Simulation`."""
        return super().done or self.frame >= self._max_frames

    def run(self, after_frame: Callable[[int], None] = lambda frame: None) -> Log:
        """See `Simulation`. At the end, also after an exception, robots get a command to stop."""
        try:
            return super().run(after_frame)
        finally:
            self.stop()

    def step(self, command: Array | None = None) -> None:
        """See `Simulation`.

        Skipped frames are recorded without a measurement and with the last command that was sent.
        """
        latency, alpha = self.team.latency_hat[:, 2], self.team.alpha_hat[:, 2]
        self._turn_latency = np.where(np.isfinite(latency), latency, self._nominal_latency)
        self._turn_alpha = np.where(np.isfinite(alpha), alpha, 1.0)
        measured, age, skipped = self.frame_clock.wait_for_frame(
            self.team.estimate, self.stop, self._transmit
        )
        self._is_past = True
        self._plant.measured = np.full_like(measured, np.nan)
        for _ in range(skipped):
            super().step(self._sent)
        self._is_past = False
        self._plant.measured = measured
        self._plant.measurement_age = age
        super().step(command)

    def exchange(self, command: Array, heading: Array) -> ReceivedCommand:
        """Send commands, shape (n, 3), to robots with estimated headings, shape (n,).

        A command includes the heading predicted for the middle of the frame in which it acts.
        """
        if (is_unseen := self._plant.unseen > SILENT_FRAMES).any():
            command = np.where(is_unseen[:, None], 0.0, command)
            self.team.last_command = command
        # Fraction of each stored turn rate that has not acted yet
        in_flight = np.clip(self._turn_latency - np.arange(MEMORY_FRAMES)[:, None], 0.0, 1.0)
        turn = (in_flight * self._turn_rates).sum(0) + command[:, 2] / 2
        headings = heading + self._turn_alpha * turn * PERIOD_S
        self._turn_rates = np.vstack([command[:, 2], self._turn_rates[:-1]])
        self._sent = command
        if not self._is_past:
            columns = np.column_stack([command, headings]).tolist()
            self._commands = [
                VelocityCommand(number, *values)
                for number, values in zip(self.ids, columns, strict=True)
            ]
            self._transmit()
        return ReceivedCommand(command, heading, np.zeros(len(command), int))

    def stop(self) -> None:
        """Command all robots to stop, three times because packets may be lost."""
        self._sent = np.zeros_like(self._sent)
        self._commands = [VelocityCommand(number, 0.0, 0.0, 0.0, 0.0) for number in self.ids]
        for _ in range(3):
            self._transmit()

    def _transmit(self) -> None:
        """Send the newest commands."""
        self.frame_clock.begin_command()
        self._radio.send(self._commands)

    def _build_plant_and_link(self, start_poses: Array) -> tuple[Plant, CameraModel, RadioModel]:
        self._plant = LivePlant(self.rows, start_poses, driven=True)
        settings = [row.settings for row in self.rows]
        latency = [
            robot.radio.mean_delay_frames + FRAME_RATE_HZ * robot.control.assumed_lag_s
            for robot in settings
        ]
        self._nominal_latency = np.array(latency)
        self._sent = np.zeros_like(start_poses)
        self.measurements = []
        self._turn_rates = np.zeros((MEMORY_FRAMES, len(start_poses)))
        self.frame_clock.restart()
        return self._plant, self._plant, self

    def observe(self) -> Observation:
        """See `Simulation`. The estimated pose is recorded in place of the unknown true pose."""
        if self._observation is None:
            observation = super().observe()
            measurement = observation.measured_pose, self._plant.measurement_age
            self.measurements.append(measurement)
            difference = compute_pose_error(observation.extrapolated_pose, self.team.estimate)
            self._pose = self.team.estimate + np.nan_to_num(difference)
        return super().observe()
