"""A team's computer: vision in, commands out; filter, controllers, limits (figure 4 of the paper).

    team = Team(controllers, start_poses)
    while True:
        command = team.step(measured_poses)  # team.observe(measured_poses), then team.command()

The simulated loop uses the same class.
"""

import math
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from omni_control.arguments import check_array, check_types, explain_types
from omni_control.command_limiter import CommandLimiter
from omni_control.controllers.base import (
    RECORDED_ATTRIBUTES,
    Controller,
    Observation,
    collect_channels,
    describe_error,
)
from omni_control.delay_compensation import CommandHistory, RowSelection
from omni_control.errors import ControllerError, OmniError
from omni_control.estimation.delayed_measurements import MAX_FRAMES_BEHIND
from omni_control.estimation.vision_tracker import VisionTracker
from omni_control.kinematics import Array
from omni_control.reference import MotionLimits
from omni_control.reference.target_reference import TargetReference, as_robot_indices

# Called with the indices (m,) of the robots that failed, and the reason.
FailureHandler = Callable[[NDArray[np.intp], ControllerError], None]

REVERSED_HEADING = (
    "vision reports the opposite of the heading with which the robot follows its commands: "
    "check its pattern and the camera"
)


@explain_types
class Team:
    """n robots under one or more controllers. A robot's model is that of its controller.

    Args:
        controllers: One controller, or several with different robots.
        start_poses: Initial poses (n, 3), m and rad. Estimated headings are unwrapped from there:
            continuous, not limited to (-pi, pi].
        robot_indices: Indices of the robots of each controller. Default: consecutive indices in the
            order of the controllers.
        on_failure: Called with the indices (m,) of robots and a `ControllerError` if their
            controller fails. The team sends zero to them from then on; the others continue.
            Default: the error is raised.

    Attributes:
        n: Number of robots.
        controllers: The controllers.
        robot_indices: Indices of the robots of each controller.
        frame: Frame number k of the latest observation; -1 before the first.
        filter: Kalman filter of all robots. If measurements are delayed, its state is that of an
            earlier frame.
        estimate: Estimated present poses, (n, 3); read-only.
        twist: Estimated present twists, (n, 3); read-only.
        inactive: Mask of the robots that failed or were stopped, (n,).
        knows_truth: Whether a controller needs the true state in `observe`.
        last_command: Commands sent in the latest frame, (n, 3); initially zero. Overwrite it if the
            robots received other commands than those returned.

    Raises:
        OmniError: There is no controller, frame lengths differ, the start poses are not finite
            numbers (n, 3), or `robot_indices` does not assign every robot to one controller.
    """

    @check_types
    def __init__(
        self,
        controllers: Controller | Sequence[Controller],
        start_poses: ArrayLike,
        robot_indices: Sequence[ArrayLike] | None = None,
        *,
        on_failure: FailureHandler | None = None,
    ) -> None:
        pose = check_array("start_poses", start_poses, (None, 3))
        self.n, self.frame, self.estimate = len(pose), -1, pose
        self._on_failure = on_failure
        noise, latency, limits = self._assign_controllers(controllers, robot_indices)
        self._tracker = VisionTracker(pose, noise, latency, self._period, limits)
        self.filter = self._tracker.filter
        self._sent = CommandHistory(self.n, self._count_commands())
        self.twist = self._tracker.twist
        self.last_command, self.inactive = np.zeros((self.n, 3)), np.zeros(self.n, bool)
        self._observation: Observation | None = None  # None until robots are observed in a frame
        self._true_observation: Observation | None = None

    @check_types
    def replace_controllers(
        self,
        controllers: Controller | Sequence[Controller],
        robot_indices: Sequence[ArrayLike] | None = None,
    ) -> None:
        """Replace all controllers between two frames. The filter and inactive robots stay.

        Args:
            controllers: See the constructor. Their frames must have the same length as before.
            robot_indices: See the constructor.

        Raises:
            OmniError: As the constructor.
        """
        self._tracker.change_model(*self._assign_controllers(controllers, robot_indices))
        length = self._count_commands()
        if length > self._sent.length:
            sent, self._sent = self._sent, CommandHistory(self.n, length)
            for command in sent.get_latest(sent.length):
                self._sent.append(command)

    def _assign_controllers(
        self,
        controllers: Controller | Sequence[Controller],
        robot_indices: Sequence[ArrayLike] | None,
    ) -> tuple[Array, Array, list[MotionLimits]]:
        """Let controllers drive the robots from now on.

        Returns:
            Of their models the noise (n, 3), the latency (n, 1) in frames, and the limits.
        """
        self.controllers = (
            [controllers] if isinstance(controllers, Controller) else list(controllers)
        )
        self._sizes = [len(c.predicted_pose) for c in self.controllers]
        self.robot_indices = _assign_robots(self._sizes, robot_indices, self.n)
        self._period = period = self.controllers[0].model.period
        if any(c.model.period != period for c in self.controllers):
            raise OmniError(
                "the models of a team's controllers must have frames of the same length"
            )
        models = np.empty(self.n, object)
        for controller, robots in zip(self.controllers, self.robot_indices, strict=True):
            models[robots] = controller.model
        delays = np.array([model.delay_frames for model in models])
        self._delay_frames = delays[0].item() if (delays == delays[0]).all() else delays
        noise = np.array([model.vision_noise for model in models])
        limits = [model.limits for model in models]
        latency = np.array([[model.latency_frames] for model in models])
        self._command_limiter = CommandLimiter(limits, period)
        self._memory_frames = [
            max(c.memory_frames, math.ceil(c.model.latency_frames) + 1) for c in self.controllers
        ]
        self.knows_truth = any(type(c).knows_truth for c in self.controllers)
        self._channels = [
            collect_channels(c, n) for c, n in zip(self.controllers, self._sizes, strict=True)
        ]
        return noise, latency, limits

    def _count_commands(self) -> int:
        """Return the number of sent commands that filter and controllers need."""
        return max(*self._memory_frames, self._tracker.memory_frames) + MAX_FRAMES_BEHIND

    def observe(
        self,
        measured_poses: ArrayLike,
        true_state: tuple[ArrayLike, ArrayLike] | None = None,
        measurement_age: ArrayLike | None = None,
    ) -> Observation:
        """Begin a frame with the measurements of vision; return the observation, read-only.

        Args:
            measured_poses: Measured poses (n, 3), heading in (-pi, pi]; NaN if a robot was not
                detected.
            true_state: True poses and twists, (n, 3) each, for controllers that know the truth;
                headings are unwrapped.
            measurement_age: Time from the capture of each measurement to this frame, (n,) s.
                Default: 0.

        Raises:
            OmniError: An array has a wrong shape or is infinite, an age is negative or NaN, or
                the true state is missing.
        """
        measured = check_array("measured_poses", measured_poses, (self.n, 3), allow_nan=True)
        measured[self.inactive] = np.nan
        age = np.zeros(self.n)
        if measurement_age is not None:
            age = check_array("measurement_age", measurement_age, (self.n,), allow_nan=True)
        # Faster than .all() on small arrays. False for NaN.
        if np.count_nonzero(age >= 0) < self.n:
            raise OmniError(f"measurement_age must be at least 0 s, got {measurement_age!r}")
        if self.knows_truth and true_state is None:
            raise OmniError("a controller of this team knows the truth: observe needs true_state")

        self.frame += 1
        self._sent.append(self.last_command)
        tracker = self._tracker
        accepted = tracker.update(measured, age, self._sent)
        if np.count_nonzero(tracker.is_reversed):
            reason = ControllerError(REVERSED_HEADING)
            self._fail(np.flatnonzero(tracker.is_reversed), reason)
        self.estimate, self.twist = tracker.pose, tracker.twist
        for values in (tracker.pose, tracker.twist, accepted, age):
            values.flags.writeable = False
        self._observation = Observation(
            pose=tracker.pose,
            twist=tracker.twist,
            measured_pose=accepted,
            sent_commands=self._sent,
            period=self._period,
            delay_frames=self._delay_frames,
            measurement_age=age,
            filter_steps=tracker.steps,
        )
        if self.knows_truth and true_state is not None:
            pose, twist = (
                check_array("true_state", values, (self.n, 3), allow_nan=True)
                for values in true_state
            )
            # The true state of an inactive robot may be NaN.
            pose[self.inactive], twist[self.inactive] = tracker.pose[self.inactive], 0.0
            self._true_observation = Observation(
                pose, twist, pose, self._sent, self._period, self._delay_frames
            )
        return self._observation

    def command(self, override: ArrayLike | None = None) -> Array:
        """Return the commands (n, 3) within the limits, and record them as sent.

        Args:
            override: Commands (n, 3) in place of those of the controllers. Default: those of the
                controllers.

        Raises:
            OmniError: Robots were not observed since the last commands, or `override` is not an
                array of finite numbers (n, 3).
            ControllerError: A controller failed, and there is no `on_failure`.
        """
        if override is not None:
            desired = check_array("commands", override, (self.n, 3))
        elif self._observation is None:
            raise OmniError("robots must be observed before they are commanded, in every frame")
        else:
            desired = np.zeros((self.n, 3))
            for i, robots in enumerate(self.robot_indices):
                if np.count_nonzero(self.inactive[robots]) < self._sizes[i]:
                    desired[robots] = self._call_controller(i)
        command = self._command_limiter(desired, self.last_command)
        command[self.inactive] = 0.0
        self.last_command, self._observation = command, None
        return command.copy()

    def step(
        self,
        measured_poses: ArrayLike,
        true_state: tuple[ArrayLike, ArrayLike] | None = None,
        measurement_age: ArrayLike | None = None,
    ) -> Array:
        """Observe the robots and return the commands (n, 3); see `observe` and `command`."""
        self.observe(measured_poses, true_state, measurement_age)
        return self.command()

    def set_target(self, robot: int, pose: ArrayLike, twist: ArrayLike = (0, 0, 0)) -> None:
        """Set the pose and the twist of a robot's target, in any frame; see `TargetReference`.

        They are those in the frame observed last, or after `command` those in the next frame.

        Args:
            robot: Index of the robot.
            pose: Target pose [x, y, heading], (3,) m and rad.
            twist: Twist of the target, (3,) world frame, m/s and rad/s. Default: it rests.

        Raises:
            OmniError: The robot does not exist, its controller has another reference, or the
                target is not three finite numbers.
        """
        reference, row = self._find_target_reference(robot)
        reference.set_target(self.frame + (self._observation is None), row, pose, twist)

    def set_velocity(self, robot: int, twist: ArrayLike, heading: float | None = None) -> None:
        """Set the twist at which a robot shall drive, in any frame; see `set_target`.

        Args:
            robot: Index of the robot.
            twist: Desired twist [vx, vy, turn rate], (3,) world frame.
            heading: Target heading, rad, which changes at the turn rate. Default: only the turn
                rate matters.

        Raises:
            OmniError: As for `set_target`.
        """
        reference, row = self._find_target_reference(robot)
        reference.set_velocity(self.frame + (self._observation is None), row, twist, heading)

    def stop(self, robots: RowSelection) -> None:
        """Stop robots: send them zero, and ignore failures of their controllers."""
        self.inactive[robots] = True

    @property
    def predicted_pose(self) -> Array:
        """Poses for which the latest commands were computed, (n, 3); NaN for inactive robots.

        See `Controller`.
        """
        return self._merge_channel("predicted_pose")

    @property
    def alpha_hat(self) -> Array:
        """Latest estimates of alpha per axis, (n, 3), see `Controller`; NaN for inactive robots."""
        return self._merge_channel("alpha_hat")

    @property
    def latency_hat(self) -> Array:
        """Latest estimates of the latency per axis, (n, 3), frames, see `Controller`."""
        return self._merge_channel("latency_hat")

    @property
    def channels(self) -> dict[str, Array]:
        """Further recorded values of the controllers, (n, k) by name; NaN for robots without it."""
        names = dict.fromkeys(name for channels in self._channels for name in channels)
        return {
            name: self._merge_channel(name) for name in names if name not in RECORDED_ATTRIBUTES
        }

    def _find_target_reference(self, robot: int) -> tuple[TargetReference, int]:
        """Return the reference of a robot that takes targets, and the robot's row in it."""
        index = as_robot_indices(robot, self.n)[0]
        for controller, indices in zip(self.controllers, self.robot_indices, strict=True):
            is_robot = indices == index
            if is_robot.any():
                reference, row = controller.reference, int(is_robot.argmax())
        if not isinstance(reference, TargetReference):
            kind = type(reference).__name__
            raise OmniError(f"robot {robot} follows a {kind}; targets need a TargetReference")
        return reference, row

    def _call_controller(self, i: int) -> Array:
        """Return the commands of controller i, (size, 3); zero for robots that fail."""
        controller, indices = self.controllers[i], self.robot_indices[i]
        observation = self._true_observation if controller.knows_truth else self._observation
        assert observation is not None, "checked in observe"
        selection = observation.select(
            indices, self._memory_frames[i], controller.model.delay_frames
        )
        name = type(controller).__name__
        try:
            commands = np.asarray(controller.command(self.frame, selection))
            if commands.shape != selection.pose.shape or commands.dtype.kind == "c":
                raise OmniError(
                    f"commands must be numbers {selection.pose.shape}, got {commands.dtype} of "
                    f"shape {commands.shape}"
                )
            commands = commands.astype(float, copy=False)
            self._channels[i] = collect_channels(controller, len(commands))
        except (Exception, SystemExit) as error:
            description = describe_error(type(controller), error)
            failure = ControllerError(f"{name} failed in frame {self.frame}{description}")
            failure.__cause__ = error
            self._fail(indices, failure)
            return np.zeros((len(indices), 3))
        is_finite = np.isfinite(commands)
        if np.count_nonzero(is_finite) < is_finite.size:
            is_invalid = np.asarray(~is_finite.all(1))
            reason = f"{name} returned commands that are not finite in frame {self.frame}"
            self._fail(indices[is_invalid], ControllerError(reason))
            commands = np.where(is_invalid[:, None], 0.0, commands)
        return commands

    def _fail(self, robots: NDArray[np.intp], reason: ControllerError) -> None:
        """Report or raise the reason for a failure of robots, and stop those still active."""
        new_failures = robots[~self.inactive[robots]]
        if not len(new_failures):
            return
        if self._on_failure is None:
            raise reason
        self.stop(new_failures)
        self._on_failure(new_failures, reason)

    def _merge_channel(self, name: str) -> Array:
        """Combine values recorded by the controllers into one array (n, k).

        Robots whose controller does not record the name, and inactive robots, are NaN.
        """
        width = max(channels[name].shape[1] for channels in self._channels if name in channels)
        merged = np.full((self.n, width), np.nan)
        for channels, robots in zip(self._channels, self.robot_indices, strict=True):
            if name in channels:
                merged[robots, : channels[name].shape[1]] = channels[name]
        merged[self.inactive] = np.nan
        return merged


def _assign_robots(
    sizes: list[int], robot_indices: Sequence[ArrayLike] | None, n: int
) -> list[NDArray[np.intp]]:
    """Return the indices of each controller's robots.

    Args:
        sizes: Number of robots of each controller.
        robot_indices: See `Team`.
        n: Number of robots.

    Raises:
        OmniError: A robot has no controller or two, or a controller has no robots or another
            number of indices than robots.
    """
    if not n or 0 in sizes or sum(sizes) != n:
        raise OmniError(f"{n} robots need one controller each, got controllers of {sizes} robots")
    if robot_indices is None:
        selections = np.split(np.arange(n), np.cumsum(sizes)[:-1])
    else:
        selections = [np.asarray(indices, int) for indices in robot_indices]
    if [len(selection) for selection in selections] != sizes:
        raise OmniError(
            f"robot_indices must list the {sizes} robots of the controllers, got {robot_indices}"
        )
    if sorted(np.concatenate(selections)) != list(range(n)):
        raise OmniError(
            f"robots 0 to {n - 1} need one controller each, got robot_indices {robot_indices}"
        )
    return selections
