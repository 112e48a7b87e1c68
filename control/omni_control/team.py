"""A team's computer: vision in, commands out; filter, controllers, limits (figure 4 of the paper).

    team = Team(controllers, start)
    while True:
        command = team.step(measured)  # the same as team.observe(measured), then team.command()

The simulated loop runs the same.
"""

import math
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from omni_control.controllers.base import (
    RECORDED,
    Controller,
    Observation,
    collect_channels,
    describe_error,
)
from omni_control.delay_compensation import CommandHistory, Rows
from omni_control.errors import ControllerError, OmniError
from omni_control.estimation.delayed_measurements import MAX_FRAMES_BEHIND
from omni_control.estimation.outlier_gate import OutlierGate
from omni_control.estimation.vision_tracker import VisionTracker
from omni_control.kinematics import Array
from omni_control.reference import MotionLimits

OnFailure = Callable[[NDArray[np.intp], ControllerError], None]


class CommandLimiter:
    """Limits on velocity commands and their change per frame, by the norm of translation and by turn.

    Args:
        limits: those of each of n robots.
        period: length of a frame T, s.
    """

    def __init__(self, limits: Sequence[MotionLimits], period: float) -> None:
        speed, turn_rate, acceleration, turn_acceleration = np.array(
            [[s.speed, s.turn_rate, s.acceleration, s.turn_acceleration] for s in limits]
        ).T[..., None]
        self._highest, self._step = (
            (speed, turn_rate),
            (acceleration * period, turn_acceleration * period),
        )

    def __call__(self, command: Array, last: Array) -> Array:
        """Return the commands (n, 3) that may be sent, given those wanted and those sent before."""
        return last + _clip(_clip(command, *self._highest) - last, *self._step)


def _clip(vector: Array, size: Array, turn: Array) -> Array:
    """Return vectors (n, 3) whose translation and turn are at most as large as limits (n, 1)."""
    clipped = np.minimum(np.maximum(vector, -turn), turn)
    norm = np.hypot(vector[:, :1], vector[:, 1:2])
    clipped[:, :2] = vector[:, :2] * (size / np.maximum(norm, size))
    return clipped


class Team:
    """n robots under one or more controllers; what is known of a robot is what its controller was told.

    Args:
        controllers: one, or several with robots of their own.
        start: poses at the start (n, 3), m, m, rad; headings count full turns from there.
        rows: the numbers of the robots of each controller; one after the other, if none are given.
        on_failure: called with the rows that failed and the reason, when a controller fails. They
            are sent zero from then on, and the others go on. Without it, the reason is raised.

    Attributes:
        n: robots.
        frame: k, that of the last observation; -1 before the first.
        filter: of vision, of all robots.
        estimate, twist: filtered poses and twists (n, 3), to be read only.
        failed: which rows have failed or were stopped, (n,).
        knows_truth: whether one of the controllers does, which must then be told.
        last: the commands that were sent last, (n, 3); zero at first. To be set where others were
            sent.

    Raises:
        OmniError: no controller, frames of different lengths, a start that is not (n, 3) finite
            numbers, or robots that have no controller, or two.
    """

    def __init__(
        self,
        controllers: Controller | Sequence[Controller],
        start_poses: ArrayLike,
        rows: Sequence[ArrayLike] | None = None,
        *,
        on_failure: OnFailure | None = None,
    ) -> None:
        self.controllers = (
            [controllers] if isinstance(controllers, Controller) else list(controllers)
        )
        pose = np.array(start_poses, float)
        if pose.ndim != 2 or pose.shape[1] != 3 or not np.isfinite(pose).all():
            raise OmniError(f"the start must be finite poses (n, 3), not of shape {pose.shape}")
        self.n, self.frame, self.estimate = len(pose), -1, pose
        self._sizes = [len(c.predicted_pose) for c in self.controllers]
        self._rows = _rows_of_controllers(self._sizes, rows, self.n)
        self._on_failure = on_failure

        of_robot = np.empty(self.n, object)
        for controller, part in zip(self.controllers, self._rows, strict=True):
            of_robot[part] = controller.model
        model = list(of_robot)
        if len({t.period for t in model}) > 1:
            raise OmniError(
                "controllers that are called together must be told frames of the same length"
            )
        period = model[0].period
        delays = np.array([t.delay_frames for t in model])
        self._delay = int(delays[0]) if (delays == delays[0]).all() else delays
        noise, limits = np.array([t.vision_noise for t in model]), [t.limits for t in model]
        latency = np.array([[t.latency_frames] for t in model])
        self._limits = CommandLimiter(limits, period)
        self._tracker = VisionTracker(
            pose, noise, latency, period, OutlierGate(noise, limits, period)
        )
        self.filter = self._tracker.filter
        self._memory = [
            max(c.memory_frames, math.ceil(c.model.latency_frames) + 1) for c in self.controllers
        ]
        self._sent = CommandHistory(
            self.n, max(*self._memory, self._tracker.memory_frames) + MAX_FRAMES_BEHIND
        )
        self.knows_truth = any(type(c).knows_truth for c in self.controllers)
        self._records = [
            collect_channels(c, n) for c, n in zip(self.controllers, self._sizes, strict=True)
        ]

        self.twist = self._tracker.twist
        self.last_command, self.failed = np.zeros((self.n, 3)), np.zeros(self.n, bool)
        self._seen: Observation | None = None  # until it is answered by commands
        self._true: Observation | None = None

    def observe(
        self,
        measured_poses: ArrayLike,
        true_state: tuple[ArrayLike, ArrayLike] | None = None,
        measurement_age: ArrayLike | None = None,
    ) -> Observation:
        """Begin a frame with what vision reports; return what is known of all robots, to be read only.

        Args:
            measured_poses: poses seen (n, 3), headings in (-pi, pi]; not a number where a robot was not
                seen.
            true_state: true poses and twists (n, 3), for controllers that know them; their headings
                count full turns.
            measurement_age: time from when each robot was seen there until this frame, (n,) s. [0]

        Raises:
            OmniError: poses of another shape, infinite ones, ages that cannot be, or no truth for a
                controller that knows it.
        """
        reported = _numbers(measured_poses, (self.n, 3), "what vision reports")
        reported[self.failed] = np.nan
        ages = (
            np.zeros(self.n)
            if measurement_age is None
            else _numbers(measurement_age, (self.n,), "ages, in s from 0 on,")
        )
        if np.count_nonzero(ages >= 0) < self.n:
            raise OmniError(
                f"ages must be ({self.n},) finite numbers of s from 0 on, not {measurement_age!r}"
            )
        if self.knows_truth and true_state is None:
            raise OmniError(
                "a controller of this team knows the truth, which must be given with what vision reports"
            )

        self.frame += 1
        self._sent.append(self.last_command)
        now = self._tracker
        believed = now.update(reported, ages, self._sent)
        self.estimate, self.twist = now.pose, now.twist
        period = self.controllers[0].model.period
        for values in (now.pose, now.twist, believed, ages):
            values.flags.writeable = False
        self._seen = Observation(
            now.pose, now.twist, believed, self._sent, period, self._delay, ages, now.steps
        )
        if self.knows_truth and true_state is not None:
            true, twist = (_numbers(values, (self.n, 3), "the truth") for values in true_state)
            true[self.failed], twist[self.failed] = (
                now.pose[self.failed],
                0.0,
            )  # which may be no numbers
            self._true = Observation(true, twist, true, self._sent, period, self._delay)
        return self._seen

    def command(self, override: ArrayLike | None = None) -> Array:
        """Return the commands (n, 3) within the limits, and count them as sent.

        Args:
            override: commands (n, 3) in place of what the controllers say. [they are asked]

        Raises:
            OmniError: nothing was observed since the last commands, or they are not (n, 3) finite
                numbers.
            ControllerError: a controller failed, and nobody handles it.
        """
        if override is None and self._seen is None:
            raise OmniError("robots must be observed before they are commanded, in every frame")
        if override is None:
            commands = np.zeros((self.n, 3))
            for i, rows in enumerate(self._rows):
                if np.count_nonzero(self.failed[rows]) < self._sizes[i]:
                    commands[rows] = self._ask(i)
        else:
            commands = _numbers(override, (self.n, 3), "commands")
            if np.count_nonzero(np.isnan(commands)):
                raise OmniError("commands must be finite numbers")
        command = self._limits(commands, self.last_command)
        command[self.failed] = 0.0
        self.last_command, self._seen = command, None
        return command.copy()

    def step(
        self,
        measured_poses: ArrayLike,
        true_state: tuple[ArrayLike, ArrayLike] | None = None,
        measurement_age: ArrayLike | None = None,
    ) -> Array:
        """Return the commands (n, 3) for what vision reports: `observe`, then `command`."""
        self.observe(measured_poses, true_state, measurement_age)
        return self.command()

    def stop(self, rows: Rows) -> None:
        """Take robots out of the game: they are sent zero, and their controllers' failures ignored."""
        self.failed[rows] = True

    def _ask(self, i: int) -> Array:
        """Return what the i-th controller commands its robots (n of it, 3); zero where it fails."""
        controller, rows = self.controllers[i], self._rows[i]
        known = self._true if controller.knows_truth else self._seen
        assert known is not None, "checked when it was observed"
        own = known.select(rows, self._memory[i], controller.model.delay_frames)
        robots, name = np.arange(self.n)[rows], type(controller).__name__
        try:
            wanted = _command(controller, self.frame, own)
            self._records[i] = collect_channels(controller, len(wanted))
        except Exception as error:
            place = describe_error(type(controller), error)
            failure = ControllerError(f"{name} failed in frame {self.frame}{place}")
            failure.__cause__ = error
            self._fail(robots, failure)
            return np.zeros((len(robots), 3))
        if np.count_nonzero(finite := np.isfinite(wanted)) < finite.size:
            wrong = np.asarray(~finite.all(1))
            reason = f"{name} returned commands that are not finite in frame {self.frame}"
            self._fail(
                robots[wrong], ControllerError(f"{reason}; {wanted.shape} finite are needed")
            )
            wanted = np.where(wrong[:, None], 0.0, wanted)
        return wanted

    def _fail(self, rows: NDArray[np.intp], reason: ControllerError) -> None:
        new = rows[~self.failed[rows]]
        if not len(new):
            return
        if self._on_failure is None:
            raise reason
        self.stop(new)
        self._on_failure(new, reason)

    @property
    def predicted_pose(self) -> Array:
        """Where controllers say that robots will be, (n, 3); not a number for failed rows."""
        return self._together("predicted_pose")

    @property
    def alpha_hat(self) -> Array:
        """See `Controller`."""
        return self._together("alpha_hat")

    @property
    def latency_hat(self) -> Array:
        """See `Controller`."""
        return self._together("latency_hat")

    @property
    def channels(self) -> dict[str, Array]:
        """What else controllers record, by name: (n, k); not a number for rows without it."""
        names = dict.fromkeys(
            name for record in self._records for name in record if name not in RECORDED
        )
        return {name: self._together(name) for name in names}

    def _together(self, name: str) -> Array:
        """Return what all controllers record under a name, (n, k), not a number where nothing is."""
        width = max(record[name].shape[1] for record in self._records if name in record)
        table = np.full((self.n, width), np.nan)
        for record, rows in zip(self._records, self._rows, strict=True):
            if name in record:
                table[rows, : record[name].shape[1]] = record[name]
        table[self.failed] = np.nan
        return table


def _command(controller: Controller, frame: int, observation: Observation) -> Array:
    """Return a controller's commands, of the shape of the poses, not necessarily finite."""
    wanted = np.asarray(controller.command(frame, observation))
    if wanted.shape != observation.pose.shape or wanted.dtype.kind == "c":
        raise OmniError(
            f"commands of shape {wanted.shape}, {wanted.dtype}; {observation.pose.shape} finite are needed"
        )
    return wanted.astype(float, copy=False)


def _rows_of_controllers(
    sizes: Sequence[int], rows: Sequence[ArrayLike] | None, n: int
) -> list[Rows]:
    """Return the rows of each controller among n robots, as slices where possible: those are not copied.

    Raises:
        OmniError: robots have no controller, or two.
    """
    parts = (
        np.split(np.arange(n), np.cumsum(sizes)[:-1])
        if rows is None
        else [np.asarray(part, int) for part in rows]
    )
    all_rows = sorted(np.concatenate([[], *parts]))
    if (
        [len(part) for part in parts] != list(sizes)
        or all_rows != list(range(n))
        or 0 in sizes
        or not n
    ):
        raise OmniError(
            f"{n} robots need one controller each; there are controllers for {sizes} robots, in rows {rows}"
        )
    return [
        slice(int(part[0]), int(part[-1]) + 1) if (np.diff(part) == 1).all() else part
        for part in parts
    ]


def _numbers(values: ArrayLike, shape: tuple[int, ...], name: str) -> Array:
    """Return a copy of numbers of a shape, which may be NaN.

    Raises:
        OmniError: they are not of that shape, or infinite.
    """
    try:
        numbers = np.array(values, float)
    except (TypeError, ValueError):
        numbers = np.array(np.nan)
    if numbers.shape != shape or np.count_nonzero(np.isinf(numbers)):
        wrong = f"not of shape {numbers.shape}" if numbers.shape != shape else "which these are not"
        raise OmniError(f"{name} must be finite numbers {shape}, {wrong}")
    return numbers
