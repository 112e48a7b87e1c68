"""Test that comparisons of scenarios have the numbers of separate runs."""

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
    line = short("line", [[0, 0], [0.2, 0.1]])
    return [line, short("bend", [[0, 0], [0.15, 0], [0.15, 0.15]], radio={"delay_frames": 4})]


@pytest.fixture(scope="module")
def result(scenarios: list[om.Scenario]) -> om.Result:
    return om.compare(scenarios, CONTROLLERS, SEEDS, subject="comp-flc", keep_frames=True)


def assert_equal_tables(actual: Any, expected: Any) -> None:
    """Assert that two Arrow tables are equal; NaN equals NaN."""
    assert actual.column_names == expected.column_names
    for name in actual.column_names:
        np.testing.assert_array_equal(
            actual[name].to_pylist(), expected[name].to_pylist(), err_msg=name
        )


def test_outcomes_equal_those_of_separate_runs(
    result: om.Result, scenarios: list[om.Scenario], tmp_path: Path
) -> None:
    """In the summary, the frames and the files."""
    summary = result.summary()
    assert (summary["controllers"], summary["privileged"], summary["subject"]) == (
        list(CONTROLLERS),
        ["oracle"],
        "comp-flc",
    )
    frames = result.frames()
    for scenario in scenarios:
        single_run = om.run(scenario, CONTROLLERS, SEEDS, subject="comp-flc")
        entry, single_entry = (
            summary["scenarios"][scenario.name],
            single_run.summary()["scenarios"][scenario.name],
        )
        # Verdicts depend on how many there are.
        ignored = {"wall_s": 0, "verdict": None}
        assert entry | ignored == single_entry | ignored
        assert (entry["status"], entry["seeds"]) == ("done", list(SEEDS))
        pair, single_pair = (
            e["verdict"]["errors"]["max"]["against"]["flc"] for e in (entry, single_entry)
        )
        assert single_pair["p"] == pair["p"] <= single_pair["p_adjusted"] <= pair["p_adjusted"]
        assert "oracle" not in entry["verdict"]["errors"]["max"]["against"]
        is_scenario = [name == scenario.name for name in frames["scenario"].to_pylist()]
        assert_equal_tables(frames.filter(is_scenario).drop(["scenario"]), single_run.frames())
    result.save(tmp_path)
    names = {
        path.relative_to(tmp_path).as_posix() for path in tmp_path.rglob("*") if path.is_file()
    }
    assert names >= {
        "scenarios/line.toml",
        "trajectories/bend.parquet",
        "summary.json",
        "provenance.json",
    }
    assert om.load_scenario(tmp_path / "scenarios" / "bend.toml").seed_list == list(SEEDS)


def test_stopped_comparison_keeps_finished_scenarios(scenarios: list[om.Scenario]) -> None:
    """A scenario that is stopped counts as not run."""
    done: list[Outcome] = []

    def at_frame(frame: int) -> None:
        if done and frame == 5:
            raise StoppedError("interrupted")

    result = om.compare(
        scenarios,
        ("flc", "comp-flc"),
        2,
        "flc",
        start_progress=lambda title, frames: at_frame,
        after_scenario=lambda result, outcome: done.append(outcome),
    )
    assert (result.complete, result.stopped) == (False, "interrupted")
    assert [entry["status"] for entry in result.summary()["scenarios"].values()] == [
        "done",
        "not run",
    ]

    def stop(frame: int) -> None:
        raise StoppedError("terminated")

    stopped = om.run(scenarios[0], after_frame=stop).summary()
    assert (stopped["complete"], stopped["stopped"], stopped["scenarios"]["line"]["frames"]) == (
        False,
        "terminated",
        1,
    )


def test_scenarios_that_cannot_be_compared_are_rejected(scenarios: list[om.Scenario]) -> None:
    for arguments, message in (
        ({"scenarios": scenarios[:1] * 2}, "two scenarios are called 'line'"),
        (
            {"scenarios": scenarios, "controllers": ("flc", "p"), "subject": "lqr"},
            "choose from flc, p",
        ),
        ({"scenarios": ["rekt"]}, "did you mean 'rect'"),
    ):
        with pytest.raises(om.OmniError, match=message):
            om.compare(**arguments)


def test_a_comparison_is_complete_only_if_everything_ran(scenarios: list[om.Scenario]) -> None:
    """A scenario or a controller without a run is named as the reason."""

    class Unfinished(om.Controller):
        def __init__(self, model: object, reference: object, n: int) -> None:
            raise ImportError("no module named solver")

    impossible = scenarios[1].replace(
        settings=scenarios[1].settings.replace(radio={"delay_frames": 500})
    )
    for compared, controllers, reason in (
        ([scenarios[0], impossible], ["p"], "radio.delay_frames must be less"),
        (scenarios, ["p", Unfinished], "no module named solver"),
    ):
        summary = om.compare(compared, controllers, 2).summary()
        assert not summary["complete"]
        assert reason in summary["stopped"]
    summary = om.run(scenarios[0], [Unfinished]).summary()
    assert not summary["complete"]
    assert reason in summary["stopped"]
    assert om.compare(scenarios, ["p"], 2).summary()["complete"]
