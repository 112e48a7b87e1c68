"""Who is better, and what the tables say of it: errors given, verdicts known, whoever is asked about."""

from typing import Any

import numpy as np
import pytest
import scipy.stats
from logs import failure, filled, rows
from numpy.typing import ArrayLike

from omni_mj.measure import metrics, summary, table
from omni_mj.measure.running import STATISTICS
from omni_mj.measure.statistics import spread
from omni_mj.measure.verdict import verdicts
from omni_mj.show import compare_table

FRAMES, SEEDS = 60, 4


def found(failed: str = "", **errors_m: ArrayLike) -> dict[str, Any]:
    """Results of controllers whose error is the same in all frames, one number for all seeds or one each.

    Of the controller `failed` the last seed failed; it had no error before.
    """
    x = np.concatenate([np.broadcast_to(error, SEEDS) for error in errors_m.values()])
    pose = np.stack([x, np.zeros_like(x), np.zeros_like(x)], axis=1)
    log = filled(rows(tuple(errors_m), range(SEEDS)), FRAMES, pose=pose)
    failures = [failure(log, int(log.of(failed)[-1]))] if failed else []
    return summary.results(log, failures, metrics.row_metrics(log, failures))


def verdict(results: dict[str, Any], informed: list[str], subject: str | None) -> dict[str, Any] | None:
    """Of a comparison of one scenario."""
    return verdicts({"rect": {"results": results, "status": "done"}}, informed, subject)["rect"]


def test_a_subject_beats_those_whose_error_is_above_its_own() -> None:
    """As good as is not beaten, one that knows the truth is no rival, and errors of zero have no ratio."""
    results = found(flc=0.03, equal=0.012, mine=0.012, lqr=0.01, zero=0.0, oracle=0.001)
    for subject, beaten in {
        "mine": ["flc"],
        "lqr": ["flc", "equal", "mine"],
        "zero": ["flc", "equal", "mine", "lqr"],
        "flc": [],
    }.items():
        given = verdict(results, ["oracle"], subject)
        assert given is not None
        for errors in given["errors"].values():
            assert errors["beats"] == beaten
            assert sorted(errors["beats"] + errors["loses_to"] + [subject, "oracle"]) == sorted(results)
            assert errors["best"] == ("lqr" if subject == "zero" else "zero")
    mine = verdict(results, ["oracle"], "mine")
    assert mine is not None
    against = mine["errors"]["max"]["against"]
    assert against["lqr"]["ratio"] == pytest.approx(1.2)
    assert against["zero"]["ratio"] is None
    assert len(mine["why_not"]) == 2 * 3
    assert mine["why_not"][0].startswith("maximum error 1.20 cm, that of equal 1.20 cm, a difference within chance")
    assert all("oracle, which knows the truth: 0.10 cm" in sentence for sentence in mine["why_not"])


def test_without_a_subject_or_rivals_there_is_no_verdict() -> None:
    assert verdict(found(mine=0.01, oracle=0.001), ["oracle"], "mine") is None
    assert verdict(found(flc=0.01, smith=0.01), [], "mine") is None
    assert verdict(found(flc=0.01, smith=0.01), [], None) is None
    stopped = {"rect": {"results": found(flc=0.01, smith=0.01), "status": "stopped"}}
    assert verdicts(stopped, [], "flc") == {"rect": None}


def test_verdicts_are_corrected_for_the_number_of_all_of_them() -> None:
    """By Holm's method over two scenarios, two rivals and two errors, which are the same here as errors are the same in
    all frames: eight p, of which those of a rival that failed are none, so that six count."""
    near, far, lone = ([0.0202, 0.0200, 0.0203, 0.0203], [0.021, 0.024, 0.022, 0.025], [0.03, 0.01, 0.02, 0.05])
    mine = [0.0199, 0.0197, 0.0199, 0.0200]
    entries = {
        "one": {"results": found(near=near, far=far, mine=mine), "status": "done"},
        "two": {"results": found("near", near=near, lone=lone, mine=mine), "status": "done"},
    }
    given = verdicts(entries, [], "mine")
    p = {rival: scipy.stats.ttest_rel(mine, other).pvalue for rival, other in
         (("near", near), ("far", far), ("lone", lone))}  # fmt: skip
    assert p["near"] < 0.05 / 6 < p["far"] < 0.05 < p["lone"]  # so that the least two, and the next two, are apart
    wanted = {"near": 6 * p["near"], "far": 4 * p["far"], "lone": 2 * p["lone"]}
    for scenario, rivals in (("one", ("near", "far")), ("two", ("lone",))):
        for errors in given[scenario]["errors"].values():  # type: ignore[index]
            for rival in rivals:
                pair = errors["against"][rival]
                assert pair["p"] == pytest.approx(p[rival], rel=1e-6)
                assert pair["p_adjusted"] == pytest.approx(wanted[rival], rel=1e-6)
                assert pair["beyond_chance"] is bool(wanted[rival] <= 0.05) is (rival == "near")
    failed = given["two"]["errors"]["max"]["against"]["near"]  # type: ignore[index]
    assert (failed["p"], failed["p_adjusted"], failed["beyond_chance"]) == (None, None, None)


def test_whoever_failed_is_behind_everybody_who_did_not() -> None:
    """Though its other seeds have the least error."""
    results = found("mine", flc=0.03, mine=0.0, lqr=0.01)
    for subject, beaten in {"mine": [], "lqr": ["flc", "mine"]}.items():
        given = verdict(results, [], subject)
        assert given is not None
        assert given["errors"]["mean"]["beats"] == beaten
    mine = verdict(results, [], "mine")
    assert mine is not None
    assert mine["errors"]["max"]["against"]["flc"] == {
        **dict.fromkeys(("ratio", "difference_m", "plus_minus_m", "p", "p_adjusted", "beyond_chance"))
    }  # fmt: skip
    assert mine["why_not"][0] == "maximum error unknown (1 of 4 failed), that of flc 3.00 cm"


def limit(error_m: float) -> dict[str, Any]:
    """Errors of a limit, the same in all statistics."""
    axes = ("x", "y", "distance", "along", "across")
    return {axis: {statistic: spread(np.full(SEEDS, error_m)) for statistic in STATISTICS} for axis in axes}


def compared(
    results: dict[str, Any], informed: list[str], subject: str | None, **limits: dict[str, Any]
) -> dict[str, Any]:
    """What `omni-mj compare` would write of one scenario that was run and one that could not be."""
    entry = {
        "description": "one | two", "plant": "mujoco", "robot": "tigers-v2016", "status": "done", "reason": None,
        "frames": FRAMES, "simulated_s": 1.0, "wall_s": 1.0, "settings": {}, "paper_table": 0, "paper": None,
        "events": [], "failed": [], "results": results, "seeds": list(range(SEEDS)), **limits,
    }  # fmt: skip
    failed = entry | {"status": "failed", "reason": "robots overlap", "results": {}, "seeds": []}
    return summary.document(
        {"rect": entry, "circle": failed}, results, informed, range(20),
        created="", wall_s=1.0, complete=True, stopped=None, subject=subject, repeat="omni-mj compare",
    )  # fmt: skip


def test_markdown_marks_the_best_competitor_the_informed_and_what_failed() -> None:
    results = found("mine", flc=[0.01, 0.02, 0.03, 0.04], lqr=0.015, mine=0.0, oracle=0.001)
    lines = compare_table.markdown(compared(results, ["oracle"], "lqr")).splitlines()
    half = 100 * scipy.stats.t.ppf(0.975, 3) * scipy.stats.sem([0.01, 0.02, 0.03, 0.04])
    for line in (
        "## 99th percentile of the error in the plane in cm",
        f"| rect | 2.50±{half:.2f} | **1.50±0.00** | failed 1 of 4 | 0.10±0.00 |",
        "## Error along the path in cm: maximum/mean, means over the seeds",
        "| rect | 2.50/2.50 | 1.50/1.50 | failed 1 of 4 | 0.10/0.10 |",  # the reference rests, so that along is x
        "| rect | 0.00/0.00 | 0.00/0.00 | failed 1 of 4 | 0.00/0.00 |",
        "|  | flc | lqr | mine | oracle (informed) |",
        "| circle | failed |  |  |  |",
        "- circle: failed: robots overlap",
        "| rect | one \\| two | 4 | 1.0 | 1.0 |",
        "## Verdicts on lqr",
        f"| rect | maximum | -40 ? | {table.DASH} | 2 of 2 | flc |",
    ):
        assert line in lines, line
    assert sum("after Holm's correction for all 2 verdicts" in line for line in lines) == 1, "one rival failed"
    assert not any("Verdicts" in line for line in compare_table.markdown(compared(results, [], None)).splitlines())


def test_known_limits_stand_beside_the_controllers() -> None:
    results = found(flc=0.03, mine=0.04)
    given = compared(results, [], "mine", limit=limit(0.02), limit_without_noise=limit(0.001))
    assert given["scenarios"]["rect"]["verdict"]["why_not"][1].endswith(
        "; the limit: 2.00 cm; the limit without noise: 0.10 cm"
    )
    lines = compare_table.markdown(given).splitlines()
    for line in (
        "|  | flc | mine | limit | limit without noise |",
        "| rect | **3.00±0.00** | 4.00±0.00 | 2.00±0.00 | 0.10±0.00 |",
        "| rect | 3.00/3.00 | 4.00/4.00 | 2.00/2.00 | 0.10/0.10 |",
        "|  |  | limit | 2.00/2.00 | 2.00/2.00 | 2.00±0.00/2.00±0.00 |  |  |  |  |  |",
    ):
        assert line in lines, line


def test_who_never_settles_counts_and_who_fails_too() -> None:
    """Seeds of three controllers, of which 1, 3 and 4 of 4 settle at once; the third's last seed fails."""
    errors = {"few": [0.0, 0.02, 0.02, 0.02], "most": [0.0, 0.0, 0.0, 0.02], "failing": 0.0}
    results = found("failing", **errors)
    assert [result["settled"] for result in results.values()] == [1, 3, 3]
    assert [result["settle_s"]["mean"] for result in results.values()] == [None] * 3
    assert [result["settle_s"]["median"] for result in results.values()] == [None, 0.0, 0.0]
    cells = [table.settled(result) for result in results.values()]
    assert cells == ["never (1/4)", "0.00 (3/4)", "0.00 (3/4)"]
    assert results["failing"]["effort_m_s2"]["mean"] is results["failing"]["excess_effort_m_s2"]["mean"] is None


def test_the_terminal_shows_the_same(capsys: pytest.CaptureFixture[str]) -> None:
    results = found(flc=0.473, mine=0.015, p=0.01, oracle=0.001)
    given = compared(results, ["oracle"], "mine")
    compare_table.show(given)
    out = capsys.readouterr().out
    cells = table.table(given).rows
    assert [row[5] for row in cells] == [f"{e}±0.00/{e}±0.00" for e in ("47.30", "1.50", "1.00", "0.10")]
    assert [row[1] for row in cells] == ["4", "", "", ""]
    for row in cells:
        assert " ".join(row).split() in [line.split() for line in out.splitlines()]
    assert "why not: rect: maximum error 1.50 cm, that of p 1.00 cm" in out
    assert "note: circle: failed: robots overlap" in out
