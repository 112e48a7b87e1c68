"""What drives robots: what it is told once, what it sees in each frame, and the class to derive from.

A controller is called once a frame with what is known of its robots and the commands that were sent before (after the
limits), and returns new commands in the world frame (figure 4 of the paper).
"""

import inspect
import math
import traceback
from dataclasses import dataclass, field
from pathlib import Path
from typing import ClassVar

import numpy as np

from omni_control.delay_compensation import CommandHistory, Rows, predict_displacement
from omni_control.errors import OmniError, to_printable
from omni_control.estimation.delayed_measurements import FilterStep
from omni_control.kinematics import Array, Kinematics, wrap_angle
from omni_control.reference import MotionLimits, Reference

RECORDED = ("predicted_pose", "alpha_hat", "latency_hat")
COMMAND_LIMITS = MotionLimits(
    3.7, 4.7, 26.0, 50.8
)  # of the league's simulators (ssl-simulation-setup)


@dataclass(frozen=True)
class TeamModel:
    """What every controller is told; hashable, so that robots of which the same is told can share a controller.

    Args:
        period: length of a frame T, s.
        delay_frames: dead time k_d from command to robot, frames; as far as the team knows it.
        lag_s: time constant of the robots' wheel loops, s; zero: unknown.
        position_noise_m, heading_noise_rad: standard deviation of what vision sees, per axis.
        drag_m_s: what dry friction may cost the robots of their speed, m/s; zero: unknown.
        creep_s2_m: how much of their speed wheels creep per acceleration, forward, s^2/m; zero:
            unknown.
        creep_sideways_s2_m: the same sideways. [as the wheels' directions make it of that]
        alpha: what robots reach of a command ahead and aside when they drive steadily: motor
            correction factors. Who knows them knows lag, drag and creep of these robots well too.
            [not known: 0.7 to 1]
        error_range_m, speed_range_m_s: ranges of the fuzzy controller, m and m/s.
        heading_gain: turn rate per heading error of the heading hold, 1/s.
        alpha_window_frames: window of the estimate of alpha (equation 8), frames.
        geometry: of the wheels, or None where nobody said.
        limits: of what may be commanded, translation and turning; the defaults are the league
            simulators'.

    Raises:
        OmniError: a time, a noise or a number of frames that cannot be; all that are wrong, one
            line each.
    """

    period: float
    delay_frames: int
    lag_s: float = 0.02
    position_noise_m: float = 0.0013
    heading_noise_rad: float = 0.01
    drag_m_s: float = 0.04
    creep_s2_m: float = 0.05
    creep_sideways_s2_m: float | None = None
    alpha: tuple[float, float] | None = None
    error_range_m: float = 0.1
    speed_range_m_s: float = 1.0
    heading_gain: float = 3.0
    alpha_window_frames: int = 15
    geometry: Kinematics | None = None
    limits: MotionLimits = field(default=COMMAND_LIMITS)

    def __post_init__(self) -> None:
        """Check the numbers; those of the fuzzy controller are checked where it is made."""
        given = [
            (name, value)
            for name, value in vars(self).items()
            if isinstance(value, int | float | np.integer)
        ]
        given += [("alpha", value) for value in self.alpha or ()]
        positive, whole = (
            ("period", "alpha", "alpha_window_frames"),
            ("delay_frames", "alpha_window_frames"),
        )
        wrong = [
            f"{name} must be a {'whole ' * (name in whole)}number {'above' if name in positive else 'from'} 0: {value}"
            for name, value in given
            if not 0 <= value < math.inf
            or (name in positive and not value)
            or (name in whole and value % 1)
        ]
        if wrong:
            raise OmniError("\n".join(wrong))

    @property
    def latency_frames(self) -> float:
        """Time from a command to its effect, on average: the dead time and the wheel loops' lag, frames."""
        return self.delay_frames + self.lag_s / self.period

    @property
    def vision_noise(self) -> tuple[float, float, float]:
        """Standard deviation of what vision sees, per axis of a pose, m and rad."""
        return self.position_noise_m, self.position_noise_m, self.heading_noise_rad


@dataclass(frozen=True)
class Observation:
    """What is known of n robots in a frame, world frame; headings count full turns.

    Args:
        pose: filtered [x, y, heading], (n, 3).
        twist: filtered [vx, vy, w], (n, 3).
        measured_pose: the pose that vision reported in this frame, (n, 3), its heading in (-pi,
            pi]; not a number where a robot was not seen.
        sent_commands: the last commands that were sent, within the limits, the newest in the frame
            before; to be read only.
        period: length of a frame T, s.
        delay_frames: dead time k_d as far as the team knows it, frames: one for all robots, or one
            each (n,).
        measurement_age: for how long robots had been where they were seen when the frame began,
            (n,) s. [not at all]
        filter_steps: those of filters, which are behind the present by that. [one, to this frame]
    """

    pose: Array
    twist: Array
    measured_pose: Array
    sent_commands: CommandHistory
    period: float
    delay_frames: int | Array
    measurement_age: Array | None = None
    filter_steps: tuple[FilterStep, ...] = ()

    def select(self, rows: Rows, memory: int, delay_frames: int | Array) -> "Observation":
        """The same of some robots with that dead time and so many commands, in arrays of its own."""
        return Observation(
            self.pose[rows].copy(),
            self.twist[rows].copy(),
            self.measured_pose[rows].copy(),
            self.sent_commands.select(rows, memory),
            self.period,
            delay_frames,
            None if self.measurement_age is None else self.measurement_age[rows],
            tuple(step.select(rows) for step in self.filter_steps),
        )

    @property
    def extrapolated_pose(self) -> Array:
        """What was measured, brought from when it was seen to this frame by the filtered twist, (n, 3)."""
        if self.measurement_age is None or not np.count_nonzero(self.measurement_age):
            return self.measured_pose
        brought = self.measured_pose + self.measurement_age[:, None] * self.twist
        brought[:, 2] = wrap_angle(brought[:, 2])
        return brought

    @property
    def commands_in_flight(self) -> Array:
        """Commands that were sent and have not acted yet, (k_d, n, 3), oldest first, m/s and rad/s.

        Where dead times differ, the longest counts, and a command that has acted on a robot by then
        is zero.
        """
        if not isinstance(self.delay_frames, np.ndarray):
            return self.sent_commands.get_latest(self.delay_frames)
        longest = int(self.delay_frames.max())
        return self.sent_commands.get_pending_fractions(
            self.delay_frames[:, None], longest
        ) * self.sent_commands.get_latest(longest)

    @property
    def predicted_pose(self) -> Array:
        """Poses (n, 3) to which the commands in flight lead by the end of the dead time (equation 11), alpha = 1."""
        return self.pose + predict_displacement(self.commands_in_flight, 1.0, self.period)


class Controller:
    """A controller of n robots; derive from it and write `command`.

    Annotated class attributes with a number, a string, or True or False as their value are its
    parameters:

        class Mine(Controller):
            gain: float = 3.0  # 1/s

    They can be set from outside (`controllers.make`), which is done before the constructor runs.

    Args:
        told: what is known of the loop.
        reference: where the robots should be.
        n: robots.

    Attributes:
        predicted_pose: pose (n, 3) for which the last command was computed, for the record.
        alpha_hat: estimated motor correction factors (n, 3), for the record; 1 for a controller
            that estimates none.
        latency_hat: estimated time from a command to its effect forward, to the left and turning
            (n, 3), frames, for the record; not a number for a controller that estimates none.
        channels: what else is to be recorded of each frame, by name: numbers (n,) or (n, k).
        memory_frames: how many of the commands sent `observation.sent_commands` holds; one that
            needs more says so in its constructor.
        knows_truth: whether it sees the true pose and twist instead of filtered vision.
    """

    knows_truth: ClassVar[bool] = False

    def __init__(self, model: TeamModel, reference: Reference, n: int) -> None:
        self.model, self.reference = model, reference
        self.predicted_pose = np.full((n, 3), np.nan)
        self.alpha_hat = np.ones((n, 3))
        self.latency_hat = np.full((n, 3), np.nan)
        self.channels: dict[str, Array] = {}
        self.memory_frames = math.ceil(model.latency_frames) + 1

    def command(self, frame: int, observation: Observation) -> Array:
        """Return commands [vx, vy, w] (n, 3), world frame, m/s and rad/s.

        A robot's command must not depend on the other robots of the batch.

        Args:
            frame: k, from 0.
            observation: what is known of the robots in frame k; its arrays are the controller's
                own, or can only be read.
        """
        raise NotImplementedError


def collect_channels(controller: Controller, n: int) -> dict[str, Array]:
    """Return what a controller of n robots records in this frame: (n, k) by name."""
    values = {name: getattr(controller, name) for name in RECORDED} | controller.channels
    record = {name: np.asarray(value, float) for name, value in values.items()}
    for name, value in record.items():
        if name in RECORDED and value.shape != (n, 3):
            raise OmniError(f"{name} has the shape {value.shape}; {(n, 3)} is needed")
        if value.ndim not in (1, 2) or len(value) != n:
            raise OmniError(
                f"channel {name!r} has the shape {value.shape}; ({n},) or ({n}, k) is needed"
            )
        record[name] = value.reshape(n, -1)
    return record


def describe_error(kind: type, error: Exception) -> str:
    """Return where in the file of a class an exception was raised, and what it says."""
    try:
        file = inspect.getfile(kind)
    except (TypeError, OSError):  # made without a file
        file = ""
    frames = [f for f in traceback.extract_tb(error.__traceback__) if f.filename == file]
    place = f" ({Path(file).name}, line {frames[-1].lineno})" if frames else ""
    name = "" if isinstance(error, OmniError) else f"{type(error).__name__}: "
    return f"{place}: {name}{to_printable(str(error))}"
