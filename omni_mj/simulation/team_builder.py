"""Construction of the team: the controllers and the pose filters of all rows.

Rows with equal settings share a controller, which computes their commands together.
"""

from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache

import numpy as np

from omni_control.controllers.base import Controller, TeamModel
from omni_control.controllers.registry import make_controller
from omni_control.errors import ControllerError
from omni_control.kinematics import Array, Kinematics
from omni_control.reference import Reference, combine_references
from omni_control.team_computer import Team
from omni_mj.config import PERIOD_S, reference_factory
from omni_mj.config.rows import Row
from omni_mj.config.settings import Settings

# Lag (s), dry friction (m/s) and creep (s^2/m) on plants without wheels. Zero means unknown.
NEGLIGIBLE = 1e-9
ReferenceFactory = Callable[[np.ndarray], Reference]  # indices of rows -> their reference
Parameters = tuple[tuple[str, float | bool | str], ...]  # names and values, sorted by name


def build_team(
    rows: Sequence[Row],
    controller_classes: Mapping[str, type[Controller]],
    start_poses: Array,
    has_wheels: bool,
    on_failure: Callable[[np.ndarray, ControllerError], None],
    build_reference: ReferenceFactory | None,
) -> Team:
    """Return the team with the controllers of all rows.

    Args:
        rows: The rows.
        controller_classes: Label -> class.
        start_poses: Shape (n, 3).
        has_wheels: Whether the plant simulates wheels. If not, the team assumes no lag, no dry
            friction and no creep.
        on_failure: Called with the indices of a controller's rows if it fails, and the error.
        build_reference: Returns the reference of rows, given their indices. None: the references of
            the rows' settings.
    """
    controllers, indices, failed_rows = build_controllers(
        rows, controller_classes, has_wheels, on_failure, build_reference
    )
    team = Team(controllers, start_poses, indices, on_failure=on_failure)
    team.stop(failed_rows)
    return team


def build_controllers(
    rows: Sequence[Row],
    controller_classes: Mapping[str, type[Controller]],
    has_wheels: bool,
    on_failure: Callable[[np.ndarray, ControllerError], None],
    build_reference: ReferenceFactory | None,
) -> tuple[list[Controller], list[np.ndarray], np.ndarray]:
    """Return the controllers of all rows; see `build_team`.

    Returns:
        Controllers, one for each group of rows with equal settings; indices of the rows of each;
        and indices of the rows whose controllers could not be built.
    """
    geometry = rows[0].settings.wheels.kinematics
    groups: dict[tuple[str, TeamModel, object, Parameters], list[int]] = {}
    for i, row in enumerate(rows):
        shared_reference: object = None
        # Only timed references may differ between the rows of a controller.
        if build_reference or _is_iterated(row):
            limits = reference_factory.build_reference_limits(row.settings)
            shared_reference = row.settings.reference, limits, row.start_pose
        model = build_team_model(row.settings, geometry, has_wheels)
        key = row.controller, model, shared_reference, _list_parameters(row)
        groups.setdefault(key, []).append(i)
    controllers: list[Controller] = []
    controller_rows = [np.array(indices) for indices in groups.values()]
    failed_rows: list[int] = []
    for (label, model, _, parameters), indices in zip(groups, controller_rows, strict=True):
        if build_reference is None:
            reference = _build_group_reference([rows[i] for i in indices])
        else:
            reference = build_reference(indices)
        controller_class, n = controller_classes[label], len(indices)
        try:
            controller = make_controller(controller_class, model, reference, n, dict(parameters))
        except ControllerError as error:
            on_failure(indices, error)
            failed_rows.extend(indices)
            controller = Controller(model, reference, n)  # placeholder that is never called
        controllers.append(controller)
    return controllers, controller_rows, np.array(failed_rows, int)


@lru_cache(maxsize=4096)
def build_team_model(settings: Settings, geometry: Kinematics, has_wheels: bool) -> TeamModel:
    """Return the model of the robot and the loop that the team knows in advance.

    Args:
        settings: Settings of a row.
        geometry: Geometry of the wheels.
        has_wheels: Whether the plant simulates wheels.
    """
    control, vision = settings.control, settings.vision
    alpha = control.assumed_alpha_forward, control.assumed_alpha_sideways
    return TeamModel(
        period=PERIOD_S,
        delay_frames=max(settings.radio.mean_delay_frames + control.delay_error_frames, 0),
        lag_s=control.assumed_lag_s if has_wheels else NEGLIGIBLE,
        friction_loss_m_s=control.assumed_friction_loss_m_s if has_wheels else NEGLIGIBLE,
        creep_s2_m=control.assumed_creep_s2_m if has_wheels else NEGLIGIBLE,
        creep_sideways_s2_m=control.assumed_creep_sideways_s2_m if has_wheels else NEGLIGIBLE,
        friction=settings.reference.assumed_friction,
        alpha=alpha if has_wheels and min(alpha) > 0 else None,
        position_noise_m=vision.position_noise_m,
        heading_noise_rad=vision.heading_noise_rad,
        error_range_m=control.error_range_m,
        speed_range_m_s=control.speed_range_m_s,
        heading_gain=control.heading_gain,
        alpha_window_frames=control.alpha_window_frames,
        geometry=geometry,
        limits=reference_factory.build_motion_limits(control),
    )


def _build_group_reference(rows: Sequence[Row]) -> Reference:
    """Return the reference of rows that share a controller."""
    if _is_iterated(rows[0]):
        return reference_factory.build_iterated_reference(
            rows[0].settings, len(rows), rows[0].start_pose
        )
    return combine_references(reference_factory.build_timed_references(rows))


def _is_iterated(row: Row) -> bool:
    return row.settings.reference.mode == "iterated"


def _list_parameters(row: Row) -> Parameters:
    """Return names and values of the controller's parameters in a row's settings."""
    return tuple(sorted(row.settings.controller.get(row.controller, {}).items()))
