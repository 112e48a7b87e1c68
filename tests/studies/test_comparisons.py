"""Many scenarios in one result: the numbers are those of the runs, whatever else is compared."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from benches.studies import Outcome, StoppedError

import omni_mj as om

SEEDS = range(7, 10)
CONTROLLERS = ("flc", "comp-flc", "oracle")


def short(name: str, waypoints: list[list[float]], **sections: dict[str, object]) -> om.Scenario:
    reference = {"waypoints": waypoints, "settle_s": 0.5}
    return om.load_scenario("rect", plant="kinematic", reference=reference, **sections).replace(
        name=name
    )


@pytest.fixture(scope="module")
def scenarios() -> list[om.Scenario]:
    there = short("there", [[0, 0], [0.2, 0.1]])
    return [there, short("bend", [[0, 0], [0.15, 0], [0.15, 0.15]], radio={"delay_frames": 4})]


@pytest.fixture(scope="module")
def result(scenarios: list[om.Scenario]) -> om.Result:
    return om.compare(scenarios, CONTROLLERS, SEEDS, subject="comp-flc", keep_frames=True)


def same(ours: Any, theirs: Any) -> None:
    """Two Arrow tables, value by value; one missing number is as good as another."""
    assert ours.column_names == theirs.column_names
    for name in ours.column_names:
        np.testing.assert_array_equal(
            ours[name].to_pylist(), theirs[name].to_pylist(), err_msg=name
        )


def test_outcomes_equal_those_of_separate_runs(
    result: om.Result, scenarios: list[om.Scenario], tmp_path: Path
) -> None:
    """In the summary, the frames and the files, which are named after their scenarios."""
    found = result.summary()
    assert (found["controllers"], found["privileged"], found["subject"]) == (
        list(CONTROLLERS),
        ["oracle"],
        "comp-flc",
    )
    frames = result.frames()
    for each in scenarios:
        alone = om.run(each, CONTROLLERS, SEEDS, subject="comp-flc")
        entry, other = found["scenarios"][each.name], alone.summary()["scenarios"][each.name]
        apart = {"wall_s": 0, "verdict": None}  # which depends on how many other verdicts there are
        assert entry | apart == other | apart
        assert (entry["status"], entry["seeds"]) == ("done", list(SEEDS))
        pair, of_one = (
            each["verdict"]["errors"]["max"]["against"]["flc"] for each in (entry, other)
        )
        assert of_one["p"] == pair["p"] <= of_one["p_adjusted"] <= pair["p_adjusted"]
        assert "oracle" not in entry["verdict"]["errors"]["max"]["against"]
        same(frames.filter([name == each.name for name in frames["scenario"].to_pylist()]).drop(["scenario"]),
             alone.frames())  # fmt: skip
    result.save(tmp_path)
    names = {
        path.relative_to(tmp_path).as_posix() for path in tmp_path.rglob("*") if path.is_file()
    }
    assert names >= {
        "scenarios/there.toml",
        "trajectories/bend.parquet",
        "summary.json",
        "provenance.json",
    }
    assert om.load_scenario(tmp_path / "scenarios" / "bend.toml").seed_list == list(SEEDS)


def test_stopped_comparison_keeps_finished_scenarios(scenarios: list[om.Scenario]) -> None:
    """In the second scenario: it counts as not run, since half of it would not compare."""
    done: list[Outcome] = []

    def at_frame(frame: int) -> None:
        if done and frame == 5:
            raise StoppedError("interrupted")

    result = om.compare(
        scenarios, ("flc", "comp-flc"), 2, "flc",
        start_progress=lambda title, frames: at_frame, after_scenario=lambda result, outcome: done.append(outcome),
    )  # fmt: skip
    assert (result.complete, result.stopped) == (False, "interrupted")
    assert [entry["status"] for entry in result.summary()["scenarios"].values()] == [
        "done",
        "not run",
    ]

    def at_once(frame: int) -> None:
        raise StoppedError("terminated")

    one = om.run(scenarios[0], after_frame=at_once).summary()
    assert (one["complete"], one["stopped"], one["scenarios"]["there"]["frames"]) == (
        False,
        "terminated",
        1,
    )


def test_scenarios_that_cannot_be_compared_are_rejected(scenarios: list[om.Scenario]) -> None:
    for given, words in (
        ({"scenarios": scenarios[:1] * 2}, "two scenarios are called 'there'"),
        (
            {"scenarios": scenarios, "controllers": ("flc", "p"), "subject": "lqr"},
            "choose from flc, p",
        ),
        ({"scenarios": ["rekt"]}, "did you mean 'rect'"),
    ):
        with pytest.raises(om.OmniError, match=words):
            om.compare(**given)
