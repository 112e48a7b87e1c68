"""A scenario that robots drive frame by frame, while its settings change and things happen to them.

It knows no browser: `omni_mj.play.play_page` shows it.
"""

from collections import deque
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np

from omni_control.controllers.registry import CONTROLLERS
from omni_control.errors import OmniError
from omni_control.kinematics import Array, world_to_body, wrap_angle
from omni_mj.config import FRAME_RATE_HZ, PERIOD_S, faults, plugins
from omni_mj.config.scenario import Scenario
from omni_mj.config.settings import find_setting
from omni_mj.play.time_limit import TimeLimitError
from omni_mj.results.alpha_windows import ALPHA_START_FRAMES, ALPHA_WINDOW_FRAMES, driven_alpha
from omni_mj.simulation.changeable_simulation import ChangeableSimulation
from omni_mj.viz.displayed_robots import name_and_color
from omni_mj.viz.recording import Recording
from omni_mj.viz.style import Rgb

MAX_CONTROLLERS = 3
PUSH_N, PUSH_S = 40.0, 0.2
DEBRIS_RADIUS_M, DEBRIS_FRICTION = 0.3, 0.1
DEBRIS_AHEAD_FRAMES = FRAME_RATE_HZ // 2  # debris lies where the reference is in half a second
CARRY_M, CARRY_DEG = 0.5, 60.0


@dataclass(frozen=True)
class Snapshot:
    """The n robots in a frame. NaN stands for unknown values.

    Attributes:
        time_s: Time since the start, s.
        reference: Poses of the reference or target, (n, 3) m, m, rad; NaN without a target.
        pose: True poses, (n, 3) m, m, rad.
        predicted: Poses for which the commands were computed, (n, 3) m, m, rad.
        command: Commands sent, world frame, (n, 3) m/s, m/s, rad/s.
        error_m: Distances from the reference or target, (n,) m.
        alpha_hat: The controllers' estimates of alpha, (n, 2).
        winding_c: Temperatures of the hottest windings, (n,) deg C.
        latency_hat: The controllers' estimates of the latency, forward, (n,) frames.
        failures: Messages of the robots that failed.
        has_ended: Whether the reference has ended for all robots that did not fail. They rest.
    """

    time_s: float
    reference: Array
    pose: Array
    predicted: Array
    command: Array
    error_m: Array
    alpha_hat: Array
    winding_c: Array
    latency_hat: Array
    failures: tuple[str, ...]
    has_ended: bool


class PlaySession:
    """Robots that drive a scenario side by side, each controller in its own world.

    Only the scenario's first seed is played, with the settings drawn for it. Without changes the
    frames are those of `omni_mj.run`, bit for bit.

    Args:
        scenario: The scenario.
        controllers: Up to three controllers. Default: those of the scenario.
        record: Path of a recording, .rrd. A restart begins another one: NAME-2.rrd, NAME-3.rrd.

    Attributes:
        simulation: The simulation since the last restart.
        labels: Label of each robot: its controller, with its slot if worlds have several robots.
        colors: Color of each robot, RGB bytes.
        snapshot: The latest frame, at first the start.

    Raises:
        OmniError: The scenario or a controller cannot be played.
    """

    simulation: ChangeableSimulation
    labels: tuple[str, ...]
    colors: tuple[Rgb, ...]
    snapshot: Snapshot

    def __init__(
        self,
        scenario: Scenario,
        controllers: Sequence[plugins.ControllerSpec] | None = None,
        record: Path | None = None,
    ) -> None:
        self._recording_paths = _number_paths(record) if record else None
        self._recording: Recording | None = None
        # Classes of users' files that have an error since they were saved again
        self._errors: dict[plugins.ControllerSpec, BaseException] = {}
        self.restart(scenario, controllers)

    @property
    def scenario(self) -> Scenario:
        """The scenario with all settings as they are now, without the effects of buttons."""
        return self.simulation.scenario

    def restart(
        self,
        scenario: Scenario | None = None,
        controllers: Sequence[plugins.ControllerSpec] | None = None,
    ) -> None:
        """Return to the start of the reference, with the same noise.

        Args:
            scenario: Another scenario. Default: the present one, with the present settings.
            controllers: Other controllers. Default: those of the scenario.

        Raises:
            OmniError: The scenario or a controller cannot be played. The session then goes on.
        """
        scenario = _choose_controllers(scenario or self.scenario, controllers)
        settings = scenario.settings_for_seed(scenario.seed)
        scenario = scenario.replace(seeds=1, settings=settings, distributions={})
        simulation = ChangeableSimulation(scenario, keep_log=self._recording_paths is not None)
        self.close()
        self.simulation, rows = simulation, simulation.rows
        self.labels, self.colors = zip(*name_and_color(rows), strict=True)
        # Faults that buttons cause, by row
        self._faults: list[list[faults.Fault]] = [[] for _ in rows]
        # In the latest frames: displacements, m, and commands, m/s, body frame, (2, n, 2)
        self._alpha_history = deque[Array](maxlen=ALPHA_START_FRAMES + ALPHA_WINDOW_FRAMES)
        self.snapshot = Snapshot(**self._read_plant(), **self._read_team())
        self._stop_failed()
        if self._recording_paths:
            self._recording = Recording(next(self._recording_paths), simulation)

    def advance(self) -> Snapshot:
        """Advance by a frame of 1/60 s, and return the snapshot of that frame."""
        plant_values = self._read_plant()
        pose = plant_values["pose"]
        self.simulation.step()
        achieved = self.simulation.plant.pose() - pose
        motions = achieved, self.simulation.received.command
        in_body = [world_to_body(motion, pose[:, 2])[:, :2] for motion in motions]
        self._alpha_history.append(np.array(in_body))
        self.snapshot = Snapshot(**plant_values, **self._read_team())
        if self._recording:
            self._recording.update()
        return self.snapshot

    def change(self, name: str, value: Any) -> bool:
        """Change a setting, for the driving robots if that is possible.

        Args:
            name: Name, such as "radio.delay_frames" or "controller.Mine.gain".
            value: Value.

        Returns:
            Whether the robots drive on. If not, the session has restarted.

        Raises:
            OmniError: There is no such setting, or its value is not allowed. Nothing has changed.
        """
        section, _, field = name.partition(".")
        if section == "controller":
            label, _, parameter = field.partition(".")
            change: dict[str, Any] = {label: {parameter: value}}
        else:
            is_int = find_setting(name).value_type is int
            is_whole = is_int and isinstance(value, float) and value.is_integer()
            change = {field: int(value) if is_whole else value}
        settings = self.scenario.settings.replace(**{section: change})
        can_change = self.simulation.can_change(settings)
        if can_change:
            self.simulation.change_settings(settings, self._faults)
        else:
            self.restart(self.scenario.replace(settings=settings))
        return can_change

    def push(self) -> None:
        """Push each robot to its left."""
        directions = np.degrees(wrap_angle(self.simulation.plant.pose()[:, 2] + np.pi / 2))
        self._add_faults(
            faults.Push(
                start_s=self._now, duration_s=PUSH_S, force_n=PUSH_N, direction_deg=direction
            )
            for direction in directions.tolist()
        )

    def spill_debris(self) -> None:
        """Spill debris where references are in half a second, or below robots without one."""
        pose = self.simulation.plant.pose()
        if self.simulation.targets is None:
            pose = self.simulation.compute_reference_poses(DEBRIS_AHEAD_FRAMES)
        self._add_faults(
            faults.FrictionPatch(
                start_s=self._now,
                x_m=x,
                y_m=y,
                radius_m=DEBRIS_RADIUS_M,
                friction=DEBRIS_FRICTION,
            )
            for x, y, _ in pose.tolist()
        )

    def carry_away(self) -> None:
        """Carry each robot towards the middle of the field, and turn it."""
        displacements = -np.copysign(CARRY_M, self.simulation.plant.pose()[:, :2])
        self._add_faults(
            faults.Kidnap(start_s=self._now, x_m=x, y_m=y, heading_deg=CARRY_DEG)
            for x, y in displacements.tolist()
        )
        self._alpha_history.clear()

    def set_lost(self, kind: type[faults.Fault], is_lost: bool) -> None:
        """Let the fault `RadioLoss` or `VisionLoss` act on all robots from now on, or end it."""
        self._faults = [[f for f in row if not isinstance(f, kind)] for row in self._faults]
        self._add_faults([kind(start_s=self._now)] * (is_lost * len(self._faults)))

    def set_target(self, x: float, y: float) -> None:
        """Let the first robot of each world drive to a target and keep its heading.

        Args:
            x: World frame, m.
            y: World frame, m.
        """
        estimate = self.simulation.team.estimate
        for i in self._choose_first_rows():
            self.simulation.set_target(i, [x, y, estimate[i, 2]])

    def set_velocity(self, vx: float, vy: float, turn: float) -> None:
        """Let the first robot of each world drive at a velocity, until a restart.

        Args:
            vx: World frame, m/s.
            vy: World frame, m/s.
            turn: Turn rate, rad/s.
        """
        for i in self._choose_first_rows():
            self.simulation.set_velocity(i, [vx, vy, turn])

    def reload_controller(self, spec: plugins.ControllerSpec) -> None:
        """Restart with the present text of a user's file, and with the parameters in it.

        If it has an error, its robots stand, until it is saved again.

        Args:
            spec: One of the scenario's controllers that are classes.
        """
        try:
            saved = _load_class(plugins.format_controller_spec(spec))
            self._errors.pop(saved, None)  # an older file that was restored
            present = self.scenario.controllers
            self.restart(controllers=[saved if other == spec else other for other in present])
        except (OmniError, TimeLimitError) as error:
            self._errors[spec] = error
            self._stop_failed()

    def compute_alpha(self) -> Array:
        """Return the true alpha of the last 0.25 s, forward and sideways, (n, 2).

        It is the achieved over the commanded displacement; NaN near standstill.
        """
        n = len(self.labels)
        if len(self._alpha_history) < ALPHA_WINDOW_FRAMES:
            return np.full((n, 2), np.nan)
        achieved, commanded = np.moveaxis(np.array(self._alpha_history), 1, 0)
        position = np.cumsum(np.concatenate([np.zeros((1, n, 2)), achieved]), axis=0)
        velocity = np.concatenate([commanded, np.zeros((1, n, 2))])
        return np.asarray(driven_alpha(position, velocity)[-1])

    def list_faults(self, kind: type[Any]) -> list[Any]:
        """Return the faults of a kind that buttons cause, in all rows."""
        return [fault for row in self._faults for fault in row if isinstance(fault, kind)]

    def close(self) -> None:
        """Finish the recording."""
        recording, self._recording = self._recording, None
        if recording:
            with recording:
                recording.write()

    @property
    def _now(self) -> float:
        """Time of the next frame, s."""
        return self.simulation.frame * PERIOD_S

    def _read_plant(self) -> dict[str, Any]:
        """Return what a snapshot says about the robots, before the frame ends."""
        simulation = self.simulation
        pose, telemetry = simulation.plant.pose(), simulation.plant.telemetry()
        reference = simulation.compute_reference_poses()
        return {
            "time_s": self._now,
            "reference": reference,
            "pose": pose,
            "error_m": np.hypot(*(pose - reference)[:, :2].T),
            "winding_c": telemetry.winding.max(1),
            "has_ended": simulation.done and len(simulation.failures) < len(pose),
        }

    def _read_team(self) -> dict[str, Any]:
        """Return what a snapshot says about the controllers, after the frame."""
        team = self.simulation.team
        alpha_hat = team.alpha_hat[:, :2]
        return {
            "predicted": team.predicted_pose,
            "command": team.last_command,
            "alpha_hat": np.where(alpha_hat == 1, np.nan, alpha_hat),  # 1: no estimate
            "latency_hat": team.latency_hat[:, 0],
            "failures": tuple(map(str, self.simulation.failures)),
        }

    def _stop_failed(self) -> None:
        """Let the robots of files with errors stand."""
        for spec, error in self._errors.items():
            if spec in self.scenario.controllers:
                label = plugins.label_controller(spec)
                rows = [i for i, row in enumerate(self.simulation.rows) if row.controller == label]
                self.simulation.stop_rows(np.array(rows), error)

    def _choose_first_rows(self) -> list[int]:
        """Return the row of the first robot of each world."""
        return [i for i, row in enumerate(self.simulation.rows) if not row.slot]

    def _add_faults(self, added: Iterable[faults.Fault]) -> None:
        """Let faults act from now on, one for each robot.

        Raises:
            OmniError: The plant does not support them.
        """
        settings = self.scenario.settings
        if not self.simulation.can_change(settings):
            raise OmniError(f"the plant {self.scenario.plant} cannot be disturbed while it runs")
        row_faults = [list(present) for present in self._faults]
        for present, fault in zip(row_faults, added, strict=False):  # none are added at an end
            present.append(fault)
        self.simulation.change_settings(settings, row_faults)
        self._faults = row_faults


def _choose_controllers(
    scenario: Scenario, controllers: Sequence[plugins.ControllerSpec] | None
) -> Scenario:
    """Return the scenario with these controllers, and with the parameters of no others."""
    controllers = scenario.controllers if controllers is None else controllers
    if len(controllers) > MAX_CONTROLLERS:
        raise OmniError(f"at most {MAX_CONTROLLERS} controllers, got {len(controllers)}")
    kept = [*map(_load_class, scenario.controllers)]
    controllers = [*map(_load_class, controllers)]
    labels = {plugins.label_controller(spec) for spec in controllers if spec in kept}
    parameters = scenario.settings.controller
    chosen = {label: values for label, values in parameters.items() if label in labels}
    settings = scenario.settings.model_copy(update={"controller": chosen})
    return scenario.replace(controllers=tuple(controllers), settings=settings)


def _load_class(spec: plugins.ControllerSpec) -> plugins.ControllerSpec:
    """Return the class of a user's file, or the name of another controller."""
    return spec if spec in CONTROLLERS else plugins.find_controller(spec)


def _number_paths(path: Path) -> Iterator[Path]:
    """Yield NAME.rrd, NAME-2.rrd, NAME-3.rrd and so on."""
    yield path
    for number in count(2):
        yield path.with_stem(f"{path.stem}-{number}")
