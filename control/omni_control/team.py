"""A team's computer: what vision sees goes in, commands come out; filter, controllers, limits (figure 4 of the paper).

    team = Team(controllers, start)
    while True:
        command = team.step(measured)  # in two halves: seen = team.observe(measured), command = team.command()

The simulated loop runs the same.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from omni_control.controllers.apart import Apart
from omni_control.controllers.base import Controller, Seen, carried
from omni_control.controllers.checks import (
    Said,
    answer,
    checked,
    checked_ages,
    one_controller_each,
    own_answer,
    said,
    together,
    told_of_each,
)
from omni_control.controllers.guests import guest_of
from omni_control.delay import CommandsInFlight, Rows
from omni_control.errors import ControllerError, OmniError
from omni_control.estimation.gate import Gate
from omni_control.estimation.kalman import KalmanFilter
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
        rows: the robots of each controller, as slices or indices into the n; one after the other, if none are given.
        on_failure: called with the rows that failed and the reason, when a controller fails. They are sent zero from
            then on, and the others go on. Without it, the reason is raised.

    Attributes:
        n: robots.
        frame: k, that of the last observation; -1 before the first.
        filter: of vision, of all robots.
        estimate, twist: filtered poses and twists (n, 3).
        failed: which rows have failed or were stopped, (n,).
        knows_truth: whether one of the controllers does, which must then be told.
        last: the commands that were sent last, (n, 3); zero at first.

    Raises:
        OmniError: no controller, frames of different lengths, a start that is not (n, 3) finite numbers, or robots that
            have no controller, or two.
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
        self._rows = one_controller_each(self.controllers, rows, self.n)
        self._on_failure = on_failure

        self._told = [c.told for c in self.controllers]
        told = told_of_each(self.controllers, self._rows, self.n)
        latency = np.array([[t.latency_frames] for t in told])
        self._period = told[0].period
        delays = np.array([t.delay_frames for t in told])
        self._delay = int(delays[0]) if (delays == delays[0]).all() else delays
        noise, limits = np.array([t.vision_noise for t in told]), [t.limits for t in told]
        self.filter = KalmanFilter(pose, self._period, noise)
        compiled = told[0].compiled
        self._limits = CommandLimits(limits, self._period, compiled)
        self._tracker = Tracker(self.filter, Gate(noise, limits, self._period), latency, self._period, compiled)
        self._memory = [max(c.memory_frames, math.ceil(c.told.latency_frames) + 1) for c in self.controllers]
        self._sent = CommandsInFlight(self.n, max(*self._memory, self._tracker.longest) + MOST_FRAMES)
        self._truthful = [type(c).knows_truth for c in self.controllers]  # of the class, by which others know it
        self.knows_truth = any(self._truthful)
        self._guests = [guest_of(c) for c in self.controllers]
        self._said = [said(c, len(c.predicted), "when it was made") for c in self.controllers]

        self.twist = self._tracker.twist
        self.last, self.failed, self._failures = np.zeros((self.n, 3)), np.zeros(self.n, bool), False
        self._known: _Known | None = None  # until it is answered by commands
        self._true: _Known | None = None
        self._record: Said | None = None

    def observe(
        self, measured: ArrayLike, truth: tuple[ArrayLike, ArrayLike] | None = None, age: ArrayLike | None = None
    ) -> Seen:
        """Begin a frame with what vision reports; return what is known of all robots (`see`, then `seen`)."""
        self.see(measured, truth, age)
        return self.seen

    def see(
        self, measured: ArrayLike, truth: tuple[ArrayLike, ArrayLike] | None = None, age: ArrayLike | None = None
    ) -> Array:
        """Begin a frame with what vision reports; return what is believed of it, in this frame, (n, 3), to be read.

        Args:
            measured: poses seen (n, 3), headings in (-pi, pi]; not a number where a robot was not seen.
            truth: true poses and twists (n, 3), for controllers that know them; their headings count full turns.
            age: how long before this frame each robot was seen there, (n,) s. [just now]

        Raises:
            OmniError: poses of another shape, infinite ones, ages that cannot be, or no truth for a controller that
                knows it.
        """
        seen = checked(measured, self.n, "what vision reports")
        if self._failures:
            seen[self.failed] = np.nan
        if self.knows_truth and truth is None:
            raise OmniError("a controller of this team knows the truth, which must be given with what vision reports")
        if self.knows_truth and truth is not None:
            self._true = self._held(*(checked(values, self.n, "the truth") for values in truth))
        ages = None if age is None else checked_ages(age, self.n)

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
        """Ask the controllers, once a frame; return the commands (n, 3) within the limits, and count them as sent.

        Raises:
            OmniError: nothing was observed since the last commands.
            ControllerError: a controller failed, and nobody handles it.
        """
        seen = self._observed()
        wanted, failures = np.zeros((self.n, 3)), self._failures
        for i, rows in enumerate(self._rows):
            if not (failures and self.failed[rows].all()):
                known = self._true if self._truthful[i] else seen
                assert known is not None, "checked when it was observed"
                wanted[rows] = self._asked(i, known)
        if self._failures:
            wanted[self.failed] = 0.0
        command = self._limits(wanted, self.last)
        if self._failures:
            command[self.failed] = 0.0
        self._record = None
        self.last, self._known = command, None
        return command.copy()

    def step(
        self, measured: ArrayLike, truth: tuple[ArrayLike, ArrayLike] | None = None, age: ArrayLike | None = None
    ) -> Array:
        """A whole frame, from what vision reports to commands (n, 3): `observe`, then `command`."""
        self.see(measured, truth, age)
        return self.command()

    def limited(self, command: ArrayLike) -> Array:
        """The commands (n, 3) that may be sent after the last, given those wanted; see `CommandLimits`.

        Raises:
            OmniError: they are not (n, 3) finite numbers.
        """
        return self._limits(checked(command, self.n, "commands", finite=True), self.last)

    def sent(self, command: ArrayLike) -> None:
        """Say that other commands (n, 3) were sent in this frame, such as a person's: controllers then count on them.

        Raises:
            OmniError: they are not (n, 3) finite numbers.
        """
        self.last, self._known = checked(command, self.n, "commands", finite=True), None

    def stop(self, rows: Rows) -> None:
        """Take robots out of the game: from now on they are sent zero, and their controllers' mistakes are none."""
        self._out(rows)
        self._record = None

    def leave(self) -> None:
        """Let controllers go that have processes of their own; they cannot be asked again."""
        for controller in self.controllers:
            if isinstance(controller, Apart):
                controller.leave()

    def _observed(self) -> "_Known":
        """What was observed in this frame.

        Raises:
            OmniError: nothing was since the last commands.
        """
        if self._known is None:
            raise OmniError("robots must be observed before they are commanded, in every frame")
        return self._known

    def _part(self, known: "_Known", rows: Rows, memory: int, delay: int | Array) -> Seen:
        """What is known of some robots, in arrays of its own."""
        pose, twist, measured = known.pose[rows].copy(), known.twist[rows].copy(), known.measured[rows].copy()
        age = None if known.age is None else known.age[rows].copy()
        steps = tuple(late.of(rows) for late in known.steps) if known.steps else ()
        return Seen(pose, twist, measured, self._sent.of(rows, memory), self._period, delay, age, steps)

    def _held(self, pose: Array, twist: Array) -> "_Known":
        """The truth, but for robots that have failed, of which nobody knows what becomes: they stay where they were."""
        if self._true is not None and self._failures:
            pose[self.failed], twist[self.failed] = self._true[0][self.failed], 0.0
        return _Known(pose, twist, pose)

    def _asked(self, i: int, known: "_Known") -> Array:
        """What the i-th controller commands its robots (n of it, 3); zero for those that fail now."""
        controller, rows, guest = self.controllers[i], self._rows[i], self._guests[i]
        seen = self._part(known, rows, self._memory[i], self._told[i].delay_frames)
        try:
            if guest is None:
                wanted, self._said[i] = own_answer(controller, self.frame, seen)
            else:
                seen = replace(seen, sent=seen.sent.copy())
                wanted, self._said[i] = guest.call(
                    lambda: answer(controller, self.frame, seen), f"in frame {self.frame}"
                )
        except ControllerError as error:
            self._fail(np.arange(self.n)[rows], error)
            return np.zeros_like(seen.pose)
        if np.count_nonzero(np.isfinite(wanted)) == wanted.size:
            return wanted
        robots = np.arange(self.n)[rows]
        wrong = np.asarray(~np.isfinite(wanted).all(1))
        if (wrong & ~self.failed[robots]).any():
            name, shape = type(controller).__name__, wanted.shape
            reason = f"{name} returned commands that are not finite in frame {self.frame}; {shape} finite are needed"
            self._fail(robots[wrong], ControllerError(reason))
        return np.where(wrong[:, None], 0.0, wanted)

    def _fail(self, rows: NDArray[np.intp], reason: ControllerError) -> None:
        if self._on_failure is None:
            raise reason
        new = rows[~self.failed[rows]]
        self._out(new)
        self._on_failure(new, reason)

    def _out(self, rows: Rows) -> None:
        self.failed[rows] = True
        self._failures = bool(np.count_nonzero(self.failed))

    @property
    def predicted(self) -> Array:
        """Where controllers say that robots will be, (n, 3); of failed rows not a number, as in the next two."""
        return self._recorded.recorded["predicted"]

    @property
    def alpha_hat(self) -> Array:
        """See `Controller`."""
        return self._recorded.recorded["alpha_hat"]

    @property
    def latency_hat(self) -> Array:
        """See `Controller`."""
        return self._recorded.recorded["latency_hat"]

    @property
    def channels(self) -> dict[str, Array]:
        """What else they record, by name: (n, k), not a number for rows that have no such channel, or failed."""
        return self._recorded.channels

    @property
    def _recorded(self) -> Said:
        """What the controllers say of themselves, put together when it is asked for."""
        if self._record is None:
            self._record = together(self._said, self._rows, self.n)
            tables = (*self._record.recorded.values(), *self._record.channels.values())
            for table in tables if self._failures else ():
                table[self.failed] = np.nan
        return self._record


class _Known(NamedTuple):
    """Poses, twists and what was measured, (n, 3) each; its age (n,), and the steps of filters that are behind."""

    pose: Array
    twist: Array
    measured: Array
    age: Array | None = None
    steps: tuple[Late, ...] = ()
