"""Laws of adaptive-comp-flc and inverse-flc in closed loop, with creep and a wrong model."""

import numpy as np
import pytest
from benches.control import Array, OmniError, Reference, make_controller
from closed_loop import WHEELS, CreepingPlant, T, make_vision_noise, run_team

from omni_control import (
    ControllerError,
    IteratedReference,
    MotionLimits,
    Team,
    TeamModel,
    TimedReference,
)

LIMITS = MotionLimits()
PATH = [[0.0, 0.0, 0.0], [1.2, 0.4, 1.5], [0.5, 0.8, -1.0]]
LEAD, SECOND = 15, 60
ROUTE = TimedReference(PATH, LIMITS, T).with_rest(LEAD, SECOND)
RIGHT = {"lag_s": 0.0267, "creep_s2_m": 0.06, "friction_loss_m_s": 0.0375, "alpha": (0.92, 0.87)}
NONE = {"lag_s": 0.01, "creep_s2_m": 1e-6, "friction_loss_m_s": 0.04, "alpha": None}
UNKNOWN = {"lag_s": 0.0, "creep_s2_m": 0.0, "friction_loss_m_s": 0.0}


def team(name: str, delay: int = 6, route: Reference = ROUTE, n: int = 1, **known: object) -> Team:
    model = TeamModel(T, delay, geometry=WHEELS, friction=0.0, **{**RIGHT, **known})  # type: ignore[arg-type]
    return Team(make_controller(name, model, route, n), np.zeros((n, 3)))


def errors(record: dict[str, Array], route: TimedReference = ROUTE) -> tuple[Array, Array]:
    """Return position errors, m, and heading errors, rad, (frames, n) each."""
    off = record["pose"] - route.poses[: len(record["pose"]), None]
    return np.hypot(off[..., 0], off[..., 1]), np.abs(off[..., 2])


def test_known_and_learned_models_reduce_the_error() -> None:
    """A nominal model reduces the error of comp-flc to a third; if it is wrong, learning helps."""
    names = "inverse-flc", "adaptive-comp-flc"
    wrong = {"creep_s2_m": 0.03, "lag_s": 0.04, "alpha": (1.0, 1.0)}
    teams = [team(name, **known) for known in ({}, wrong) for name in names]
    made = [single.controllers[0] for single in (team("comp-flc"), *teams)]
    start = np.zeros((len(made), 3))
    distance, _ = errors(run_team(Team(made, start), CreepingPlant(start), ROUTE.frames))
    comp, *right = distance[:, :3].max(0)
    assert max(right) < comp / 3
    fixed, learned = distance[:, 3:].mean(0)
    assert learned < 0.75 * fixed


def test_inverse_flc_learns_nothing() -> None:
    record = run_team(team("inverse-flc"), CreepingPlant(np.zeros((1, 3))), 200)
    for name in ("alpha_hat", "dead_time", "creep", "friction", "velocity_disturbance"):
        assert np.ptp(record[name], axis=0).max() == 0, name
    assert record["alpha_sigma"].max() == 0


def test_a_disturbance_is_estimated_while_parameters_are_held() -> None:
    """A robot that is pushed sideways, with another gain: its error falls, its parameters stay."""
    errors_by_mode, robots = {}, {"alpha": (0.8, 0.8, 0.98)}
    for learns in ("nothing", "disturbance"):
        model = TeamModel(T, 6, geometry=WHEELS, friction=0.0, **RIGHT)  # type: ignore[arg-type]
        held = make_controller("inverse-flc", model, ROUTE, 1, {"learns": learns})
        plant = CreepingPlant(np.zeros((1, 3)), **robots)  # type: ignore[arg-type]
        record = run_team(Team(held, np.zeros((1, 3))), plant, ROUTE.frames)
        for name in ("alpha_hat", "dead_time", "creep", "friction"):
            assert np.ptp(record[name], axis=0).max() == 0, name
        errors_by_mode[learns] = errors(record)[0].mean()
    assert np.abs(record["velocity_disturbance"]).max() > 0.05
    assert errors_by_mode["disturbance"] < 0.8 * errors_by_mode["nothing"]
    with pytest.raises(OmniError, match="learns must be one of nothing, disturbance, all, got"):
        make_controller("inverse-flc", model, ROUTE, 1, {"learns": "some"})


def test_zero_lag_creep_and_friction_mean_unknown() -> None:
    """The creep is identified; errors are a third of those of a controller that assumes zero."""
    known = UNKNOWN | {"alpha": None}
    record = run_team(
        team("adaptive-comp-flc", **known),
        CreepingPlant(np.zeros((1, 3)), creep=0.08),
        ROUTE.frames,
    )
    distance, _ = errors(record)
    assert record["creep"][-SECOND, 0, 0] > 0.02
    assert distance.max() < 0.02
    assert distance[LEAD + 2 * SECOND :].max() < 0.01


def test_adaptation_stops_for_a_robot_that_does_not_respond() -> None:
    """The radio is silent for a second: no bias winds up, the heading does not oscillate later."""
    silent = range(100, 160)
    record = run_team(
        team("adaptive-comp-flc"),
        CreepingPlant(np.zeros((1, 3))),
        ROUTE.frames,
        is_received=lambda frame: frame not in silent,
    )
    until = slice(silent.start, silent.stop + 12)
    assert np.abs(record["velocity_disturbance"][until, 0, 2]).max() < 0.25
    assert np.abs(record["velocity_disturbance"][until, 0, :2]).max() < 0.25
    assert np.ptp(record["alpha_hat"][until], axis=0).max() < 0.2
    distance, heading = errors(record)
    assert heading[silent.stop + 40 :].max() < np.radians(6)
    assert distance[-SECOND:].max() < 0.02


@pytest.mark.parametrize("name", ["comp-flc", "adaptive-comp-flc"])
def test_frozen_vision_does_not_reverse_the_heading(name: str) -> None:
    """Vision is frozen for 1.4 s at a corner; the robots then turn by more than a right angle."""
    square = [[0.0, 0.0, 0.0], [0.6, 0.0, 1.5], [0.6, 0.6, 3.0], [0.0, 0.6, 4.5]]
    route = TimedReference(square, MotionLimits(1.5, 1.5, 6.0, 12.0), T).with_rest(0, 2 * SECOND)
    corner = next(
        k for k in range(5, route.frames) if np.hypot(*(route.poses[k] - square[1])[:2]) < 1e-9
    )
    begins = corner + np.array([-2, 1, 4])[:, None]
    record = run_team(
        team(name, route=route, n=3),
        CreepingPlant(np.zeros((3, 3))),
        route.frames,
        camera=lambda frame, image, last: np.where(
            (begins < frame) & (frame < begins + 84), last, image
        ),
    )
    distance, heading = errors(record, route)
    assert heading.max() < np.radians(45)
    assert heading[-1].max() < np.radians(3)
    assert distance[-1].max() < 0.01


def test_a_robot_with_a_reversed_pattern_is_stopped_with_a_message() -> None:
    """Vision reports it for two seconds while the robot follows its commands."""
    with pytest.raises(ControllerError, match="opposite of the heading"):
        run_team(
            team("comp-flc"),
            CreepingPlant(np.zeros((1, 3))),
            ROUTE.frames,
            camera=lambda frame, image, last: image + np.pi * np.array([0, 0, frame > 30]),
        )


def test_a_wrong_dead_time_is_identified_and_robots_come_to_rest() -> None:
    """The dead time is wrong by three to eight frames."""
    delay = [5, 11, 2, 0, 15]
    robots = CreepingPlant(np.zeros((5, 3)), delay)
    record = run_team(team("adaptive-comp-flc", 8, n=5), robots, ROUTE.frames + SECOND)
    rest = record["pose"][-SECOND // 2 :]
    assert np.ptp(rest[..., :2], axis=0).max() < 0.003
    assert np.ptp(rest[..., 2], axis=0).max() < np.radians(2)
    estimate = record["dead_time"][ROUTE.frames - SECOND, :, 0]
    assert (np.abs(estimate - delay) < 1).all()


def test_robots_with_wrong_models_are_identified_and_tracked() -> None:
    """Latencies from 3 to 9 frames (nominal 6), alpha from 0.6 to 1.1, drag: on the path in 2 s."""
    n, rng = 13, np.random.default_rng(0)
    alpha, drag = rng.uniform(0.6, 1.1, (n, 1)) * np.ones(3), rng.uniform(0, 0.03, (n, 1))
    plant = CreepingPlant(np.zeros((n, 3)), np.linspace(3, 9, n), 0.01, 0.0, drag, alpha)
    distance, rotated = errors(
        run_team(
            team("adaptive-comp-flc", n=n, **NONE), plant, make_vision_noise(rng, ROUTE.frames, n)
        )
    )
    late = LEAD + 2 * SECOND
    assert (distance.max(), distance[late:].max()) < (0.04, 0.015)
    assert rotated.max() < 0.5
    assert rotated[late:].max() < 0.25


def test_an_iterated_reference_passes_all_waypoints() -> None:
    """An iterated reference: robots pass near every waypoint and stop at the last one."""
    n, path, delay = 3, np.array(PATH), 12
    reference = IteratedReference(PATH, LIMITS, T, n, rest_frames=LEAD)
    plant = CreepingPlant(
        np.repeat(path[:1], n, axis=0),
        delay,
        0.01,
        0.0,
        0.01,
        np.outer([1.0, 0.8, 0.6], np.ones(3)),
    )
    noise = make_vision_noise(np.random.default_rng(0), 6 * SECOND, n)
    record = run_team(team("adaptive-comp-flc", delay, reference, n, **NONE), plant, noise)
    for point in path[1:]:
        # Within the 2 cm at which a way-point counts as reached, and as much that the prediction
        # may be off.
        assert (
            np.hypot(*np.moveaxis(record["pose"][..., :2] - point[:2], -1, 0)).min(0).max() < 0.04
        )
    np.testing.assert_allclose(
        record["pose"][-1], np.repeat(path[-1:], n, axis=0), rtol=0, atol=0.01
    )
    assert np.abs(record["command"][-1]).max() < 0.3
