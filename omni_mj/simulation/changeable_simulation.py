"""A simulation whose settings, faults and targets change while its robots drive."""

from collections.abc import Sequence
from dataclasses import replace
from operator import attrgetter
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from omni_control.errors import OmniError
from omni_control.kinematics import Array
from omni_control.reference import Reference, TargetReference
from omni_mj.config import PERIOD_S, reference_factory
from omni_mj.config.faults import Fault
from omni_mj.config.settings import Settings
from omni_mj.network.camera import Cameras
from omni_mj.network.radio import Radio
from omni_mj.plants.row_checks import MODEL_SETTINGS
from omni_mj.simulation.simulation import Simulation
from omni_mj.simulation.team_builder import build_controllers

# Settings and sections that only a new simulation can change
FIXED_SETTINGS = (
    *MODEL_SETTINGS,
    "reference",
    "randomization",
    "world",
    "sensors.encoder_counts",
    "motor.winding_c",
    "motor.housing_c",
    "kinematic.alpha_correlation_time_s",
    "vision.rate_hz",
)
# Of the radio's settings, those that may change
_CHANGEABLE_RADIO = dict.fromkeys(["delay_frames", "jitter_frames", "loss_probability"], 0)
# Sections on which controllers depend
_TEAM_SECTIONS = "radio", "vision", "control", "controller"


class ChangeableSimulation(Simulation):
    """A simulation of one seed, without random settings, that may change between two frames.

    Until the first change, its frames are those of `Simulation`.

    Attributes:
        targets: Target of each robot, (n, 3), NaN for robots without; None while robots follow the
            reference.
    """

    plant: Any  # a plant of the user's own cannot change
    camera: Cameras
    radio: Radio
    targets: Array | None = None

    def can_change(self, settings: Settings) -> bool:
        """Return whether `change_settings` can apply settings to driving robots."""
        present = self.scenario.settings

        def get_fixed(values: Settings) -> list[Any]:
            return [
                values.radio.replace(**_CHANGEABLE_RADIO),
                *(attrgetter(name)(values) for name in FIXED_SETTINGS),
                reference_factory.build_reference_limits(values),
            ]

        return (
            hasattr(self.plant, "change_rows")
            and get_fixed(settings) == get_fixed(present)
            and self.radio.can_change(settings.radio, settings.fault)
        )

    def change_settings(self, settings: Settings, faults: Sequence[Sequence[Fault]]) -> None:
        """Change settings and faults from the next frame on. Robots keep poses and states.

        All controllers begin anew if a setting on which controllers depend changes. The pose filter
        continues.

        Args:
            settings: Settings of all rows, see `can_change`.
            faults: Further faults of each row.

        Raises:
            OmniError: The plant does not support a fault, or the dead time exceeds the reference.
                Nothing has changed then.
        """
        initial_rows, previous = self._initial_rows, self.scenario.settings
        scenario = self.scenario.replace(settings=settings)
        self._initial_rows = [
            replace(row, settings=settings.replace(fault=[*settings.fault, *row_faults]))
            for row, row_faults in zip(self.rows, faults, strict=True)
        ]
        try:
            self._check_rows()
        except OmniError:
            self._initial_rows = initial_rows
            raise
        self.scenario, self.rows = scenario, self._initial_rows
        self.log.rows[:] = self.rows[: len(self.log.rows)]
        row_faults = [row.faults for row in self.rows]
        self.camera.change_settings([row.settings for row in self.rows], row_faults)
        self.radio.change_settings([row.settings.radio for row in self.rows], row_faults)
        self.plant.change_rows(self.rows)
        if any(getattr(settings, name) != getattr(previous, name) for name in _TEAM_SECTIONS):
            self._replace_controllers()

    def set_target(self, robot: int, pose: ArrayLike) -> None:
        """Let a robot drive to a target from now on. All robots leave the reference.

        Args:
            robot: Index of the robot.
            pose: Target pose [x, y, heading], (3,) m and rad.
        """
        targets = self._begin_targets()
        self.team.set_target(robot, pose)
        targets[robot] = pose
        self.targets = targets

    def set_velocity(self, robot: int, twist: ArrayLike) -> None:
        """Let a robot drive at a velocity from now on. All robots leave the reference.

        Args:
            robot: Index of the robot.
            twist: Desired twist, world frame, (3,) m/s and rad/s.
        """
        targets = self._begin_targets()
        self.team.set_velocity(robot, twist)
        targets[robot] = np.nan
        self.targets = targets

    def stop_rows(self, rows: np.ndarray, cause: object) -> None:
        """Stop rows, given by their indices, until the end; the cause becomes their failure."""
        self.failures = [failure for failure in self.failures if failure.row not in rows]
        self._is_stopped[rows] = False
        self._stop(rows, cause)
        self.team.stop(rows)

    def compute_reference_poses(self, frames_ahead: int = 0) -> Array:
        """See `Simulation`; the targets while there are any."""
        if self.targets is not None:
            return self.targets
        return super().compute_reference_poses(frames_ahead)

    def _begin_targets(self) -> Array:
        """Give all controllers references that lead to targets, and return a copy of `targets`."""
        if self.targets is None:
            self.targets = np.full((len(self.rows), 3), np.nan)
            self._n_frames = np.full(len(self.rows), np.inf)
            self._replace_controllers(is_new_reference=True)
        return self.targets.copy()

    def _replace_controllers(self, is_new_reference: bool = False) -> None:
        """Build all controllers anew. References that depend on the past continue."""
        settings = self.scenario.settings
        team = self.team
        references = {  # by the first row of each controller
            indices[0]: controller.reference
            for indices, controller in zip(team.robot_indices, team.controllers, strict=True)
        }
        limits = reference_factory.build_motion_limits(settings.reference)

        def get_reference(rows: np.ndarray) -> Reference:
            if is_new_reference:
                return TargetReference(limits, PERIOD_S, len(rows))
            return references[rows[0]]

        has_past = self.targets is not None or settings.reference.mode == "iterated"
        controllers, indices, failed_rows = build_controllers(
            self.rows,
            self._controller_classes,
            self.plant.geometry is not None,
            self._stop,
            get_reference if has_past else None,
        )
        team.replace_controllers(controllers, indices)
        team.stop(failed_rows)

    def _record(self, *arguments: Any) -> None:
        if not self.done:  # the log would grow without end
            super()._record(*arguments)
