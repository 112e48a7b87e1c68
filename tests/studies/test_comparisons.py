"""Many scenarios in one result: the numbers are those of the runs, whatever else is compared."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from benches.studies import Outcome, StoppedError, Watch, nothing

import omni_mj as om

SEEDS = range(7, 10)
CONTROLLERS = ("flc", "comp-flc", "oracle")


def short(name: str, waypoints: list[list[float]], **sections: dict[str, object]) -> om.Scenario:
    reference = {"waypoints": waypoints, "settle_s": 0.5}
    return om.scenario("rect", plant="kinematic", reference=reference, **sections).replace(name=name)


@pytest.fixture(scope="module")
def scenarios() -> list[om.Scenario]:
    there = short("there", [[0, 0], [0.2, 0.1]])
    return [there, short("bend", [[0, 0], [0.15, 0], [0.15, 0.15]], radio={"delay_frames": 4})]


@pytest.fixture(scope="module")
def result(scenarios: list[om.Scenario]) -> om.Result:
    return om.compare(scenarios, CONTROLLERS, SEEDS, subject="comp-flc", keep=True)


def same(ours: Any, theirs: Any) -> None:
    """Two Arrow tables, value by value; one missing number is as good as another."""
    assert ours.column_names == theirs.column_names
    for name in ours.column_names:
        np.testing.assert_array_equal(ours[name].to_pylist(), theirs[name].to_pylist(), err_msg=name)


def test_every_outcome_is_that_of_the_run_of_its_scenario(
    result: om.Result, scenarios: list[om.Scenario], tmp_path: Path
) -> None:
    """In the summary, the frames and the files, which are named after their scenarios."""
    found = result.summary()
    assert (found["controllers"], found["informed"], found["subject"]) == (list(CONTROLLERS), ["oracle"], "comp-flc")
    frames = result.frames()
    for each in scenarios:
        alone = om.run(each, CONTROLLERS, SEEDS, subject="comp-flc")
        entry, other = found["scenarios"][each.name], alone.summary()["scenarios"][each.name]
        apart = {"wall_s": 0, "verdict": None}  # which depends on how many other verdicts there are
        assert entry | apart == other | apart
        assert (entry["status"], entry["seeds"]) == ("done", list(SEEDS))
        pair, of_one = (each["verdict"]["errors"]["max"]["against"]["flc"] for each in (entry, other))
        assert of_one["p"] == pair["p"] <= of_one["p_adjusted"] <= pair["p_adjusted"]
        assert "oracle" not in entry["verdict"]["errors"]["max"]["against"]
        same(frames.filter([name == each.name for name in frames["scenario"].to_pylist()]).drop(["scenario"]),
             alone.frames())  # fmt: skip
    result.save(tmp_path)
    names = {path.relative_to(tmp_path).as_posix() for path in tmp_path.rglob("*") if path.is_file()}
    assert names >= {"scenarios/there.toml", "trajectories/bend.parquet", "summary.json", "provenance.json"}
    assert om.scenario(tmp_path / "scenarios" / "bend.toml").seed_list == list(SEEDS)


def test_what_is_stopped_keeps_what_was_done(scenarios: list[om.Scenario]) -> None:
    """In the second scenario: it counts as not run, since half of it would not compare; blocks of seeds stay."""
    done: list[Outcome] = []

    def stopped(which: list[om.Scenario], seeds: int, half_width: float, blocks: int) -> Any:
        done.clear()

        def at_frame(frame: int) -> None:
            if len(done) == blocks and frame == 5:
                raise StoppedError("interrupted")

        result = om.compare(
            which, ("flc", "comp-flc"), seeds, "flc", half_width=half_width,
            watch=Watch(lambda simulation: at_frame, lambda result, outcome: done.append(outcome)),
        )  # fmt: skip
        assert (result.complete, result.stopped) == (False, "interrupted")
        return result.summary()["scenarios"]

    assert [entry["status"] for entry in stopped(scenarios, 2, 0.0, 1).values()] == ["done", "not run"]
    entry = stopped(scenarios[:1], 20, 1e-9, 2)["there"]
    assert (entry["status"], len(entry["results"]["flc"]["settle_s"]["seeds"]), entry["verdict"]) == (
        "stopped",
        10,
        None,
    )

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


@pytest.mark.parametrize(("plant", "seeds"), [("kinematic", 12), ("planar", 6)])
def test_seeds_in_blocks_give_the_numbers_of_all_at_once(plant: str, seeds: int) -> None:
    """To the last bit, with a controller that fails, robots of which each is its own, and two in a world: half widths
    that nobody's errors have ask for all seeds, in blocks of five; a half width of zero runs all of them at once."""
    places = [[0, 0, 0], [0, 1, 0]] if plant == "kinematic" else [[0, 0, 0]]
    chosen = om.scenario(
        "rect-noise", plant=plant, reference={"waypoints": [[0, 0], [0.1, 0.05]], "settle_s": 0.1},
        world={"places": places}, variation={"friction": 0.1},
    )  # fmt: skip
    blocks: list[list[int]] = []

    def before_block(simulation: om.Simulation) -> Any:
        blocks.append(simulation.log.seeds)
        return nothing

    kinds = ("comp-flc", Failing)
    grown = om.compare([chosen], kinds, seeds, keep=True, half_width=1e-9, watch=Watch(before_block))
    assert blocks == [list(range(seeds))[i : i + 5] for i in range(0, seeds, 5)]
    whole = om.compare([chosen], kinds, seeds, keep=True, half_width=0.0, watch=Watch(before_block))
    assert blocks[-1] == list(range(seeds))
    entry, other = (each.summary()["scenarios"]["rect-noise"] | {"wall_s": 0} for each in (grown, whole))
    assert entry == other
    assert len(entry["failed"]) == entry["results"]["Failing"]["failed"] == seeds * len(places)
    assert len(entry["drawn"]) == (seeds if plant == "planar" else 0)
    same(grown.rows(), whole.rows())
    same(grown.frames(), whole.frames())


def test_seeds_are_added_until_competitors_are_known_well_enough(scenarios: list[om.Scenario]) -> None:
    """A half width between that of 5 and that of 10 seeds asks for 10; of whom knows the truth it asks for none."""
    entries: list[Any] = []
    om.compare(
        scenarios[:1], CONTROLLERS, 10, half_width=1e-9,
        watch=Watch(after=lambda result, outcome: entries.append(outcome.entry)),
    )  # fmt: skip
    before, after = (
        max(
            spread["plus_minus"] / spread["mean"]
            for name in ("flc", "comp-flc")
            for spread in (entry["results"][name]["error_m"]["distance"][s] for s in ("max", "mean"))
        )
        for entry in entries
    )
    assert after < before
    found = om.compare(scenarios[:1], CONTROLLERS, half_width=(before * after) ** 0.5).summary()
    assert found["scenarios"]["there"] | {"wall_s": 0} == entries[1] | {"wall_s": 0}
    assert found["seeds"] == list(range(20))
    enough = om.compare(scenarios[:1], CONTROLLERS, half_width=before * 1.001).summary()["scenarios"]["there"]
    assert enough["results"] == entries[0]["results"]


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
        for statistic in ("max", "mean"):
            wanted = [own["limit"]["error_m"]["distance"][statistic]["seeds"][i] for i in theirs]
            assert there["limit"]["distance"][statistic]["seeds"] == wanted
            assert there["limit"]["distance"][statistic]["mean"] == pytest.approx(np.mean(wanted))
            for name, ratios in there["over_limit"].items():
                mean = there["results"][name]["error_m"]["distance"][statistic]["mean"]
                assert ratios[statistic] == pytest.approx(mean / np.mean(wanted))


def test_a_limit_of_something_else_is_none(study: dict[str, Any], scenarios: list[om.Scenario]) -> None:
    """What differs is named; what controllers are told does not matter."""
    turned = short("there", [[0, 0], [0.2, 0.2]])
    other = short("there", [[0, 0], [0.2, 0.1]], radio={"delay_frames": 3}, vision={"position_noise_m": 0.002})
    robot = om.scenario("rect", robot="tigers-v2020").replace(name="there")
    for given, *words in (
        (turned, "reference.waypoints"),
        (other, "radio.delay_frames = 6, not 3", "vision.position_noise_m = 0.0013, not 0.002"),
        (robot, "on the kinematic plant, not mujoco", "for robot tigers-v2016, not tigers-v2020"),
        (scenarios[1], "'there', which is not compared"),
    ):
        with pytest.raises(om.OmniError) as error:
            om.compare([given], ("flc",), 1, known=[study])
        assert all(word in str(error.value) for word in words), error.value


def test_what_cannot_stand_in_one_table_is_refused(scenarios: list[om.Scenario]) -> None:
    for given, words in (
        ({"scenarios": scenarios[:1] * 2}, "two scenarios are called 'there'"),
        ({"scenarios": scenarios, "controllers": ("flc", "p"), "subject": "lqr"}, "choose from flc, p"),
        ({"scenarios": ["rekt"]}, "did you mean 'rect'"),
        ({"scenarios": scenarios, "half_width": -0.1}, "must be a share of the mean such as 0.05"),
    ):
        with pytest.raises(om.OmniError, match=words):
            om.compare(**given)
