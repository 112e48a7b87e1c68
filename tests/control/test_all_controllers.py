"""Laws of all controllers: stable with a wrong model, mirror-symmetric, rows independent."""

import numpy as np
import pytest
from benches.control import CONTROLLERS, Array, load_controller_class, make_controller
from closed_loop import (
    LaggedPlant,
    T,
    make_empty_history,
    make_observation,
    run_controller,
    run_team,
)
from hypothesis import example, given, settings
from hypothesis import strategies as st
from team_setup import LIMITS, MODES, REST, TIMED, make_model, make_reference

from omni_control import Team, TimedReference

COMPETITORS = ("p", "smith", "lqr", "mpc", "oracle")
LINEAR, IDENTIFYING = COMPETITORS[:3], COMPETITORS[3:]
ADAPTIVE = "adaptive-comp-flc"
each_identifying = pytest.mark.parametrize("name", IDENTIFYING)
each_linear = pytest.mark.parametrize("name", LINEAR)


def test_only_the_oracle_knows_the_truth() -> None:
    assert [name for name in CONTROLLERS if load_controller_class(name).knows_truth] == ["oracle"]
    assert "knows the true state" in (load_controller_class("oracle").__doc__ or "").splitlines()[0]


of_other_robots = given(
    delay=st.integers(1, 7),
    wrong=st.sampled_from([-1, 0, 1]),
    lag=st.sampled_from([0.0, 0.02, 0.05]),
    seed=st.integers(0, 99),
)


@each_linear
@settings(max_examples=8)
@of_other_robots
def test_stable_with_wrong_alpha_and_dead_time(
    name: str, delay: int, wrong: int, lag: float, seed: int
) -> None:
    check_stable(name, 4, delay, wrong, lag, seed)


@each_identifying
@settings(max_examples=3)
@example(delay=3, wrong=0, lag=0.0, seed=18)  # friction learned above the drive at rest
@of_other_robots
def test_adaptive_controllers_tolerate_wrong_models(
    name: str, delay: int, wrong: int, lag: float, seed: int
) -> None:
    check_stable(
        name, 1 if name == "mpc" else 4, delay, wrong, lag, seed
    )  # programs are solved one by one


def check_stable(name: str, n: int, delay: int, wrong: int, lag: float, seed: int) -> None:
    """Robots reach a resting reference with alpha from 0.5 to 1.1 and a dead time wrong by a frame.

    Vision passes the filter, which uses the nominal model.
    """
    rng, frames = np.random.default_rng(seed), 240 if name in IDENTIFYING else 360
    start = rng.uniform(-0.1, 0.1, (n, 3))
    controller = make_controller(name, make_model(delay, lag), REST, n)
    alpha, noise = rng.uniform(0.5, 1.1, (n, 3)), np.zeros((frames, n, 3))
    pose = run_team(Team(controller, start), LaggedPlant(start, delay + wrong, lag, alpha), noise)[
        "pose"
    ]
    # The slowest loop, p with a latency of 11 frames and alpha 0.5, leaves some exp(-0.5 * 2.7 / s
    # * 6 s) = 3e-4 of it.
    assert np.abs(pose[-1]).max() < (2e-3 if name in IDENTIFYING else 1e-4)
    assert np.abs(pose).max() < 0.2, "none swings out"


@pytest.mark.parametrize("kind", MODES)
@pytest.mark.parametrize(("name", "atol"), [("comp-flc", 1e-12), ("smith", 1e-12), ("lqr", 1e-11)])
@settings(max_examples=10)
@given(
    start=st.tuples(st.floats(-0.12, 0.12), st.floats(-0.12, 0.12), st.floats(-1, 1)),
    delay=st.integers(0, 12),
    lag=st.sampled_from([0.0, 1e-4, 0.02, 2 * T, 0.1]),
)
def test_dead_time_only_delays_the_motion_of_a_nominal_robot(
    name: str, atol: float, kind: str, start: tuple[float, ...], delay: int, lag: float
) -> None:
    """Law of the Smith predictor: by k_d frames, and no more. Equation 7 has no lag.

    Roundings of poses of size 1, which a stable loop forgets; LQR divides by T and multiplies by
    the lag.
    """
    lag = 0.0 if name == "comp-flc" else lag

    def follow(delay: int, first_frame: int) -> Array:
        controller = make_controller(name, make_model(delay, lag), make_reference(kind), 1)
        plant = LaggedPlant([start], delay, lag)
        return run_controller(controller, plant, 72 - first_frame, first_frame=first_frame).pose

    late, prompt = follow(delay, 0), follow(0, delay)
    assert (late[:delay] == start).all()
    np.testing.assert_allclose(late[delay:], prompt, rtol=0, atol=atol)


def test_mirrored_tasks_have_mirrored_commands() -> None:
    """If y, headings and their noise are mirrored, only y and turn rates change sign."""
    for name in COMPETITORS:
        for kind in MODES:
            rng, mirror = np.random.default_rng(0), np.array([1.0, -1.0, -1.0])
            start, noise = rng.uniform(-0.1, 0.1, (3, 3)), rng.normal(0, 0.002, (25, 3, 3))
            alpha, model = rng.uniform(0.7, 1, (3, 3)), make_model(6, noisy=True)
            runs = [
                run_team(
                    Team(
                        make_controller(name, model, make_reference(kind, 3, side), 3), side * start
                    ),
                    LaggedPlant(side * start, 6, 0.02, alpha),
                    side * noise,
                )["command"]
                for side in (np.ones(3), mirror)
            ]
            # Models sum over wheels in the opposite order, whose rounding errors grow to 4e-10.
            # Programs are solved to 1e-9.
            atol = 1e-6 if name == "mpc" else 1e-8 if name in IDENTIFYING else 0
            np.testing.assert_allclose(runs[0], mirror * runs[1], rtol=0, atol=atol)


def test_headings_take_the_short_way() -> None:
    """Full turns are no error, and from -3 to 3 rad a robot turns over pi."""
    for name in COMPETITORS:
        for turns in [-3, 1, 40]:
            controller = make_controller(
                name, make_model(0, 0.0), TimedReference([[0, 0, 3.0]], LIMITS, T), 2
            )
            pose = np.array([[0, 0, 3.0 + 2 * np.pi * turns], [0, 0, -3.0]])
            seen = make_observation(
                controller.model, pose, make_empty_history(controller), np.zeros((2, 3)), pose
            )
            command = controller.command(0, seen)
            # Forty turns are rounded at 3e-14 rad, times a gain of 30 / s.
            assert abs(command[0, 2]) < 2e-12
            assert command[1, 2] < 0


def test_the_oracle_is_never_worse_than_with_noise() -> None:
    """The oracle is better than the same controller with vision noise: mean and rms, each robot."""
    n, rng = 6, np.random.default_rng(0)
    path = TIMED.with_rest(15)
    alpha = rng.uniform(0.7, 1, (n, 3))
    noise = rng.normal(0, 1, (path.frames, n, 3)) * (0.0013, 0.0013, 0.01)
    error = {}
    for name in ("oracle", ADAPTIVE):
        controller = make_controller(name, make_model(6, noisy=True), path, n)
        start = np.zeros((n, 3))
        off = (
            run_team(Team(controller, start), LaggedPlant(start, 6, 0.02, alpha), noise)["pose"]
            - path.poses[:, None]
        )
        error[name] = np.hypot(off[..., 0], off[..., 1])
    assert (error["oracle"].mean(0) < error[ADAPTIVE].mean(0)).all()
    assert ((error["oracle"] ** 2).mean(0) < (error[ADAPTIVE] ** 2).mean(0)).all()
