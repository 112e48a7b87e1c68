"""Many scenarios in one result: the numbers are those of the runs, whatever else is compared."""

from pathlib import Path

import numpy as np
import pytest

import omni_mj as om
from omni_mj.measure.result import Outcome
from omni_mj.studies.outcome import StoppedError

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


def test_every_outcome_is_that_of_the_run_of_its_scenario(result: om.Result, scenarios: list[om.Scenario]) -> None:
    summary = result.summary()
    assert (summary["controllers"], summary["limits"]) == (list(CONTROLLERS), ["oracle"])
    assert (summary["seeds"], summary["complete"], summary["subject"]) == (list(SEEDS), True, "comp-flc")
    frames = result.frames()
    assert frames.column_names[0] == "scenario"
    for each in scenarios:
        alone = om.run(each, CONTROLLERS, SEEDS, subject="comp-flc")
        entry, other = summary["scenarios"][each.name], alone.summary()["scenarios"][each.name]
        assert entry | {"wall_s": 0} == other | {"wall_s": 0}
        assert entry["status"] == "done"
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
    assert kept == names | {"summary.json"}
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
    result = om.compare(scenarios, ("flc",), 1, after_scenario=lambda result, outcome: told.append(outcome))
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
        before_scenario=lambda simulation: after_frame,
        after_scenario=lambda result, outcome: done.append(outcome),
    )  # fmt: skip
    assert (result.complete, result.stopped) == (False, "interrupted")
    assert [outcome.entry["status"] for outcome in result.outcomes] == ["done", "not run"]

    def at_once(frame: int) -> None:
        raise StoppedError("terminated")

    one = om.run(scenarios[0], after_frame=at_once).summary()
    assert (one["complete"], one["stopped"], one["scenarios"]["there"]["frames"]) == (False, "terminated", 1)


def test_what_cannot_stand_in_one_table_is_refused(scenarios: list[om.Scenario]) -> None:
    for given, words in (
        ({"scenarios": scenarios[:1] * 2}, "two scenarios are called 'there'"),
        ({"scenarios": scenarios, "controllers": ("flc", "p"), "subject": "lqr"}, "choose from flc, p"),
        ({"scenarios": ["rekt"]}, "did you mean 'rect'"),
    ):
        with pytest.raises(om.OmniError, match=words):
            om.compare(**given)
