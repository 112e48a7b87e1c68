"""Many scenarios in one result: the numbers are those of the runs, whatever else is compared."""

from pathlib import Path
from typing import Any

import compiled
import numpy as np
import pytest

import omni_mj as om
from omni_mj.measure import summary
from omni_mj.measure.result import Outcome
from omni_mj.studies.outcome import AfterFrame, StoppedError, nothing

SEEDS = range(7, 10)
CONTROLLERS = ("flc", "comp-flc", "oracle")


def short(name: str, waypoints: list[list[float]], **sections: dict[str, object]) -> om.Scenario:
    reference = {"waypoints": waypoints, "settle_s": 0.5}
    compiled.once("kinematic")
    chosen = om.scenario("rect", plant="kinematic", reference=reference, physics=compiled.NUMBA, **sections)
    return chosen.replace(name=name)


@pytest.fixture(scope="module")
def scenarios() -> list[om.Scenario]:
    there = short("there", [[0, 0], [0.2, 0.1]])
    return [there, short("bend", [[0, 0], [0.15, 0], [0.15, 0.15]], radio={"delay_frames": 4})]


@pytest.fixture(scope="module")
def result(scenarios: list[om.Scenario]) -> om.Result:
    return om.compare(scenarios, CONTROLLERS, SEEDS, subject="comp-flc", keep=True)


def test_every_outcome_is_that_of_the_run_of_its_scenario(result: om.Result, scenarios: list[om.Scenario]) -> None:
    found = result.summary()
    assert (found["controllers"], found["informed"]) == (list(CONTROLLERS), ["oracle"])
    assert (found["seeds"], found["complete"], found["subject"]) == (list(SEEDS), True, "comp-flc")
    frames = result.frames()
    assert frames.column_names[0] == "scenario"
    for each in scenarios:
        alone = om.run(each, CONTROLLERS, SEEDS, subject="comp-flc")
        entry, other = found["scenarios"][each.name], alone.summary()["scenarios"][each.name]
        apart = {"wall_s": 0, "verdict": None}  # which depends on how many other verdicts there are
        assert entry | apart == other | apart
        assert (entry["status"], entry["seeds"]) == ("done", list(SEEDS))
        pair, of_one = (each["verdict"]["errors"]["max"]["against"]["flc"] for each in (entry, other))
        assert of_one["p"] == pair["p"] <= of_one["p_adjusted"] <= pair["p_adjusted"]
        assert "oracle" not in entry["verdict"]["errors"]["max"]["against"]
        own = frames.filter([name == each.name for name in frames["scenario"].to_pylist()]).drop(["scenario"])
        for name in own.column_names:
            np.testing.assert_array_equal(own[name].to_pylist(), alone.frames()[name].to_pylist(), err_msg=name)
    assert result["bend"].scenario.settings.radio.delay_frames == 4
    table = result.table().splitlines()
    assert [line.split()[0] for line in table[2:]] == ["there", "comp-flc", "oracle", "bend", "comp-flc", "oracle"]


def test_files_of_several_scenarios_are_named_after_them(result: om.Result, tmp_path: Path) -> None:
    result.save(tmp_path)
    kept = {str(path.relative_to(tmp_path)) for path in tmp_path.rglob("*") if path.is_file()}
    names = {f"{folder}/{name}.{kind}" for name in ("there", "bend") for folder, kind in
             (("scenarios", "toml"), ("trajectories", "parquet"))}  # fmt: skip
    assert kept == names | {"summary.json", "provenance.json", "sources/tigers-v2016.toml"}
    assert om.scenario(tmp_path / "scenarios" / "bend.toml").seed_list == list(SEEDS)


def test_a_scenario_that_cannot_be_made_is_noted_and_the_others_go_on(
    scenarios: list[om.Scenario], monkeypatch: pytest.MonkeyPatch
) -> None:
    from omni_mj.studies import compare

    made = compare.prepare

    def prepare(scenario: om.Scenario, seeds: object) -> om.Simulation:
        if scenario.name == "there":
            raise om.OmniError("robots overlap\nat the start")
        return made(scenario, seeds=seeds)  # type: ignore[arg-type]

    monkeypatch.setattr(compare, "prepare", prepare)
    told = []
    result = om.compare(scenarios, ("flc",), 1, after_block=lambda result, outcome: told.append(outcome))
    entries = result.summary()["scenarios"]
    assert [entry["status"] for entry in entries.values()] == ["failed", "done"]
    assert entries["there"]["reason"] == "robots overlap at the start"
    assert [outcome.scenario.name for outcome in told] == ["there", "bend"]
    assert result.complete
    assert [outcome.log for outcome in result.outcomes] == [None, None], "frames are kept where it is asked"


def test_what_is_stopped_keeps_what_was_done(scenarios: list[om.Scenario]) -> None:
    """In the second scenario: it counts as not run, since half of it would not compare."""
    done: list[Outcome] = []

    def after_frame(frame: int) -> None:
        if done and frame == 5:
            raise StoppedError("interrupted")

    result = om.compare(
        scenarios, ("flc",), 2,
        before_block=lambda simulation: after_frame,
        after_block=lambda result, outcome: done.append(outcome),
    )  # fmt: skip
    assert (result.complete, result.stopped) == (False, "interrupted")
    assert [outcome.entry["status"] for outcome in result.outcomes] == ["done", "not run"]

    def at_once(frame: int) -> None:
        raise StoppedError("terminated")

    one = om.run(scenarios[0], after_frame=at_once).summary()
    assert (one["complete"], one["stopped"], one["scenarios"]["there"]["frames"]) == (False, "terminated", 1)


class Feed(om.Controller):
    """The reference's own velocities, a dead time early, whatever becomes of it."""

    def command(self, frame: int, seen: om.Seen) -> np.ndarray:
        return self.reference.at(frame + self.told.delay_frames, seen.pose)[1]


class Failing(Feed):
    """The same up to frame 20."""

    def command(self, frame: int, seen: om.Seen) -> np.ndarray:
        if frame == 20:
            raise RuntimeError("as told")
        return super().command(frame, seen)


@pytest.mark.parametrize(("plant", "seeds"), [("kinematic", 12), ("mujoco", 6)])
def test_seeds_in_blocks_give_the_numbers_of_all_at_once(plant: str, seeds: int) -> None:
    """To the last bit, with a controller that fails, robots of which each is its own, and two in a world: half widths
    that nobody's errors have ask for all seeds, in blocks of five; a half width of zero runs all of them at once."""
    if plant == "mujoco":
        compiled.once(plant)
    places = [[0, 0, 0], [0, 1, 0]] if plant == "kinematic" else [[0, 0, 0]]
    chosen = om.scenario(
        "rect-noise", plant=plant, reference={"waypoints": [[0, 0], [0.1, 0.05]], "settle_s": 0.1},
        world={"places": places}, variation={"friction": 0.1}, wheels={"model": "two-rollers"},
        physics=compiled.NUMBA,
    )  # fmt: skip
    blocks: list[list[int]] = []

    def before_block(simulation: om.Simulation) -> AfterFrame:
        blocks.append(simulation.log.seeds)
        return nothing

    kinds = ("comp-flc", Failing)
    grown = om.compare([chosen], kinds, seeds, keep=True, half_width=1e-9, before_block=before_block)
    assert blocks == [list(range(seeds))[i : i + 5] for i in range(0, seeds, 5)]
    whole = om.compare([chosen], kinds, seeds, keep=True, half_width=0.0, before_block=before_block)
    assert blocks[-1] == list(range(seeds))
    entry, other = (each.summary()["scenarios"]["rect-noise"] | {"wall_s": 0} for each in (grown, whole))
    assert entry == other
    assert entry["seeds"] == list(range(seeds))
    assert len(entry["failed"]) == entry["results"]["Failing"]["failed"] == seeds * len(places)
    assert len(entry["drawn"]) == (seeds if plant == "mujoco" else 0)
    assert grown["rect-noise"].scenario == whole["rect-noise"].scenario
    assert grown["rect-noise"].rows == whole["rect-noise"].rows
    assert grown["rect-noise"].failures == whole["rect-noise"].failures
    for ours, theirs in ((grown.rows(), whole.rows()), (grown.frames(), whole.frames())):
        assert ours.column_names == theirs.column_names
        for name in ours.column_names:
            np.testing.assert_array_equal(ours[name].to_pylist(), theirs[name].to_pylist(), err_msg=name)


def test_seeds_are_added_until_competitors_are_known_well_enough(scenarios: list[om.Scenario]) -> None:
    """A half width between that of 5 and that of 10 seeds asks for 10; of whom knows the truth it asks for none."""
    entries: list[summary.Entry] = []
    om.compare(
        scenarios[:1],
        CONTROLLERS,
        10,
        half_width=1e-9,
        after_block=lambda result, outcome: entries.append(outcome.entry),
    )
    five, ten = entries
    before, after = (
        max(
            spread["plus_minus"] / spread["mean"]
            for name in ("flc", "comp-flc")
            for spread in (entry["results"][name]["error_m"]["distance"][s] for s in ("max", "mean"))
        )
        for entry in entries
    )
    assert after < before
    told = []
    result = om.compare(
        scenarios[:1], CONTROLLERS, half_width=(before * after) ** 0.5,
        after_block=lambda result, outcome: told.append(
            (outcome.entry["status"], outcome.entry["reason"], len(outcome.entry["seeds"]))
        ),
    )  # fmt: skip
    assert told == [("stopped", "5 of at most 20 seeds were run", 5), ("done", None, 10)]
    found = result.summary()
    assert found["scenarios"]["there"] | {"wall_s": 0} == ten | {"wall_s": 0}
    assert (found["seeds"], found["half_width"]) == (list(range(20)), (before * after) ** 0.5)
    enough = om.compare(scenarios[:1], CONTROLLERS, half_width=before * 1.001).summary()["scenarios"]["there"]
    assert enough["results"] == five["results"]


def test_blocks_that_were_run_are_kept_when_the_next_is_stopped(scenarios: list[om.Scenario]) -> None:
    """As a scenario that is not done, without a verdict."""
    done: list[Outcome] = []

    def after_frame(frame: int) -> None:
        if len(done) == 2:
            raise StoppedError("interrupted")

    result = om.compare(
        scenarios[:1], ("flc", "comp-flc"), 20, "flc", half_width=1e-9,
        before_block=lambda simulation: after_frame, after_block=lambda result, outcome: done.append(outcome),
    )  # fmt: skip
    entry = result.summary()["scenarios"]["there"]
    assert (result.stopped, result.complete) == ("interrupted", False)
    assert (entry["status"], entry["reason"]) == ("stopped", "10 of at most 20 seeds were run")
    assert (len(entry["results"]["flc"]["settle_s"]["seeds"]), entry["verdict"]) == (10, None)


def test_sending_the_references_own_velocities_is_no_effort_of_ones_own(scenarios: list[om.Scenario]) -> None:
    """As team and radio have it; a root of a difference of squares is good to 1e-6."""
    result = om.compare(scenarios, (Feed, "p"), 2).summary()["scenarios"]
    for entry in result.values():
        assert entry["results"]["Feed"]["effort_m_s2"]["min"] > 0.5
        assert entry["results"]["Feed"]["excess_effort_m_s2"]["max"] < 1e-6


@pytest.fixture(scope="module")
def study(scenarios: list[om.Scenario]) -> dict[str, Any]:
    """What a study of the first one's limit says."""
    return om.limit(scenarios[0], SEEDS, iterations=2).summary()


def test_limits_that_are_known_stand_in_the_summary(study: dict[str, Any], scenarios: list[om.Scenario]) -> None:
    """Of the seeds that were run, or, where the limit has not all of them, of its own: as many times the mean."""
    own = study["scenarios"]["there"]["results"]
    for seeds, theirs in ((range(8, 10), [1, 2]), (range(9, 12), [0, 1, 2])):
        found = om.compare(scenarios, ("flc", "p"), seeds, half_width=0, known=[study]).summary()["scenarios"]
        there, bend = found["there"], found["bend"]
        assert [bend["limit"], bend["limit_without_noise"], bend["over_limit"]] == [None] * 3
        for key, label in (("limit", "limit"), ("limit_without_noise", "limit without noise")):
            for statistic in ("max", "mean"):
                each = own[label]["error_m"]["distance"][statistic]["seeds"]
                wanted = [each[i] for i in theirs] if key == "limit" else each
                assert there[key]["distance"][statistic]["seeds"] == wanted
                assert there[key]["distance"][statistic]["mean"] == pytest.approx(np.mean(wanted))
        rival = next(name for name in own if not name.startswith("limit"))
        beaten = {**own, "limit": own[rival], rival: own["limit"]}
        other = {**study, "scenarios": {"there": {**study["scenarios"]["there"], "results": beaten}}}
        best = om.compare(scenarios[:1], ("p",), seeds, half_width=0, known=[other])["there"].entry["limit"]
        assert best == there["limit"], "whoever is better"
        for name, ratios in there["over_limit"].items():
            for statistic, ratio in ratios.items():
                mean = there["results"][name]["error_m"]["distance"][statistic]["mean"]
                assert ratio == pytest.approx(mean / there["limit"]["distance"][statistic]["mean"])
                assert ratio > 1


class Gentle(om.Controller):
    """Proportional control, of as much as is asked for."""

    share: float = 1.0

    def command(self, frame: int, seen: om.Seen) -> np.ndarray:
        target, speed = self.reference.at(frame, seen.pose)
        return self.share * (speed + 3 * (target - seen.pose))


def test_a_limit_of_something_else_is_none(study: dict[str, Any], scenarios: list[om.Scenario]) -> None:
    """What differs is named; what controllers are told does not, and of two studies that counts which fits."""
    there = scenarios[0]
    turned = short("there", [[0, 0], [0.2, 0.2]])
    other = short("there", [[0, 0], [0.2, 0.1]], radio={"delay_frames": 3}, vision={"position_noise_m": 0.002})
    robot = om.scenario("rect", robot="tigers-v2020").replace(name="there")
    for given, *words in (
        (turned, "reference.waypoints = [[0.0, 0.0, 0.0], [0.2, 0.1, 0.0]], not"),
        (other, "radio.delay_frames = 6, not 3", "vision.position_noise_m = 0.0013, not 0.002"),
        (robot, "on the kinematic plant, not mujoco", "for robot tigers-v2016, not tigers-v2020"),
        (scenarios[1], "a limit is given of 'there', which is not compared"),
    ):
        with pytest.raises(om.OmniError) as error:
            om.compare([given], ("flc",), 1, known=[study])
        assert all(word in str(error.value) for word in words), error.value
        assert len(str(error.value).splitlines()) == 1
    own = short("there", [[0, 0], [0.2, 0.1]], controller={"Gentle": {"share": 0.7}}, controllers=(Gentle,))
    entry = study["scenarios"]["there"]
    both = [{**study, "scenarios": {"there": {**entry, "settings": other.settings.plain(), "results": {}}}}, study]
    for fitting in (there, own):
        found = om.compare([fitting], (Gentle,), SEEDS, known=both, half_width=0)["there"].entry
        assert found["limit"] == entry["results"]["limit"]["error_m"]


def test_what_cannot_stand_in_one_table_is_refused(scenarios: list[om.Scenario]) -> None:
    for given, words in (
        ({"scenarios": scenarios[:1] * 2}, "two scenarios are called 'there'"),
        ({"scenarios": scenarios, "controllers": ("flc", "p"), "subject": "lqr"}, "choose from flc, p"),
        ({"scenarios": ["rekt"]}, "did you mean 'rect'"),
        ({"scenarios": scenarios, "half_width": -0.1}, "must be a share of the mean such as 0.05"),
    ):
        with pytest.raises(om.OmniError, match=words):
            om.compare(**given)
