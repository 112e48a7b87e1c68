"""The limit is one: no controller gets below it, and where its value is known in closed form, it is that."""

from pathlib import Path
from typing import Any

import compiled
import numpy as np
import pytest
from matplotlib.image import imread

import omni_mj as om
from omni_control import controllers
from omni_control.registry import CONTROLLERS
from omni_mj.scenarios.settings import PERIOD_S
from omni_mj.show import limit_figure
from omni_mj.studies.limit import LIMIT, WITHOUT_NOISE, LimitResult, learning, practice, rivals
from omni_mj.studies.limit.attempts import quiet
from omni_mj.studies.limit.learning import Learner
from omni_mj.studies.outcome import StoppedError, nothing

ROUTE = {
    "waypoints": [[0, 0], [0.08, 0.03, 0.1]],
    "max_acceleration_m_s2": 3.0,
    "lead_s": 0.12,
    "settle_s": 0.05,
}  # 34 frames, of which the dead time is six
LONGER = {"reference": {**ROUTE, "waypoints": [[0, 0], [0.15, 0.05, 0.2]], "lead_s": 0.15, "settle_s": 0.15}}
SLOW = {"alpha_time_s": 10.0}
PLANTS: dict[str, dict[str, Any]] = {
    "kinematic": {"plant": "kinematic", "kinematic": SLOW, "physics": compiled.NUMBA},
    "mujoco": {"wheels": {"model": "two-rollers"}, "physics": compiled.NUMBA},
}
SEEDS = 2


def route(plant: str, **sections: Any) -> om.Scenario:
    compiled.once(plant)
    return om.scenario("rect", **{"reference": ROUTE, **PLANTS[plant], **sections})


@pytest.fixture(scope="module", params=PLANTS)
def found(request: pytest.FixtureRequest) -> LimitResult:
    return studied(route(request.param))


def studied(scenario: om.Scenario) -> LimitResult:
    """Of fewer seeds of practice than usual, to save time."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(practice, "SEEDS", 2)
        return om.limit(scenario, SEEDS, iterations=3 if scenario.plant == "mujoco" else 2)


def practised(result: LimitResult) -> tuple[Any, Any]:
    """What the package's controllers and those that learned did in practice."""
    assert result.skill is not None
    return result.skill.rivals, list(result.skill.tried.values())


def silent(title: str, frames: int) -> Any:
    return nothing


def least(result: om.Result, name: str) -> dict[str, float]:
    """Over the seeds, mean of the maximum and the mean of the error in the plane."""
    error = next(iter(result.summary()["scenarios"].values()))["results"][name]["error_m"]["distance"]
    return {statistic: error[statistic]["mean"] for statistic in ("max", "mean")}


def test_no_controller_gets_below_it(found: LimitResult) -> None:
    """With the same seeds, but for those that are told the truth."""
    (outcome,) = found.outcomes
    rivals = [name for name in CONTROLLERS if not controllers.find(name).knows_truth]
    driven = om.run(outcome.scenario, rivals, range(SEEDS))
    limit, still = least(found, LIMIT), least(found, WITHOUT_NOISE)
    for name in rivals:
        theirs = least(driven, name)
        for statistic, value in theirs.items():
            assert limit[statistic] < value, (name, statistic)
    for statistic, value in limit.items():
        assert still[statistic] < 1.1 * value, "where commands are at their limits, noise may be lucky"


def test_who_comes_near_shows_what_it_can() -> None:
    """Within a factor of two by the maximum or the mean, and the best by each, though it be far; not who failed."""
    learned = [{"max": 2.0, "mean": 3.0}, {"max": 3.0, "mean": 1.0}]
    by = {"near": (3.9, 9.0), "other": (9.0, 1.9), "far": (4.1, 2.1), "failed": (np.inf, np.inf)}
    given: dict[str, Any] = {name: dict(zip(("max", "mean"), each, strict=True)) for name, each in by.items()}
    assert rivals.near(given, learned) == ["near", "other"]
    assert rivals.near({name: given[name] for name in ("far", "failed")}, learned) == ["far"]


def test_a_controller_that_is_better_is_the_limit(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Here one that is told the truth, where vision is so noisy that nobody else sees anything: it says whose it is."""
    monkeypatch.setattr(rivals, "competitors", lambda: ["oracle"])
    monkeypatch.setattr(practice, "WEIGHTS", (0.01, 0.03))
    monkeypatch.setattr(practice, "SEEDS", 2)
    blind = route("kinematic", vision={"position_noise_m": 0.05, "heading_noise_rad": 0.5})
    result = om.limit(blind, SEEDS, iterations=2)
    assert result.summary()["limit"]["of"] == {"max": "oracle", "mean": "oracle"}
    theirs = om.run(blind, ["oracle"], range(SEEDS)).summary()["scenarios"]["rect"]["results"]["oracle"]["error_m"]
    found = result.summary()["scenarios"]["rect"]["results"]
    assert found[LIMIT]["error_m"] == found["oracle"]["error_m"] == theirs
    for error in ("maximum", "mean"):
        assert f"the limit of the {error} is that of oracle: learning found nothing lower" in result.table()
    limit_figure.save(result, tmp_path / "limit.png")
    assert imread(tmp_path / "limit.png").std() > 0.05


def test_what_was_learned_is_shown_bit_for_bit(found: LimitResult) -> None:
    """In a batch with other robots, from the commands that it holds."""
    (outcome,) = found.outcomes
    error = outcome.entry["results"][WITHOUT_NOISE]["error_m"]["distance"]
    assert error["max"]["median"] == found.history[-1]["max"]
    assert error["mean"]["median"] == pytest.approx(found.history[-1]["mean"], rel=1e-12)  # added in another order
    assert len(outcome.entry["results"][LIMIT]["error_m"]["x"]["max"]["seeds"]) == SEEDS
    assert set(outcome.entry["results"]) == {LIMIT, WITHOUT_NOISE, *rivals.near(*practised(found))}
    assert list(found.controllers) == list(outcome.entry["results"])
    assert found.summary()["limit"]["of"] == {"max": "learned", "mean": "learned"}


def test_learning_never_goes_back(found: LimitResult) -> None:
    for aim in ("max", "mean"):
        assert (np.diff([attempt[aim] for attempt in found.history]) <= 0).all()


def test_it_is_the_same_every_time(found: LimitResult) -> None:
    """Told of one plant, to save the time of the other; on both, rows are the same in every batch."""
    (outcome,) = found.outcomes
    if outcome.scenario.plant == "kinematic":
        again = studied(outcome.scenario)
        assert again.table() == found.table()
        for aim, commands in again.commands.items():
            np.testing.assert_array_equal(commands, found.commands[aim])


def test_a_robot_without_lag_is_inverted_exactly() -> None:
    """With alpha the same for ever, x(k+1) = x(k) + T alpha u(k-D) wants u(k) = (r(k+D+1) - r(k+D)) / (T alpha)."""
    alpha, delay = 0.8, 6
    steady = {"alpha_low": alpha, "alpha_high": alpha}
    learner = Learner(quiet(om.scenario("rect", plant="kinematic", reference=ROUTE, kinematic=steady)), [0], silent)
    learner.learn(4)
    wanted = np.diff(learner.reference, axis=0)[delay:] / (PERIOD_S * alpha)
    for best in learner.best.values():
        assert np.abs(best.errors).max() < 1e-7
        np.testing.assert_allclose(best.sent[: len(wanted), 0], wanted, atol=1e-5)


def test_robots_that_differ_learn_each_for_itself(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of one teacher, to save time: both get better by half, with commands of their own."""
    monkeypatch.setattr(learning, "TEACHERS", ("comp-flc",))
    monkeypatch.setattr(learning, "PROBES", 1)
    learner = Learner(quiet(route("mujoco", variation={"mass": 0.1, "centre_m": 0.01}, **LONGER)), [0, 1], silent)
    learner.learn(2)
    assert (learner.best["mean"].merit < 0.5 * learner.history[0]["mean"]).all()
    assert np.abs(np.diff(learner.best["mean"].sent, axis=1)).max() > 0.01


def test_bad_input_is_refused_all_at_once() -> None:
    """Robots that share a world have no limit of their own."""
    several = om.scenario("rect", world={"places": [[0, 0, 0], [0, 1, 0]]})
    with pytest.raises(om.OmniError) as error:
        om.limit(several, 1, iterations=1)
    lines = str(error.value).splitlines()
    assert ["places" in lines[0], "iterations" in lines[1], len(lines)] == [True, True, 2]
    with pytest.raises(om.OmniError, match="unknown scenario 'rekt'"):
        om.limit("rekt")
    with pytest.raises(om.OmniError, match="count up"):
        om.limit("rect", [1, 3])


def test_one_that_is_stopped_says_so_and_has_what_it_learned() -> None:
    begun = []

    def begin(title: str, frames: int) -> Any:
        begun.append(title)

        def after_frame(frame: int) -> None:
            assert frame < frames
            if len(begun) == 3:
                raise StoppedError("interrupted")

        return after_frame

    result = om.limit(route("kinematic"), 1, begin=begin)
    assert (result.stopped, result.complete, result.table()) == ("interrupted", False, "")
    assert len(result.summary()["limit"]["attempts"]) == 1
