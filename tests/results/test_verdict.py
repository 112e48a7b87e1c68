"""Who is better, and what the tables say of it; statistics over seeds against scipy's own distributions."""

import math
from itertools import combinations
from typing import Any

import numpy as np
import pytest
import scipy.stats
from benches.logs import compared, failure, filled, judge_subject, results, rows, statistics
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import ArrayLike

from omni_mj.studies.compare import compare_table

FRAMES, SEEDS = 60, 4


def found(failed: str = "", **errors_m: ArrayLike) -> dict[str, Any]:
    """Results of controllers whose error is the same in all frames, one number for all seeds or one each.

    Of the controller `failed` the last seed failed; it had no error before.
    """
    x = np.concatenate([np.broadcast_to(error, SEEDS) for error in errors_m.values()])
    pose = np.stack([x, np.zeros_like(x), np.zeros_like(x)], axis=1)
    log = filled(rows(tuple(errors_m), range(SEEDS)), FRAMES, pose=pose)
    return results(log, [failure(log, int(log.rows_of(failed)[-1]))] if failed else [])


def verdict(of: dict[str, Any], privileged: list[str], subject: str | None) -> Any:
    """Of a comparison of one scenario."""
    return judge_subject({"rect": {"results": of, "status": "done"}}, privileged, subject)["rect"]


@given(st.lists(st.floats(-10, 10, width=32), min_size=2, max_size=9))
def test_intervals_and_pairs_are_those_of_students_t(values: list[float]) -> None:
    """scipy computes the same from its own distribution; a rounding error of 1e-9 of the values is allowed."""
    n, ours = len(values), np.array(values)
    spread = statistics.seed_statistics(ours)
    half = scipy.stats.t.ppf(0.975, n - 1) * scipy.stats.sem(ours)
    assert spread["mean"] == pytest.approx(ours.sum() / n, abs=1e-9)
    assert spread["ci95_half_width"] == pytest.approx(half, abs=1e-9)
    theirs = ours + 0.003 + 0.01 * np.sin(np.arange(n))
    difference, width, p = statistics.paired_difference(spread, statistics.seed_statistics(theirs))
    test = scipy.stats.ttest_rel(ours, theirs)
    assert difference is not None
    assert width is not None
    interval = test.confidence_interval(0.95)
    assert (difference - width, difference + width) == pytest.approx(tuple(interval), abs=1e-9)
    assert p == pytest.approx(test.pvalue, rel=1e-6)


def test_a_spread_counts_what_failed_or_never_settled() -> None:
    """Which is without bound: a median stands one of three, a mean does not. What is not a number is not known, and
    then nothing is: a mean of the others would be the survivors'. One seed has no interval."""
    keys = "per_seed", "median", "min", "max", "mean", "ci95_half_width"
    for values, wanted in {
        (1.0, math.nan, 3.0): ([1.0, None, 3.0], None, None, None, None, None),
        (1.0, math.inf, 3.0): ([1.0, None, 3.0], 3.0, 1.0, None, None, None),
        (math.inf, math.inf): ([None, None], None, None, None, None, None),
        (2.0,): ([2.0], 2.0, 2.0, 2.0, 2.0, None),
    }.items():
        assert statistics.seed_statistics(np.array(values)) == dict(
            zip(keys, wanted, strict=True)
        ), values


@settings(max_examples=60)
@given(st.lists(st.floats(0, 1), max_size=7))
def test_holm_is_the_closure_of_bonferroni(p: list[float]) -> None:
    """Of a closed test: one of several is rejected where every set it is in is, by the set's least p times its size."""
    sets = [each for size in range(1, len(p) + 1) for each in combinations(range(len(p)), size)]
    of_set = {each: min(1.0, len(each) * min(p[i] for i in each)) for each in sets}
    wanted = [max(value for each, value in of_set.items() if i in each) for i in range(len(p))]
    assert statistics.holm_adjusted(np.array(p)).tolist() == pytest.approx(wanted, rel=1e-12)


def test_a_subject_beats_those_whose_error_is_above_its_own() -> None:
    """As good as is not beaten, one that knows the truth is no rival, and errors of zero have no ratio."""
    of = found(flc=0.03, equal=0.012, mine=0.012, lqr=0.01, zero=0.0, oracle=0.001)
    for subject, beaten in {
        "mine": ["flc"],
        "lqr": ["flc", "equal", "mine"],
        "zero": ["flc", "equal", "mine", "lqr"],
        "flc": [],
    }.items():
        for errors in verdict(of, ["oracle"], subject)["errors"].values():
            assert errors["beats"] == beaten
            assert sorted(errors["beats"] + errors["loses_to"] + [subject, "oracle"]) == sorted(of)
            assert errors["best_competitor"] == ("lqr" if subject == "zero" else "zero")
    mine = verdict(of, ["oracle"], "mine")
    against = mine["errors"]["max"]["against"]
    assert (against["lqr"]["ratio"], against["zero"]["ratio"]) == (pytest.approx(1.2), None)
    for others, privileged, subject in (
        ({"oracle": 0.001}, ["oracle"], "mine"),
        ({"smith": 0.01}, [], None),
    ):
        assert verdict(found(mine=0.01, **others), privileged, subject) is None
    stopped = {"rect": {"results": found(flc=0.01, smith=0.01), "status": "stopped"}}
    assert judge_subject(stopped, [], "flc") == {"rect": None}


def test_verdicts_are_corrected_for_the_number_of_all_of_them() -> None:
    """By Holm's method over two scenarios, two rivals and two errors, which are the same here as errors are the same in
    all frames: eight p, of which those of a rival that failed are none, so that six count."""
    near, far, lone = (
        [0.0202, 0.0200, 0.0203, 0.0203],
        [0.021, 0.024, 0.022, 0.025],
        [0.03, 0.01, 0.02, 0.05],
    )
    mine = [0.0199, 0.0197, 0.0199, 0.0200]
    entries = {
        "one": {"results": found(near=near, far=far, mine=mine), "status": "done"},
        "two": {"results": found("near", near=near, lone=lone, mine=mine), "status": "done"},
    }
    given: Any = judge_subject(entries, [], "mine")
    rivals = (("near", near), ("far", far), ("lone", lone))
    p = {rival: scipy.stats.ttest_rel(mine, other).pvalue for rival, other in rivals}
    assert (
        p["near"] < 0.05 / 6 < p["far"] < 0.05 < p["lone"]
    )  # so that the least two, and the next two, are apart
    wanted = {"near": 6 * p["near"], "far": 4 * p["far"], "lone": 2 * p["lone"]}
    for scenario, rival in (("one", "near"), ("one", "far"), ("two", "lone")):
        for errors in given[scenario]["errors"].values():
            pair = errors["against"][rival]
            assert pair["p_adjusted"] == pytest.approx(wanted[rival], rel=1e-6)
            assert pair["significant"] is bool(wanted[rival] <= 0.05) is (rival == "near")
    failed = given["two"]["errors"]["max"]["against"]["near"]
    assert (failed["p"], failed["p_adjusted"], failed["significant"]) == (None, None, None)


def test_who_never_settles_counts_and_who_fails_too() -> None:
    """Seeds of three controllers, of which 1, 3 and 4 of 4 settle at once; the third's last seed fails."""
    of = found("failing", few=[0.0, 0.02, 0.02, 0.02], most=[0.0, 0.0, 0.0, 0.02], failing=0.0)
    assert [result["n_settled"] for result in of.values()] == [1, 3, 3]
    assert [result["settle_s"]["mean"] for result in of.values()] == [None] * 3
    assert [result["settle_s"]["median"] for result in of.values()] == [None, 0.0, 0.0]
    assert (
        of["failing"]["effort_m_s2"]["mean"] is of["failing"]["excess_effort_m_s2"]["mean"] is None
    )
    text = compare_table.to_markdown(compared(of, [], None))
    assert all(words in text for words in ("never (1/4)", "0.00 (3/4)"))
