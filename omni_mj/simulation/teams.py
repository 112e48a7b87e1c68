"""The team's computers of a simulation: rows that are told the same share a controller."""

from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache

import numpy as np

from omni_control.controllers import make_controller
from omni_control.controllers.base import Controller, TeamModel
from omni_control.errors import ControllerError
from omni_control.kinematics import Array, Kinematics
from omni_control.reference import PerRobotReference, Reference
from omni_control.team import Team
from omni_mj.config import reference_factory
from omni_mj.config.rows import Row
from omni_mj.config.settings import PERIOD_S, Settings

# Of lag, friction and creep, on plants without wheels; zero would mean that nobody knows them
NONE = 1e-9
ReferenceFactory = Callable[[np.ndarray], Reference]


def build_team(
    rows: Sequence[Row],
    kinds: Mapping[str, type[Controller]],
    start: Array,
    geometry: Kinematics,
    wheels: bool,
    on_failure: Callable[[np.ndarray, ControllerError], None],
    follow: ReferenceFactory | None = None,
) -> Team:
    """Make the controllers of all rows and the team around them.

    Args:
        rows: one per robot.
        kinds: label -> class of controller.
        start: poses at the start, (n, 3).
        geometry: of the robots' wheels.
        wheels: whether the plant has any, whose lag and friction the team reckons with.
        on_failure: told the rows of a controller that fails, and why.
        follow: what rows, by their numbers, are to follow in place of what their settings say.
    """
    together: dict[tuple[object, ...], list[int]] = {}
    for i, row in enumerate(rows):
        way = (
            row.settings.reference,
            reference_factory.build_reference_limits(row.settings),
            row.start_pose,
        )
        # One that is known in advance may be each robot's own
        ways = way if follow or _iterated(row) else None
        key = (
            row.controller,
            build_team_model(row.settings, geometry, wheels),
            ways,
            _parameters(row),
        )
        together.setdefault(key, []).append(i)
    made, unmade, members = (
        list[Controller](),
        list[np.ndarray](),
        [np.array(group) for group in together.values()],
    )
    for group in members:
        row, n = rows[group[0]], len(group)
        kind = kinds[row.controller]
        known = build_team_model(row.settings, geometry, wheels)
        reference = _reference([rows[i] for i in group]) if follow is None else follow(group)
        try:
            made.append(make_controller(kind, known, reference, n, dict(_parameters(row))))
        except ControllerError as error:
            on_failure(group, error)
            unmade.append(group)
            made.append(Controller(known, reference, n))  # stands in its place; it is never asked
    team = Team(made, start, members, on_failure=on_failure)
    team.stop(np.concatenate([*unmade, np.array([], int)]))
    return team


@lru_cache(maxsize=4096)
def build_team_model(settings: Settings, geometry: Kinematics, wheels: bool) -> TeamModel:
    """What the team's computer is told of the loop."""
    control, vision = settings.control, settings.vision
    alpha = control.assumed_alpha_forward, control.assumed_alpha_sideways
    return TeamModel(
        period=PERIOD_S,
        delay_frames=max(settings.radio.delay_frames + control.delay_error_frames, 0),
        lag_s=control.assumed_lag_s if wheels else NONE,
        drag_m_s=control.assumed_drag_m_s if wheels else NONE,
        creep_s2_m=control.assumed_creep_s2_m if wheels else NONE,
        creep_sideways_s2_m=control.assumed_creep_sideways_s2_m if wheels else NONE,
        alpha=alpha if wheels and min(alpha) > 0 else None,
        position_noise_m=vision.position_noise_m,
        heading_noise_rad=vision.heading_noise_rad,
        error_range_m=control.error_range_m,
        speed_range_m_s=control.speed_range_m_s,
        heading_gain=control.heading_gain,
        alpha_window_frames=control.alpha_window_frames,
        geometry=geometry,
        limits=reference_factory.build_motion_limits(control),
    )


def _reference(rows: Sequence[Row]) -> Reference:
    if _iterated(rows[0]):
        return reference_factory.build_iterated_reference(
            rows[0].settings, len(rows), rows[0].start_pose
        )
    own = [reference_factory.build_timed_reference(row.settings, row.start_pose) for row in rows]
    return own[0] if all(each is own[0] for each in own) else PerRobotReference(own)


def _iterated(row: Row) -> bool:
    return row.settings.reference.mode == "iterated"


def _parameters(row: Row) -> tuple[tuple[str, float | bool | str], ...]:
    return tuple(sorted(row.settings.controller.get(row.controller, {}).items()))
