"""The simulation loop, 60 frames per simulated second.

Each frame: camera, pose filter, reference, controller, limits, radio, plant, log. All robots are
simulated together, as rows of arrays. `Simulation.run` repeats `observe` and `step`.
"""

from collections.abc import Callable, Hashable, Iterable, Sequence
from dataclasses import replace
from operator import attrgetter
from typing import Protocol

import numpy as np

from omni_control.arguments import check_integer, check_types
from omni_control.controllers.base import Observation
from omni_control.errors import OmniError, suggest_names, to_printable
from omni_control.kinematics import Array
from omni_mj.config import CYCLES_PER_FRAME, PERIOD_S, fault_checks, plugins, reference_factory
from omni_mj.config.rows import Row, build_rows
from omni_mj.config.scenario import Scenario
from omni_mj.config.settings import Settings
from omni_mj.network.camera import Cameras
from omni_mj.network.radio import Radio, ReceivedCommand, needs_cycles
from omni_mj.plants import Plant
from omni_mj.robot.numpy_and_jax_backends import choose_backend
from omni_mj.simulation.log import Failure, Log
from omni_mj.simulation.team_builder import ReferenceFactory, build_team

MAX_SEED = 2**63 - 1


class CameraModel(Protocol):
    """Cameras as the loop uses them, see `omni_mj.network.camera.Cameras`."""

    def __call__(self, pose: Array) -> tuple[Array, Array]:
        """Return the measured poses and their ages.

        Args:
            pose: True poses, shape (n, 3).

        Returns:
            Poses, shape (n, 3), NaN for robots that were not detected; and ages, shape (n,), s.
        """


class RadioModel(Protocol):
    """Radio as the loop uses it, see `omni_mj.network.radio.Radio`."""

    def exchange(self, command: Array, heading: Array) -> ReceivedCommand:
        """Send commands, and return those that act in this frame.

        Args:
            command: Commands, shape (n, 3), world frame, m/s and rad/s.
            heading: Estimated headings, shape (n,), rad.
        """


@check_types
class Simulation:
    """Simulation of a scenario, to be run as a whole or stepped.

    Args:
        scenario: The scenario.
        controllers: Names, `file.py:Class` or classes. Default: those of the scenario.
        seeds: Seeds; each gives a row per controller. Default: those of the scenario.
        rows: Rows to simulate, with labels of the controllers. Default: all controllers with all
            seeds.
        build_reference: Returns the reference of a controller's rows, given their indices. Default:
            the references of the rows' settings.
        keep_log: Whether frames are recorded.

    Attributes:
        scenario: The scenario, with these controllers.
        rows: The n rows.
        references: Timed reference of each row, against which errors are measured.
        plant: The simulated robots.
        camera: The cameras.
        radio: The radio.
        team: The controllers and the pose filters.
        log: The recorded frames. Without rows if `keep_log` is false.
        frame: Index of the next frame.
        failures: Failures of rows that stopped before their end, in order of time.
        received: Commands that the robots received in the latest frame.

    Raises:
        OmniError: A controller does not exist or is named twice, the rows cannot share a plant, the
            plant does not support a fault, or the dead time exceeds the length of a reference.
    """

    has_true_poses = True  # for the log
    received: ReceivedCommand

    def __init__(
        self,
        scenario: Scenario,
        controllers: Iterable[plugins.ControllerSpec] | None = None,
        seeds: Iterable[int] | None = None,
        rows: Sequence[Row] | None = None,
        build_reference: ReferenceFactory | None = None,
        keep_log: bool = True,
    ) -> None:
        self._keep_log, self._build_reference = keep_log, build_reference
        if controllers is not None:
            scenario = scenario.replace(controllers=tuple(controllers))
        self.scenario = scenario
        self._controller_classes = {
            plugins.label_controller(kind): plugins.find_controller(kind)
            for kind in scenario.controllers
        }
        seed_list = scenario.seed_list
        if seeds is not None:
            seed_list = [check_integer("seed", seed, 0, MAX_SEED) for seed in seeds]
        self._has_random_settings = bool(scenario.distributions) and rows is None
        self._initial_rows = rows or build_rows(
            self._controller_classes, seed_list, scenario.settings_for_seed, scenario.robot
        )
        if not self._initial_rows:
            raise OmniError("a simulation needs at least one controller and one seed")
        for label in dict.fromkeys(row.controller for row in self._initial_rows):
            if label not in self._controller_classes:
                hint = suggest_names(label, self._controller_classes)
                raise OmniError(f"a row names the controller {label!r}; {hint}")
        self._check_rows()
        self._choose_backend()
        self.reset()

    def _check_rows(self) -> None:
        """Raise `OmniError` if the faults or the dead time of a row are invalid."""
        for settings in {id(row.settings): row.settings for row in self._initial_rows}.values():
            n_robots = len(settings.world.start_poses)
            fault_checks.check_plant_supports(settings.fault, self.scenario.plant, n_robots)
        self.references = reference_factory.build_timed_references(self._initial_rows)
        for row, reference in zip(self._initial_rows, self.references, strict=True):
            delay_frames = row.settings.radio.delay_frames
            if delay_frames >= reference.frames:
                raise OmniError(
                    f"radio.delay_frames must be less than the {reference.frames} frames of the "
                    f"reference, got {delay_frames}: no command would act before its end. Extend "
                    "the reference with reference.settle_s"
                )

    def _choose_backend(self) -> None:
        """Replace `physics.backend = "auto"`, so that scenario.toml names the backend used."""
        plant, n_rows = self.scenario.plant, len(self._initial_rows)
        n_frames = max(reference.frames for reference in self.references)

        def resolve(settings: Settings) -> Settings:
            backend = choose_backend(settings.physics.backend, plant, n_rows, n_frames)
            physics = settings.physics.model_copy(update={"backend": backend})
            return settings.model_copy(update={"physics": physics})

        # Rows share settings, so that each is resolved only once.
        settings_by_id = {id(row.settings): row.settings for row in self._initial_rows}
        resolved = {key: resolve(settings) for key, settings in settings_by_id.items()}
        self._initial_rows = [
            replace(row, settings=resolved[id(row.settings)]) for row in self._initial_rows
        ]
        if self.scenario.settings.physics.backend == "auto":
            self.scenario = self.scenario.replace(settings=resolve(self.scenario.settings))

    @check_types
    def reset(self, seed: int | None = None) -> None:
        """Return to the start. The same commands then give the same frames.

        Args:
            seed: New smallest seed; the others are shifted by the same number. Default: the seeds
                of the first run.
        """
        seeds = [row.seed for row in self._initial_rows]
        max_seed = MAX_SEED - max(seeds) + min(seeds)
        shift = 0 if seed is None else check_integer("seed", seed, 0, max_seed) - min(seeds)
        self.rows = [replace(row, seed=row.seed + shift) for row in self._initial_rows]
        if shift and self._has_random_settings:
            settings = {row.seed: self.scenario.settings_for_seed(row.seed) for row in self.rows}
            self.rows = [replace(row, settings=settings[row.seed]) for row in self.rows]
        self.references = reference_factory.build_timed_references(self.rows)
        self.frame, self.failures = 0, list[Failure]()
        self._is_stopped = np.zeros(len(self.rows), bool)
        self._observation: Observation | None = None
        start_poses = np.array([reference.poses[0] for reference in self.references])
        self.plant, self.camera, self.radio = self._build_plant_and_link(start_poses)
        self.team = build_team(
            self.rows,
            self._controller_classes,
            start_poses,
            has_wheels=self.plant.geometry is not None,
            on_failure=self._stop,
            build_reference=self._build_reference,
        )
        self._n_frames = np.array([reference.frames for reference in self.references])
        # Many rows share a few references. Their poses are looked up once per reference: a look-up
        # per row would take a sixth of the time of a frame with 2048 kinematic robots.
        self._distinct_references = list(dict.fromkeys(self.references))
        indices = {reference: i for i, reference in enumerate(self._distinct_references)}
        self._reference_indices = np.array([indices[reference] for reference in self.references])
        n_wheels = self.plant.telemetry().wheel_angle.shape[1]
        log_rows = self.rows if self._keep_log else []
        self.log = Log(log_rows, n_wheels, self.has_true_poses)

    @property
    def done(self) -> bool:
        """Whether every row has reached the end of its reference or was stopped."""
        return not np.count_nonzero(self._is_active)  # faster than .any() on small arrays

    @property
    def drawn_parameters(self) -> dict[str, Array]:
        """Parameters and settings that were drawn for each row, name -> shape (n,)."""
        parameters: dict[str, Array] = {}
        if hasattr(self.plant, "variation"):
            parameters |= self.plant.variation.to_columns()
        for name in self.scenario.distributions:
            parameters[name] = np.array([attrgetter(name)(row.settings) for row in self.rows])
        return parameters

    @check_types
    def run(self, after_frame: Callable[[int], None] = lambda frame: None) -> Log:
        """Run from the start to the end.

        Args:
            after_frame: Called with the index of each frame after it was recorded.
        """
        if self.frame:
            self.reset()
        while not self.done:
            self.step()
            after_frame(self.frame - 1)
        return self.log

    def observe(self) -> Observation:
        """Return the team's observation of this frame. Further calls return the same object."""
        if self._observation is None:
            self._pose = self.plant.pose()
            measured_pose, age = self.camera(self._pose)
            self._is_detected = ~np.isnan(measured_pose[:, 0])
            truth = (self._pose, self.plant.twist()) if self.team.knows_truth else None
            self._observation = self.team.observe(measured_pose, truth, age)
        return self._observation

    def step(self, command: Array | None = None) -> None:
        """Advance by one frame: command, send, record, move.

        Args:
            command: Twists, shape (n, 3), world frame, m/s and rad/s. The limits of the team apply.
                Default: the controllers' commands.

        Raises:
            OmniError: The command is not an array of finite numbers of shape (n, 3).
        """
        extrapolated_pose = self.observe().extrapolated_pose
        sent = self.team.command(command)
        received = self.received = self.radio.exchange(sent, self.team.estimate[:, 2])
        if self._keep_log:
            self._record(extrapolated_pose, sent, received)
        failed = self.plant.advance(received)
        self.frame, self._observation = self.frame + 1, None
        for row, cause in failed.items():
            self._stop(np.array([row]), cause)
            self.team.stop(np.array([row]))

    def _build_plant_and_link(self, start_poses: Array) -> tuple[Plant, CameraModel, RadioModel]:
        """Return the robots at their start poses, shape (n, 3), the cameras and the radio."""
        settings = [row.settings for row in self.rows]
        seeds = [row.noise_seed for row in self.rows]
        row_faults = [row.faults for row in self.rows]
        has_cycles = any(needs_cycles(row.settings.radio, row.faults) for row in self.rows)
        return (
            plugins.find_plant(self.scenario.plant)(self.rows, start_poses),
            Cameras(settings, seeds, row_faults),
            Radio(
                [row_settings.radio for row_settings in settings],
                seeds,
                row_faults,
                CYCLES_PER_FRAME if has_cycles else 1,
            ),
        )

    def compute_reference_poses(self, frames_ahead: int = 0) -> Array:
        """Return the poses of the references in this frame, or some frames later, (n, 3)."""
        frame = self.frame + frames_ahead
        poses = np.array(
            [
                reference.poses[min(frame, reference.frames - 1)]
                for reference in self._distinct_references
            ]
        )
        return np.asarray(poses[self._reference_indices])

    def _record(self, extrapolated_pose: Array, sent: Array, received: ReceivedCommand) -> None:
        """Append this frame to the log."""
        self.log.append(
            self._is_active,
            self.team.channels,
            ref=self.compute_reference_poses(),
            pose=self._pose,
            vision=extrapolated_pose,
            vision_valid=self._is_detected,
            predicted=self.team.predicted_pose,
            command=sent,
            applied=received.command,
            alpha_hat=self.team.alpha_hat,
            latency_hat=self.team.latency_hat,
            telemetry=self.plant.telemetry().columns,
        )

    @property
    def _is_active(self) -> np.ndarray:
        """Whether each row still runs, shape (n,)."""
        return ~self._is_stopped & (self.frame < self._n_frames)

    def _stop(self, rows: np.ndarray, cause: object) -> None:
        """Stop rows, given by their indices, and store a failure of each."""
        text = to_printable(str(cause))
        for i in rows[~self._is_stopped[rows]]:
            row = self.rows[i]
            time_s = self.frame * PERIOD_S
            self.failures.append(Failure(int(i), row.controller, row.seed, time_s, text))
        self._is_stopped[rows] = True


def batch_key(plant: str, settings: Settings) -> Hashable:
    """Return a key that is equal for settings whose rows can share a simulation.

    Such rows have the same number of robots in a world. On the plant mujoco they also share the
    robot's mechanics and the physics settings, on planar the wheels.
    """
    n_robots = len(settings.world.start_poses)
    if plant == "mujoco":
        return settings.mechanics, settings.physics, n_robots
    if plant == "planar":
        return settings.wheels, n_robots
    return n_robots
