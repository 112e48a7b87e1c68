"""Construction of the team's computers: controllers and trackers of all rows.

Rows with equal settings share a controller.
"""

from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache

import numpy as np

from omni_control.controllers.base import Controller, TeamModel
from omni_control.controllers.registry import make_controller
from omni_control.errors import ControllerError
from omni_control.kinematics import Array, Kinematics
from omni_control.reference import PerRobotReference, Reference
from omni_control.team import Team
from omni_mj.config import reference_factory
from omni_mj.config.rows import Row
from omni_mj.config.settings import PERIOD_S, Settings

# Lag, drag and creep on plants without wheels. Zero would mean that they are unknown.
NEGLIGIBLE = 1e-9
ReferenceFactory = Callable[[np.ndarray], Reference]


def build_team(
    rows: Sequence[Row],
    controller_classes: Mapping[str, type[Controller]],
    start_poses: Array,
    has_wheels: bool,
    on_failure: Callable[[np.ndarray, ControllerError], None],
    build_reference: ReferenceFactory | None = None,
) -> Team:
    """Return the team with the controllers of all rows.

    Args:
        rows: The rows.
        controller_classes: Label -> class.
        start_poses: Shape (n, 3).
        has_wheels: Whether the plant simulates wheels. If not, the team assumes no lag, drag or
            creep.
        on_failure: Called with the rows of a controller that fails, and the error.
        build_reference: Builds the reference of rows, given their indices. Default: the references
            of the rows' settings.
    """
    geometry = rows[0].settings.wheels.kinematics
    groups: dict[tuple[object, ...], list[int]] = {}
    for i, row in enumerate(rows):
        shared_reference: object = None
        # A reference that is known in advance may differ between the robots of a controller.
        if build_reference or _is_iterated(row):
            limits = reference_factory.build_reference_limits(row.settings)
            shared_reference = row.settings.reference, limits, row.start_pose
        model = build_team_model(row.settings, geometry, has_wheels)
        key = row.controller, model, shared_reference, _list_parameters(row)
        groups.setdefault(key, []).append(i)
    members = [np.array(indices) for indices in groups.values()]
    controllers: list[Controller] = []
    failed_rows = np.array([], int)
    for indices in members:
        row = rows[indices[0]]
        model = build_team_model(row.settings, geometry, has_wheels)
        if build_reference is None:
            reference = _build_group_reference([rows[i] for i in indices])
        else:
            reference = build_reference(indices)
        parameters = dict(_list_parameters(row))
        controller_class, n = controller_classes[row.controller], len(indices)
        try:
            controller = make_controller(controller_class, model, reference, n, parameters)
        except ControllerError as error:
            on_failure(indices, error)
            failed_rows = np.concatenate([failed_rows, indices])
            controller = Controller(model, reference, n)  # placeholder that is never asked
        controllers.append(controller)
    team = Team(controllers, start_poses, members, on_failure=on_failure)
    team.stop(failed_rows)
    return team


@lru_cache(maxsize=4096)
def build_team_model(settings: Settings, geometry: Kinematics, has_wheels: bool) -> TeamModel:
    """Return what the team's computer knows of the loop in advance.

    Args:
        settings: Settings of a row.
        geometry: Geometry of the wheels.
        has_wheels: See `build_team`.
    """
    control, vision = settings.control, settings.vision
    alpha = control.assumed_alpha_forward, control.assumed_alpha_sideways
    return TeamModel(
        period=PERIOD_S,
        delay_frames=max(settings.radio.delay_frames + control.delay_error_frames, 0),
        lag_s=control.assumed_lag_s if has_wheels else NEGLIGIBLE,
        friction_loss_m_s=control.assumed_friction_loss_m_s if has_wheels else NEGLIGIBLE,
        creep_s2_m=control.assumed_creep_s2_m if has_wheels else NEGLIGIBLE,
        creep_sideways_s2_m=control.assumed_creep_sideways_s2_m if has_wheels else NEGLIGIBLE,
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
    references = [
        reference_factory.build_timed_reference(row.settings, row.start_pose) for row in rows
    ]
    is_shared = all(reference is references[0] for reference in references)
    return references[0] if is_shared else PerRobotReference(references)


def _is_iterated(row: Row) -> bool:
    return row.settings.reference.mode == "iterated"


def _list_parameters(row: Row) -> tuple[tuple[str, float | bool | str], ...]:
    """Return names and values of the controller's parameters in a row's settings."""
    return tuple(sorted(row.settings.controller.get(row.controller, {}).items()))
