"""Base class of controllers, the team's model of its robots, and the observation of a frame.

Once per frame a controller gets an `Observation` of its robots and returns new commands in the
world frame (figure 4 of the paper). The `TeamModel` is known in advance.
"""

import inspect
import math
import traceback
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from omni_control.arguments import explain_types, fits_annotation
from omni_control.delay_compensation import CommandHistory, predict_displacement
from omni_control.errors import OmniError, format_value, to_printable
from omni_control.estimation.delayed_measurements import FilterStep
from omni_control.kinematics import Array, Kinematics, wrap_angle
from omni_control.reference import MotionLimits, Reference

# Attributes of every controller that are recorded, shape (n, 3).
RECORDED_ATTRIBUTES = ("predicted_pose", "alpha_hat", "latency_hat")
# Limits of the league's simulators (ssl-simulation-setup).
COMMAND_LIMITS = MotionLimits(3.7, 4.7, 26.0, 50.8)
_POSITIVE_FIELDS = ("period", "alpha", "alpha_window_frames")
_INTEGER_FIELDS = ("alpha_window_frames",)


@explain_types
@dataclass(frozen=True)
class TeamModel:
    """The team's knowledge of its robots and of the control loop.

    It is hashable: robots with equal models can share a controller.

    Args:
        period: Length of a frame T, s.
        delay_frames: Nominal dead time k_d from command to robot, frames; need not be an integer.
        lag_s: Time constant of the robots' wheel loops, s; 0: unknown.
        position_noise_m, heading_noise_rad: Standard deviation of a vision measurement, per axis.
        friction_loss_m_s: Speed that a robot loses to dry friction, m/s; 0: unknown.
        creep_s2_m: Creep of the wheels per forward acceleration, relative to the speed, s^2/m;
            0: unknown.
        creep_sideways_s2_m: Same for sideways acceleration, s^2/m. Default: computed from
            `creep_s2_m` and the directions of the wheels.
        friction: Coefficient of friction of the carpet, at which wheels slide; 0: they do not, and
            their rubber does not soften.
        alpha: Motor correction factors, the steady ratio of achieved to commanded velocity, forward
            and sideways. If they are given, filters also assume smaller uncertainties of lag,
            friction and creep. Default: unknown, 0.7 to 1.
        error_range_m, speed_range_m_s: Ranges of the fuzzy controller, m and m/s.
        heading_gain: Turn rate per heading error of the heading control, 1/s.
        alpha_window_frames: Window of the estimate of alpha (equation 8), frames.
        geometry: Geometry of the wheels; None: unknown.
        limits: Limits of commands, translation and rotation. Default: the league simulators'.

    Raises:
        OmniError: A time, a noise or a number of frames is out of range. One line per error.
    """

    period: float
    delay_frames: float
    lag_s: float = 0.02
    position_noise_m: float = 0.0013
    heading_noise_rad: float = 0.01
    friction_loss_m_s: float = 0.04
    creep_s2_m: float = 0.05
    creep_sideways_s2_m: float | None = None
    friction: float = 0.8
    alpha: tuple[float, float] | None = None
    error_range_m: float = 0.1
    speed_range_m_s: float = 1.0
    heading_gain: float = 3.0
    alpha_window_frames: int = 15
    geometry: Kinematics | None = None
    limits: MotionLimits = COMMAND_LIMITS

    def __post_init__(self) -> None:
        """Check all numbers. `FuzzyLaw` also checks the ranges of the fuzzy controller."""
        errors = []
        alpha = [] if self.alpha is None else self.alpha
        for name, value in [*vars(self).items(), *(("alpha", value) for value in alpha)]:
            if value is None or isinstance(value, tuple | Kinematics | MotionLimits):
                continue
            is_positive, is_integer = name in _POSITIVE_FIELDS, name in _INTEGER_FIELDS
            is_number = fits_annotation(value, float)
            in_range = is_number and (value > 0 if is_positive else value >= 0) and value < math.inf
            if not in_range or (is_integer and value % 1):
                kind = "a whole number" if is_integer else "a number"
                minimum = "above 0" if is_positive else "from 0"
                errors.append(f"{name} must be {kind} {minimum}, got {format_value(value)}")
        if errors:
            raise OmniError("\n".join(errors))
        if self.delay_frames % 1 == 0:
            object.__setattr__(self, "delay_frames", int(self.delay_frames))

    @property
    def latency_frames(self) -> float:
        """Mean time from a command to its effect: dead time plus lag of the wheel loops, frames."""
        return self.delay_frames + self.lag_s / self.period

    @property
    def vision_noise(self) -> tuple[float, float, float]:
        """Standard deviation of a vision measurement [x, y, heading], m and rad."""
        return self.position_noise_m, self.position_noise_m, self.heading_noise_rad


@dataclass(frozen=True)
class Observation:
    """State of n robots in a frame as far as the team knows it, world frame.

    Headings are unwrapped (continuous, not limited to (-pi, pi]), except those of vision.

    Args:
        pose: Estimated present [x, y, heading], (n, 3).
        twist: Estimated present [vx, vy, w], (n, 3).
        measured_pose: Pose that vision reported in this frame, (n, 3), heading in (-pi, pi]; NaN
            if the robot was not detected.
        sent_commands: Commands sent in earlier frames, after the limits; read-only.
        period: Length of a frame T, s.
        delay_frames: Nominal dead time k_d, frames; one for all robots, or (n,).
        measurement_age: Age of the measurements at the start of this frame, (n,) s. Default: 0.
        filter_steps: Steps by which a filter processes the measurements of this frame, which may
            be delayed. Default: one step to this frame.
    """

    pose: Array
    twist: Array
    measured_pose: Array
    sent_commands: CommandHistory
    period: float
    delay_frames: float | Array
    measurement_age: Array | None = None
    filter_steps: tuple[FilterStep, ...] = ()

    def select(
        self, rows: NDArray[np.intp], n_commands: int, delay_frames: float | Array
    ) -> "Observation":
        """Return a copy for some robots, with their dead time and their latest sent commands."""
        return Observation(
            self.pose[rows],
            self.twist[rows],
            self.measured_pose[rows],
            self.sent_commands.select(rows, n_commands),
            self.period,
            delay_frames,
            None if self.measurement_age is None else self.measurement_age[rows],
            tuple(step.select(rows) for step in self.filter_steps),
        )

    @property
    def extrapolated_pose(self) -> Array:
        """Measured pose, extrapolated to this frame with the filtered twist, (n, 3)."""
        if self.measurement_age is None or not np.count_nonzero(self.measurement_age):
            return self.measured_pose
        pose = self.measured_pose + self.measurement_age[:, None] * self.twist
        pose[:, 2] = wrap_angle(pose[:, 2])
        return pose

    @property
    def commands_in_flight(self) -> Array:
        """Commands that have not acted yet, (k_d, n, 3), oldest first, m/s and rad/s.

        If dead times differ, k_d is the longest. Commands that have already acted on a robot are
        zero. If k_d is not an integer, it is rounded up, and the oldest command is multiplied by
        the fraction of a frame for which it still acts.
        """
        delay_frames = np.reshape(self.delay_frames, (-1, 1))
        max_delay = math.ceil(delay_frames.max())
        pending = self.sent_commands.get_pending_fractions(delay_frames, max_delay)
        return pending * self.sent_commands.get_latest(max_delay)

    @property
    def predicted_pose(self) -> Array:
        """Pose (n, 3) predicted at the end of the dead time for alpha = 1 (equation 11)."""
        return self.pose + predict_displacement(self.commands_in_flight, 1.0, self.period)


class Controller:
    """Controller of n robots. Derive from it and write `command`.

    Annotated class attributes that hold a number, a string or a bool are parameters:

        class Mine(Controller):
            gain: float = 3.0  # 1/s

    `make_controller` sets them before it calls the constructor.

    Args:
        model: The team's knowledge of the robots and the loop.
        reference: Desired poses of the robots.
        n: Number of robots.

    Attributes:
        predicted_pose: Pose (n, 3) for which the latest command was computed: the present one, or
            that predicted for the end of the dead time or of the latency, as the controller
            chooses; NaN before the first command; recorded.
        alpha_hat: Estimates of alpha in the latest frame, forward, sideways and turning, (n, 3); 1
            without an estimate; recorded. Those of equation 8 are along the axes of the world.
        latency_hat: Estimates of the latency in the latest frame, forward, sideways and turning,
            (n, 3), frames; NaN without an estimate; recorded.
        channels: Further values to record in each frame, by name: (n,) or (n, k).
        memory_frames: Number of commands in `observation.sent_commands`. A constructor may
            increase it.
        knows_truth: Whether the controller observes the true pose and twist instead of vision.
    """

    knows_truth: ClassVar[bool] = False

    @explain_types
    def __init__(self, model: TeamModel, reference: Reference, n: int) -> None:
        self.model, self.reference = model, reference
        self.predicted_pose = np.full((n, 3), np.nan)
        self.alpha_hat = np.ones((n, 3))
        self.latency_hat = np.full((n, 3), np.nan)
        self.channels: dict[str, Array] = {}
        self.memory_frames = math.ceil(model.latency_frames) + 1

    def command(self, frame: int, observation: Observation) -> Array:
        """Return commands [vx, vy, w] (n, 3), world frame, m/s and rad/s.

        The command of a robot must not depend on the other robots of the batch.

        Args:
            frame: Frame number k, from 0.
            observation: State of the robots in frame k. Its arrays are copies or read-only.
        """
        raise NotImplementedError


def collect_channels(controller: Controller, n: int) -> dict[str, Array]:
    """Return the values that a controller of n robots records in this frame, (n, k) by name.

    Raises:
        OmniError: A value has a wrong shape.
    """
    values = {name: getattr(controller, name) for name in RECORDED_ATTRIBUTES}
    channels = {
        name: np.asarray(value, float) for name, value in (values | controller.channels).items()
    }
    for name, value in channels.items():
        if name in RECORDED_ATTRIBUTES and value.shape != (n, 3):
            raise OmniError(f"{name} must have the shape {(n, 3)}, got {value.shape}")
        if value.ndim not in (1, 2) or len(value) != n:
            raise OmniError(
                f"channel {name!r} must have the shape ({n},) or ({n}, k), got {value.shape}"
            )
        channels[name] = value.reshape(n, -1)
    return channels


def describe_error(failing_class: type, error: BaseException) -> str:
    """Return ' (FILE, line N): TYPE: MESSAGE' for an exception raised in the file of a class."""
    try:
        file = inspect.getfile(failing_class)
    except (TypeError, OSError):  # a class without a file
        file = ""
    frames = [f for f in traceback.extract_tb(error.__traceback__) if f.filename == file]
    location = f" ({Path(file).name}, line {frames[-1].lineno})" if frames else ""
    name = "" if isinstance(error, OmniError) else f"{type(error).__name__}: "
    return f"{location}: {name}{to_printable(str(error))}"
