"""A team's computer: vision in, commands out; filter, controllers, limits (figure 4 of the paper).

    team = Team(controllers, start)
    while True:
        command = team.step(measured)  # the same as team.observe(measured), then team.command()

The simulated loop runs the same.
"""

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from omni_control.controllers.base import RECORDED, Controller, Seen, carried, error_place, record_of
from omni_control.delay import CommandsInFlight, Rows
from omni_control.errors import ControllerError, OmniError
from omni_control.estimation.gate import Gate
from omni_control.estimation.late import MOST_FRAMES, Late
from omni_control.estimation.tracking import Tracker
from omni_control.kinematics import Array
from omni_control.limits import CommandLimits

OnFailure = Callable[[NDArray[np.intp], ControllerError], None]


class Team:
    """n robots under one or more controllers; what is known of a robot is what its controller was told.

    Args:
        controllers: one, or several with robots of their own.
        start: poses at the start (n, 3), m, m, rad; headings count full turns from there.
        rows: the robots of each controller, as slices or indices into the n; one after the other,
            if none are given.
        on_failure: called with the rows that failed and the reason, when a controller fails. They
            are sent zero from then on, and the others go on. Without it, the reason is raised.

    Attributes:
        n: robots.
        frame: k, that of the last observation; -1 before the first.
        filter: of vision, of all robots.
        estimate, twist: filtered poses and twists (n, 3).
        failed: which rows have failed or were stopped, (n,).
        knows_truth: whether one of the controllers does, which must then be told.
        last: the commands that were sent last, (n, 3); zero at first.

    Raises:
        OmniError: no controller, frames of different lengths, a start that is not (n, 3) finite
            numbers, or robots that have no controller, or two.
    """

    def __init__(
        self,
        controllers: Controller | Sequence[Controller],
        start: ArrayLike,
        rows: Sequence[Rows] | None = None,
        *,
        on_failure: OnFailure | None = None,
    ) -> None:
        self.controllers = [controllers] if isinstance(controllers, Controller) else list(controllers)
        pose = np.array(start, float)
        if pose.ndim != 2 or pose.shape[1] != 3 or not np.isfinite(pose).all():
            raise OmniError(f"the start must be finite poses (n, 3), not of shape {pose.shape}")
        self.n, self.frame, self.estimate = len(pose), -1, pose
        self._rows = _rows_of_controllers(self.controllers, rows, self.n)
        self._on_failure = on_failure

        of_robot = np.empty(self.n, object)
        for controller, part in zip(self.controllers, self._rows, strict=True):
            of_robot[part] = controller.told
        told = list(of_robot)
        if len({t.period for t in told}) > 1:
            raise OmniError("controllers that are called together must be told frames of the same length")
        self._period = told[0].period
        delays = np.array([t.delay_frames for t in told])
        self._delay = int(delays[0]) if (delays == delays[0]).all() else delays
        noise, limits = np.array([t.vision_noise for t in told]), [t.limits for t in told]
        latency = np.array([[t.latency_frames] for t in told])
        self._limits = CommandLimits(limits, self._period)
        self._tracker = Tracker(pose, noise, latency, self._period, Gate(noise, limits, self._period))
        self.filter = self._tracker.filter
        self._memory = [max(c.memory_frames, math.ceil(c.told.latency_frames) + 1) for c in self.controllers]
        longest = max(*self._memory, self._tracker.longest)
        self._sent = CommandsInFlight(self.n, longest + MOST_FRAMES)
        self._truthful = [type(c).knows_truth for c in self.controllers]
        self.knows_truth = any(self._truthful)
        self._records = [record_of(c, len(c.predicted)) for c in self.controllers]

        self.twist = self._tracker.twist
        self.last, self.failed = np.zeros((self.n, 3)), np.zeros(self.n, bool)
        self._active = list(range(len(self.controllers)))  # controllers with a robot that has not failed
        self._known: _Known | None = None  # until it is answered by commands
        self._true: _Known | None = None

    def observe(
        self,
        measured: ArrayLike,
        truth: tuple[ArrayLike, ArrayLike] | None = None,
        age: ArrayLike | None = None,
    ) -> Seen:
        """Begin a frame with what vision reports; return what is known of all robots."""
        self.see(measured, truth, age)
        return self.seen

    def see(
        self,
        measured: ArrayLike,
        truth: tuple[ArrayLike, ArrayLike] | None = None,
        age: ArrayLike | None = None,
    ) -> Array:
        """Begin a frame with what vision reports; return the poses that are believed, (n, 3).

        Args:
            measured: poses seen (n, 3), headings in (-pi, pi]; not a number where a robot was not
                seen.
            truth: true poses and twists (n, 3), for controllers that know them; their headings
                count full turns.
            age: time from when each robot was seen there until this frame, (n,) s. [0]

        Raises:
            OmniError: poses of another shape, infinite ones, ages that cannot be, or no truth for a
                controller that knows it.
        """
        seen = _numbers(measured, self.n, "what vision reports")
        seen[self.failed] = np.nan
        if self.knows_truth and truth is None:
            raise OmniError("a controller of this team knows the truth, which must be given with what vision reports")
        if self.knows_truth and truth is not None:
            self._true = self._held(*(_numbers(values, self.n, "the truth") for values in truth))
        ages = None if age is None else _ages(age, self.n)

        self.frame += 1
        self._sent.push(self.last)
        now = self._tracker
        seen = now.update(seen, ages, self._sent)
        self.estimate, self.twist = now.pose.copy(), now.twist
        self._known = _Known(now.pose, now.twist, seen, ages, now.steps)
        return carried(seen, ages, now.twist)

    @property
    def seen(self) -> Seen:
        """What is known of all robots in this frame, until they are commanded.

        Raises:
            OmniError: nothing was observed since the last commands.
        """
        return self._part(self._observed(), slice(None), self._sent.length, self._delay)

    def command(self) -> Array:
        """Ask the controllers; return the commands (n, 3) within the limits, and count them as sent.

        Raises:
            OmniError: nothing was observed since the last commands.
            ControllerError: a controller failed, and nobody handles it.
        """
        seen = self._observed()
        wanted = np.zeros((self.n, 3))
        for i in self._active:
            known = self._true if self._truthful[i] else seen
            assert known is not None, "checked when it was observed"
            wanted[self._rows[i]] = self._asked(i, known)
        command = self._limits(wanted, self.last)
        command[self.failed] = 0.0
        self.last, self._known = command, None
        return command.copy()

    def step(
        self,
        measured: ArrayLike,
        truth: tuple[ArrayLike, ArrayLike] | None = None,
        age: ArrayLike | None = None,
    ) -> Array:
        """Return the commands (n, 3) for what vision reports: `observe`, then `command`."""
        self.see(measured, truth, age)
        return self.command()

    def limited(self, command: ArrayLike) -> Array:
        """Return the commands (n, 3) that may be sent after the last, given those wanted.

        Raises:
            OmniError: they are not (n, 3) finite numbers.
        """
        return self._limits(_numbers(command, self.n, "commands", finite=True), self.last)

    def sent(self, command: ArrayLike) -> None:
        """Replace the commands (n, 3) of this frame, as if a person had sent others.

        Raises:
            OmniError: they are not (n, 3) finite numbers.
        """
        self.last, self._known = _numbers(command, self.n, "commands", finite=True), None

    def stop(self, rows: Rows) -> None:
        """Take robots out of the game: they are sent zero, and their controllers' failures ignored."""
        self.failed[rows] = True
        self._active = [i for i, part in enumerate(self._rows) if not self.failed[part].all()]

    def _observed(self) -> "_Known":
        if self._known is None:
            raise OmniError("robots must be observed before they are commanded, in every frame")
        return self._known

    def _part(self, known: "_Known", rows: Rows, memory: int, delay: int | Array) -> Seen:
        """Return what is known of some robots, in arrays of its own."""
        pose, twist, measured = (values[rows].copy() for values in known[:3])
        age = None if known.age is None else known.age[rows].copy()
        steps = tuple(late.of(rows) for late in known.steps) if known.steps else ()
        sent = self._sent.of(rows, memory)
        return Seen(pose, twist, measured, sent, self._period, delay, age, steps)

    def _held(self, pose: Array, twist: Array) -> "_Known":
        """Return the truth, in which robots that have failed stay where they were."""
        if self._true is not None:
            pose[self.failed], twist[self.failed] = self._true[0][self.failed], 0.0
        return _Known(pose, twist, pose)

    def _asked(self, i: int, known: "_Known") -> Array:
        """Return what the i-th controller commands its robots (n of it, 3); zero where it fails."""
        controller, rows = self.controllers[i], self._rows[i]
        seen = self._part(known, rows, self._memory[i], controller.told.delay_frames)
        name, shape = type(controller).__name__, seen.pose.shape
        try:
            wanted = _command(controller, self.frame, seen)
            self._records[i] = record_of(controller, len(wanted))
        except Exception as error:
            place = error_place(type(controller), error)
            failure = ControllerError(f"{name} failed in frame {self.frame}{place}")
            failure.__cause__ = error
            self._fail(np.arange(self.n)[rows], failure)
            return np.zeros(shape)
        finite = np.isfinite(wanted)
        if np.count_nonzero(finite) == finite.size:
            return wanted
        robots = np.arange(self.n)[rows]
        wrong = np.asarray(~finite.all(1))
        if (wrong & ~self.failed[robots]).any():
            reason = f"{name} returned commands that are not finite in frame {self.frame}"
            self._fail(robots[wrong], ControllerError(f"{reason}; {shape} finite are needed"))
        return np.where(wrong[:, None], 0.0, wanted)

    def _fail(self, rows: NDArray[np.intp], reason: ControllerError) -> None:
        if self._on_failure is None:
            raise reason
        new = rows[~self.failed[rows]]
        self.stop(new)
        self._on_failure(new, reason)

    @property
    def predicted(self) -> Array:
        """Where controllers say that robots will be, (n, 3); not a number for failed rows."""
        return self._together("predicted")

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
        names = dict.fromkeys(name for record in self._records for name in record)
        return {name: self._together(name) for name in names if name not in RECORDED}

    def _together(self, name: str) -> Array:
        """Return what all controllers record under a name, (n, k), not a number where nothing is."""
        width = max(record[name].shape[1] for record in self._records if name in record)
        table = np.full((self.n, width), np.nan)
        for record, rows in zip(self._records, self._rows, strict=True):
            if name in record:
                table[rows, : record[name].shape[1]] = record[name]
        table[self.failed] = np.nan
        return table


class _Known(NamedTuple):
    """What is known of n robots in a frame; see `Seen`."""

    pose: Array
    twist: Array
    measured: Array
    age: Array | None = None
    steps: tuple[Late, ...] = ()


def _command(controller: Controller, frame: int, seen: Seen) -> Array:
    """Return a controller's commands, of the shape of the poses, not necessarily finite."""
    wanted = np.asarray(controller.command(frame, seen))
    if wanted.shape != seen.pose.shape:
        raise OmniError(f"commands of shape {wanted.shape}; {seen.pose.shape} finite are needed")
    if wanted.dtype.kind == "c":
        raise OmniError("commands must be real numbers, not complex ones")
    return wanted.astype(float, copy=False)


def _rows_of_controllers(controllers: Sequence[Controller], rows: Sequence[Rows] | None, n: int) -> list[Rows]:
    """Return the rows of each controller among n robots, as slices where possible.

    Raises:
        OmniError: robots have no controller, or two.
    """
    sizes = [len(c.predicted) for c in controllers]
    ends = np.cumsum(sizes).tolist()
    parts = [slice(end - size, end) for end, size in zip(ends, sizes, strict=True)]
    try:
        robots = [np.arange(n)[part] for part in (parts if rows is None else rows)]
    except IndexError:
        robots = []
    every = sorted(np.concatenate([[], *robots])) == list(range(n))
    if [len(part) for part in robots] != sizes or not every or 0 in sizes or not n:
        raise OmniError(
            f"{n} robots need one controller each; there are controllers for {sizes} robots, in rows {rows}"
        )
    return [slice(int(part[0]), int(part[-1]) + 1) if (np.diff(part) == 1).all() else part for part in robots]


def _numbers(values: ArrayLike, n: int, name: str, *, finite: bool = False) -> Array:
    """Return a copy of numbers (n, 3).

    Raises:
        OmniError: they are not of that shape, or infinite, or, if they must be finite, not numbers.
    """
    numbers = np.array(values, float)
    good = np.isfinite(numbers) if finite else ~np.isinf(numbers)
    if numbers.shape != (n, 3) or np.count_nonzero(good) < numbers.size:
        wrong = f"not of shape {numbers.shape}" if numbers.shape != (n, 3) else "which these are not"
        raise OmniError(f"{name} must be finite numbers ({n}, 3), {wrong}")
    return numbers


def _ages(age: ArrayLike, n: int) -> Array | None:
    """Return a copy of ages (n,) in s, or None if all are zero.

    Raises:
        OmniError: they are not n finite numbers from 0 on.
    """
    try:
        ages = np.array(age, float)
    except (TypeError, ValueError):
        ages = np.full(0, np.nan)
    if ages.shape != (n,) or not (np.isfinite(ages) & (ages >= 0)).all():
        raise OmniError(f"ages must be ({n},) finite numbers of s from 0 on, not {age!r}")
    return ages if ages.any() else None
