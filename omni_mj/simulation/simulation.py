"""The loop: camera, filter, reference, controller, limits, radio, plant, record; 60 times a simulated second.

All robots run side by side as rows of arrays. `run` is the loop; `observe` and `step` are what it is made of.
"""

from collections.abc import Callable, Hashable, Iterable, Sequence
from dataclasses import dataclass, replace
from operator import attrgetter
from typing import Protocol

import numpy as np

from omni_control.controllers.base import Controller, Observation
from omni_control.errors import OmniError, suggest_names, to_printable
from omni_control.kinematics import Array
from omni_control.reference import SampledReference
from omni_mj.config import faults, plugins, reference_factory
from omni_mj.config.rows import Row, build_rows
from omni_mj.config.scenario import Scenario
from omni_mj.config.settings import PERIOD_S, Settings
from omni_mj.mjcf.robot_spec import RobotShape
from omni_mj.network.camera import Cameras
from omni_mj.network.radio import Radio, ReceivedCommand
from omni_mj.plants import Plant
from omni_mj.robot.backends import choose_backend
from omni_mj.simulation.log import Log
from omni_mj.simulation.teams import ReferenceFactory, build_team

_OF_PLANT = {
    "mujoco": {"body", "wheels", "motor", "model", "physics"},
    "planar": {"wheels"},
}  # sections that keys see


class CameraModel(Protocol):
    """What cameras do; see `omni_mj.network.camera.Cameras`."""

    measurement_age: Array | None

    def __call__(self, pose: Array) -> tuple[Array, np.ndarray]:
        """Return the poses seen (n, 3) of robots at true poses, and whether each was seen (n,)."""
        ...


class RadioModel(Protocol):
    """What a radio does; see `omni_mj.network.radio.Radio`."""

    def exchange(self, command: Array, heading: Array) -> ReceivedCommand:
        """Send commands (n, 3) and headings (n,); return what the robots hold in this frame."""
        ...


@dataclass(frozen=True)
class Failure:
    """A row that was stopped before its end.

    Attributes:
        row: its number.
        controller, seed: what it is called.
        time_s: when, s.
        cause: why, in words.
    """

    row: int
    controller: str
    seed: int
    time_s: float
    cause: str

    def __str__(self) -> str:
        return f"{self.controller}, seed {self.seed}: {self.cause} at {self.time_s:.3f} s"


class Simulation:
    """A scenario, ready to be run or stepped.

    Args:
        scenario: what is run.
        controllers: names, `file.py:Class` or classes. [the scenario's]
        seeds: of the random numbers, a row each per controller. [the scenario's]
        rows: the table of rows, where they are not all seeds of all controllers under the
            scenario's settings.
        follow: what a controller's rows, given by their numbers, are to follow in place of what
            their settings say.
        logged: whether what happens is recorded.

    Attributes:
        scenario: as given, with these controllers.
        rows: the table of rows, n of them.
        references: the timed reference of each row, against which errors are measured.
        plant: what moves.
        log: what has been recorded so far; of no row, if nothing shall be.
        frame: number of the next frame.
        failures: the rows that were stopped before their end, in that order.

    Raises:
        OmniError: there is no such controller, one is named twice, the rows cannot share a plant,
            or it does not know what shall happen to one of them; or no command would arrive before
            the end.
    """

    def __init__(
        self,
        scenario: Scenario,
        controllers: Iterable[str | type[Controller]] | None = None,
        seeds: Iterable[int] | None = None,
        rows: Sequence[Row] | None = None,
        follow: ReferenceFactory | None = None,
        logged: bool = True,
    ) -> None:
        self._logged = logged
        self.scenario = (
            scenario if controllers is None else scenario.replace(controllers=tuple(controllers))
        )
        self._kinds = {
            plugins.label_controller(kind): plugins.find_controller(kind)
            for kind in self.scenario.controllers
        }
        given = scenario.seed_list if seeds is None else list(seeds)
        self._draws = bool(scenario.distributions) and rows is None
        self._table = rows or build_rows(
            self._kinds, given, scenario.settings_for_seed, scenario.robot
        )
        for label in dict.fromkeys(row.controller for row in self._table):
            if label not in self._kinds:
                raise OmniError(
                    f"a row names the controller {label!r}; {suggest_names(label, self._kinds)}"
                )
        for settings in {id(row.settings): row.settings for row in self._table}.values():
            faults.check_plant_supports(
                settings.fault, self.scenario.plant, len(settings.world.start_poses)
            )
        self._follow = follow
        self.references = [
            reference_factory.build_timed_reference(row.settings, row.start_pose)
            for row in self._table
        ]
        _check_delays(self._table, self.references)
        self._choose_backend()
        self.reset()

    def _choose_backend(self) -> None:
        """Set `physics.backend` where it is auto, so that the scenario's file says what was taken."""
        plant, frames = self.scenario.plant, max(reference.frames for reference in self.references)
        chosen: dict[int, Settings] = {}

        def settled(settings: Settings) -> Settings:
            if id(settings) not in chosen:
                backend = choose_backend(settings.physics.backend, plant, len(self._table), frames)
                physics = settings.physics.model_copy(update={"backend": backend})
                chosen[id(settings)] = settings.model_copy(update={"physics": physics})
            return chosen[id(settings)]

        self._table = [replace(row, settings=settled(row.settings)) for row in self._table]
        if self.scenario.settings.physics.backend == "auto":
            self.scenario = self.scenario.replace(settings=settled(self.scenario.settings))

    def reset(self, seed: int | None = None) -> None:
        """Go back to the start; from there the same steps give the same run.

        Args:
            seed: from where the seeds of the rows count. [from where they did]
        """
        shift = 0 if seed is None else seed - min(row.seed for row in self._table)
        self.rows = [replace(row, seed=row.seed + shift) for row in self._table]
        if shift and self._draws:
            settings = {row.seed: self.scenario.settings_for_seed(row.seed) for row in self.rows}
            self.rows = [replace(row, settings=settings[row.seed]) for row in self.rows]
        n = len(self.rows)
        self.references = [
            reference_factory.build_timed_reference(row.settings, row.start_pose)
            for row in self.rows
        ]
        self.frame, self.failures = 0, list[Failure]()
        self._running = np.ones(n, bool)
        self._seen: Observation | None = None
        start = np.array([reference.poses[0] for reference in self.references])
        geometry = self.rows[0].settings.wheels.kinematics
        self.plant, self.camera, self.radio = self._robots(start)
        rolls, wheels = self.plant.geometry is not None, self.plant.telemetry().wheel_angle.shape[1]
        self.team = build_team(
            self.rows, self._kinds, start, geometry, rolls, self._stop, self._follow
        )
        self._frames = np.array([reference.frames for reference in self.references])
        # Many rows follow few: to look up each row's by itself takes a sixth of a frame of 2048
        # robots on `kinematic`.
        numbers = {
            reference: number for number, reference in enumerate(dict.fromkeys(self.references))
        }
        self._distinct, self._followed = (
            list(numbers),
            np.array([numbers[each] for each in self.references]),
        )
        self.log = Log(self.rows if self._logged else [], wheels, int(self._frames.max()))

    @property
    def done(self) -> bool:
        """Whether every row has come to the end of its reference, or was stopped before."""
        return not np.count_nonzero(self._recorded)

    @property
    def drawn_parameters(self) -> dict[str, Array]:
        """What sets the rows' robots apart, name -> (n,); nothing where all are alike, or the plant draws nothing."""
        columns: dict[str, Array] = (
            self.plant.variation.columns() if hasattr(self.plant, "variation") else {}
        )
        named = self.scenario.distributions
        return columns | {
            name: np.array([attrgetter(name)(row.settings) for row in self.rows]) for name in named
        }

    def run(self, after_frame: Callable[[int], None] = lambda frame: None) -> Log:
        """Run from the start to the end; `after_frame` is called with each frame's number once it is in the log."""
        if self.frame:
            self.reset()
        while not self.done:
            self.step()
            after_frame(self.frame - 1)
        return self.log

    def observe(self) -> Observation:
        """What the team sees of all robots in this frame; the same, however often it is asked before the next step."""
        if self._seen is None:
            self._pose = self.plant.pose()
            measured, self._valid = self.camera(self._pose)
            truth = (self._pose, self.plant.twist()) if self.team.knows_truth else None
            self._seen = self.team.observe(measured, truth, self.camera.measurement_age)
        return self._seen

    def step(self, command: Array | None = None) -> None:
        """Go on by a frame: command, send, record, move.

        Args:
            command: velocities [vx, vy, w] wanted of the robots, (n, 3), world frame, m/s and
                rad/s, in place of what the controllers want; they are limited as those are.

        Raises:
            OmniError: the command is not (n, 3) finite numbers.
        """
        vision = self.observe().extrapolated_pose
        sent = self.team.command(command)
        received = self.radio.exchange(sent, self.team.estimate[:, 2])
        if self._logged:
            self._record(vision, sent, received)
        failed = self.plant.advance(received)
        self.frame, self._seen = self.frame + 1, None
        for row, cause in failed.items():
            self._stop(np.array([row]), cause)
            self.team.stop(np.array([row]))

    def _robots(self, start: Array) -> tuple[Plant, CameraModel, RadioModel]:
        """Return the robots at the start (n, 3), and what is between them and the team."""
        seeds, own_faults = [row.noise_seed for row in self.rows], [row.faults for row in self.rows]
        return (
            plugins.find_plant(self.scenario.plant)(self.rows, start),
            Cameras([row.settings.vision for row in self.rows], seeds, own_faults),
            Radio([row.settings.radio for row in self.rows], seeds, own_faults),
        )

    def _record(self, vision: Array, sent: Array, received: ReceivedCommand) -> None:
        poses = np.array([each.poses[min(self.frame, each.frames - 1)] for each in self._distinct])
        self.log.append(
            self._recorded,
            self.team.channels,
            ref=poses[self._followed],
            pose=self._pose,
            vision=vision,
            vision_valid=self._valid,
            predicted=self.team.predicted_pose,
            command=sent,
            applied=received.command,
            alpha_hat=self.team.alpha_hat,
            latency_hat=self.team.latency_hat,
            telemetry=self.plant.telemetry().columns,
        )

    @property
    def _recorded(self) -> np.ndarray:
        """Which rows go on (n,)."""
        return self._running & (self.frame < self._frames)

    def _stop(self, rows: np.ndarray, cause: object) -> None:
        """Stop rows that run, for a cause that can be said in words."""
        reason = to_printable(str(cause))
        for i in rows[self._running[rows]]:
            row = self.rows[i]
            self.failures.append(
                Failure(int(i), row.controller, row.seed, self.frame * PERIOD_S, reason)
            )
        self._running[rows] = False


def _check_delays(rows: Sequence[Row], ways: Sequence[SampledReference]) -> None:
    """See that commands arrive before the end of what rows follow.

    Raises:
        OmniError: none does.
    """
    for row, way in zip(rows, ways, strict=True):
        delay = row.settings.radio.delay_frames
        if delay >= way.frames:
            raise OmniError(
                f"radio.delay_frames = {delay} is no less than the {way.frames} frames of the reference: no command "
                "would arrive before its end; make it shorter, or the reference longer (reference.settle_s)"
            )


def batch_key(plant: str, settings: Settings) -> Hashable:
    """Return a key; rows of a plant with equal keys can share a simulation: those of one model, or of one wheel."""
    n_places = len(settings.world.start_poses)
    if plant == "mujoco":
        return RobotShape.from_settings(settings), settings.physics, n_places
    return (settings.wheels, n_places) if plant == "planar" else n_places


def seeds_share_batch(scenario: Scenario) -> bool:
    """Return whether all seeds of a scenario can share a simulation, whatever they draw."""
    return _OF_PLANT.get(scenario.plant, set()).isdisjoint(
        name.split(".")[0] for name in scenario.distributions
    )
