"""Recovery from faults: recomputed by hand, of rows of all kinds, in summaries and tables."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from logs import failure, filled, rows
from numpy.typing import NDArray

import omni_mj as om
from omni_mj.measure import events, metrics, recovery
from omni_mj.measure.table import text
from omni_mj.scenarios.settings import Settings
from omni_mj.show import compare_table
from omni_mj.simulate.log import Log
from omni_mj.simulate.simulation import Failure

FRAME_S = 1 / 60
PUSH = {"kind": "push", "at": 1.0, "for": 0.5, "force_n": 10.0}  # frames 60 to 89, looked at until 209
TILT = {"kind": "tilt", "at": 3.0, "angle_deg": 2.0}  # from frame 180 on


def met(*faults: dict[str, Any]) -> Settings:
    return Settings(fault=faults)


def recoveries(log: Log, failures: Sequence[Failure] = ()) -> dict[str, NDArray]:
    """What is measured of faults."""
    return {name: values for name, values in metrics.row_metrics(log, failures).items() if name.startswith("fault_")}


def strayed(frames: int, **spans: tuple[int, int, float]) -> NDArray:
    """Poses (frames, 1, 3) at a distance of 3 : 4 : 5 from a reference that stays at zero, in some spans of frames."""
    pose = np.zeros((frames, 1, 3))
    for first, stop, distance in spans.values():
        pose[first:stop, 0, :2] = 0.6 * distance, 0.8 * distance
    return pose


@pytest.mark.parametrize(
    ("spans", "excursion", "recovered"),
    [
        ({}, 0.0, 0.0),
        ({"before": (0, 60, 0.5)}, 0.0, 0.0),
        ({"small": (60, 300, 0.0199)}, 0.0199, 0.0),
        ({"once": (70, 75, 0.3)}, 0.3, 15 * FRAME_S),
        ({"once": (70, 75, 0.3), "again": (100, 131, 0.0201)}, 0.3, 71 * FRAME_S),
        ({"at the end": (209, 210, 0.1)}, 0.1, None),
        ({"after": (210, 300, 0.5)}, 0.0, 0.0),
        ({"throughout": (0, 300, 0.1)}, 0.1, None),
    ],
)
def test_excursion_and_recovery_are_those_until_two_seconds_after(
    spans: dict[str, Any], excursion: float, recovered: float | None
) -> None:
    found = recoveries(filled(rows(settings=met(PUSH)), 300, pose=strayed(300, **spans)))
    assert found["fault_1_excursion_m"] == pytest.approx([excursion], abs=1e-12)
    assert found["fault_1_recovery_s"] == pytest.approx([np.inf if recovered is None else recovered])


def test_a_fault_that_goes_on_is_looked_at_until_the_end_of_the_run() -> None:
    """From its first frame; the fault before it until its own end."""
    pose = strayed(300, late=(200, 290, 0.1))
    found = recoveries(filled(rows(settings=met(PUSH, TILT)), 300, pose=pose))
    assert {name: values[0] for name, values in found.items()} == pytest.approx(
        {"fault_1_excursion_m": 0.1, "fault_1_recovery_s": np.inf, "fault_2_excursion_m": 0.1}
        | {"fault_2_recovery_s": 110 * FRAME_S}
    )


def test_rows_that_failed_did_not_recover_and_those_without_a_fault_have_nothing() -> None:
    """Nor has one that came to its end before."""
    own = [met(PUSH), met(PUSH), met(), met(PUSH)]
    table = [replace(row, settings=settings) for row, settings in zip(rows(("a", "b", "c", "d")), own, strict=True)]
    log = filled(table, 300, [300, 100, 300, 40])
    found = recoveries(log, [failure(log, 1)])
    np.testing.assert_array_equal(found["fault_1_excursion_m"], [0.0, np.inf, np.nan, np.nan])
    np.testing.assert_array_equal(found["fault_1_recovery_s"], [0.0, np.inf, np.nan, np.nan])
    assert recoveries(filled(rows(), 10)) == {}


def test_a_summary_has_the_spread_over_the_rows_that_meet_the_same() -> None:
    """Of a row that meets something else, nothing is in it."""
    own = [met(PUSH), met(PUSH), met(TILT), met(PUSH, TILT)]
    table = [replace(r, settings=settings) for r, settings in zip(rows(("a",), range(4)), own, strict=True)]
    pose = np.concatenate([strayed(300, once=(60, 70 + 5 * i, 0.1 * (i + 1))) for i in range(4)], axis=1)
    log = filled(table, 300, pose=pose)
    (told,) = recovery.results(log, "a", recoveries(log))
    assert (told["kind"], told["at_s"], told["for_s"]) == ("push", 1.0, 0.5)
    assert told["fault"] == "push (force_n = 10, direction_deg = 0), from 1 s to 1.5 s"
    assert told["excursion_m"]["seeds"] == pytest.approx([0.1, 0.2, 0.4])
    assert told["recovery_s"]["seeds"] == pytest.approx([10 * FRAME_S, 15 * FRAME_S, 25 * FRAME_S])
    assert told["recovery_s"]["median"] == pytest.approx(15 * FRAME_S)
    assert told["excursion_m"]["mean"] == pytest.approx(0.7 / 3)


def test_faults_are_events_of_every_row_when_they_begin_and_end() -> None:
    log = filled(rows(("a", "b"), settings=met(PUSH, TILT)), 200, [200, 85], winding=25.0, battery=22.0)
    push, tilt = "push (force_n = 10, direction_deg = 0)", "tilt (angle_deg = 2, direction_deg = 0)"
    begins = [(60, "a", f"begins: {push}"), (60, "b", f"begins: {push}")]
    assert [(e.frame, e.controller, e.text) for e in events.find(log)] == [
        *begins,
        (90, "a", f"ends: {push}"),
        (180, "a", f"begins: {tilt}"),
    ]
    assert {e.kind for e in events.find(log)} == {events.FAULT}


def test_a_run_tells_how_its_controllers_recover() -> None:
    """What the table says is what the summary holds, which is what the rows have."""
    fault, route = {"kind": "vision-out", "at": 0.5, "for": 0.5}, {"waypoints": [[0, 0], [0.5, 0]]}
    plain = om.scenario("rect", plant="kinematic", reference=route)
    chosen = om.scenario(
        "rect", plant="kinematic", reference=route, fault=[fault, {"kind": "alpha", "at": 2, "to": 0.8}]
    )
    result = om.run(chosen, ["flc", "comp-flc"], seeds=[0, 1, 2])
    results = result.summary()["scenarios"]["rect"]["results"]
    drawn = recovery.table(result.summary())
    assert drawn is not None
    assert [row[:2] for row in drawn.rows] == [
        ["vision-out, from 0.5 s to 1 s", "flc"],
        ["", "comp-flc"],
        ["alpha of 0.8, from 2 s on", "flc"],
        ["", "comp-flc"],
    ]
    lines = result.rows().to_pydict()
    for i, row in enumerate(drawn.rows):
        told = results[row[1]]["recovery"][i // 2]
        assert row[2] == f"{100 * told['excursion_m']['median']:.2f}"
        own = [k for k, name in enumerate(lines["controller"]) if name == row[1]]
        assert told["excursion_m"]["seeds"] == [lines[f"fault_{i // 2 + 1}_excursion_m"][k] for k in own]
    assert text(drawn).startswith("recovery, median of 3 seeds: ")
    assert "fault" not in lines, "all rows meet the same"
    assert recovery.table(om.run(plain, ["flc"], seeds=[0]).summary()) is None


def test_a_comparison_tells_how_each_controller_comes_back_from_each_fault() -> None:
    """A line for each fault of each scenario, with what the summary has of each controller."""
    route = {"waypoints": [[0, 0], [0.3, 0]], "settle_s": 0.2}
    happening = [{"kind": "vision-out", "at": 0.3, "for": 0.2}, {"kind": "alpha", "at": 1, "to": 0.0}]
    met_by = om.scenario("rect", plant="kinematic", reference=route, fault=happening).replace(name="met")
    none = om.scenario("rect", plant="kinematic", reference=route)
    compared = om.compare([none, met_by], ["flc", "comp-flc"], seeds=2).summary()
    drawn = recovery.matrix(compared)
    assert drawn is not None
    assert [row[:2] for row in drawn.rows] == [["met", "vision-out, 0.3 s"], ["met", "alpha, 1 s"]]
    for i, row in enumerate(drawn.rows):
        for name, cell in zip(compared["controllers"], row[2:], strict=True):
            told = compared["scenarios"]["met"]["results"][name]["recovery"][i]
            worst, time = cell.split("/")
            assert worst == f"{100 * told['excursion_m']['median']:.2f}"
            median = told["recovery_s"]["median"]
            assert time == ("never" if median is None else f"{median:.2f}")
    assert drawn.rows[1][2].endswith("/never"), "a robot that does not move comes back from nothing"
    assert drawn.title in compare_table.markdown(compared)
    without = {name: entry for name, entry in compared["scenarios"].items() if name == "rect"}
    assert recovery.matrix({**compared, "scenarios": without}) is None
