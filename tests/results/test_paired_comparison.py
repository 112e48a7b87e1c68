"""Verdicts, and statistics over seeds compared with scipy's distributions."""

import math
from itertools import combinations
from typing import Any

import numpy as np
import pytest
import scipy.stats
from benches.logs import (
    comparison_summary,
    failure,
    fill_log,
    judge_subject,
    paired_comparison,
    results,
    rows,
    seed_statistics,
)
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import ArrayLike

from omni_mj.studies import compare_table

FRAMES, SEEDS = 60, 4


def results_of(failed: str = "", **errors_m: ArrayLike) -> dict[str, Any]:
    """Return results of controllers with constant errors, one for all seeds or one per seed.

    The last seed of the controller `failed` fails.
    """
    x = np.concatenate([np.broadcast_to(error, SEEDS) for error in errors_m.values()])
    pose = np.stack([x, np.zeros_like(x), np.zeros_like(x)], axis=1)
    log = fill_log(rows(tuple(errors_m), range(SEEDS)), FRAMES, pose=pose)
    return results(log, [failure(log, int(log.rows_of(failed)[-1]))] if failed else [])


def verdict(of: dict[str, Any], privileged: list[str], subject: str | None) -> Any:
    """Return the verdict on a comparison of one scenario."""
    return judge_subject({"rect": {"results": of, "status": "done"}}, privileged, subject)["rect"]


@given(st.lists(st.floats(-10, 10, width=32), min_size=2, max_size=9))
def test_intervals_and_pairs_are_those_of_students_t(values: list[float]) -> None:
    """Intervals and tests agree with scipy up to rounding of 1e-9."""
    n, ours = len(values), np.array(values)
    spread = seed_statistics.summarize_seeds(ours)
    half = scipy.stats.t.ppf(0.975, n - 1) * scipy.stats.sem(ours)
    assert spread["mean"] == pytest.approx(ours.sum() / n, abs=1e-9)
    assert spread["ci95_half_width"] == pytest.approx(half, abs=1e-9)
    theirs = ours + 0.003 + 0.01 * np.sin(np.arange(n))
    difference, width, p = paired_comparison.paired_difference(
        spread, seed_statistics.summarize_seeds(theirs)
    )
    test = scipy.stats.ttest_rel(ours, theirs)
    assert difference is not None
    assert width is not None
    interval = test.confidence_interval(0.95)
    assert (difference - width, difference + width) == pytest.approx(tuple(interval), abs=1e-9)
    assert p == pytest.approx(test.pvalue, rel=1e-6)


def test_statistics_include_seeds_that_failed_or_never_settled() -> None:
    """One infinite value of three leaves a median but no mean; one NaN leaves nothing.

    A mean over the other seeds would be biased. A single seed has no interval.
    """
    keys = "per_seed", "median", "min", "max", "mean", "ci95_half_width"
    for values, expected in {
        (1.0, math.nan, 3.0): ([1.0, None, 3.0], None, None, None, None, None),
        (1.0, math.inf, 3.0): ([1.0, None, 3.0], 3.0, 1.0, None, None, None),
        (math.inf, math.inf): ([None, None], None, None, None, None, None),
        (2.0,): ([2.0], 2.0, 2.0, 2.0, 2.0, None),
    }.items():
        assert seed_statistics.summarize_seeds(np.array(values)) == dict(
            zip(keys, expected, strict=True)
        ), values


@settings(max_examples=60)
@given(st.lists(st.floats(0, 1), max_size=7))
def test_holm_is_the_closure_of_bonferroni(p: list[float]) -> None:
    """A hypothesis is rejected if every set that contains it is, by Bonferroni's method."""
    sets = [subset for size in range(1, len(p) + 1) for subset in combinations(range(len(p)), size)]
    of_set = {subset: min(1.0, len(subset) * min(p[i] for i in subset)) for subset in sets}
    expected = [
        max(value for subset, value in of_set.items() if i in subset) for i in range(len(p))
    ]
    assert paired_comparison.holm_adjusted(np.array(p)).tolist() == pytest.approx(
        expected, rel=1e-12
    )


def test_a_subject_beats_those_whose_error_is_above_its_own() -> None:
    """Equal errors count as a loss; privileged controllers do not compete."""
    of = results_of(flc=0.03, equal=0.012, mine=0.012, lqr=0.01, zero=0.0, oracle=0.001)
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
    for errors_m, privileged, subject in (
        ({"oracle": 0.001}, ["oracle"], "mine"),
        ({"smith": 0.01}, [], None),
    ):
        assert verdict(results_of(mine=0.01, **errors_m), privileged, subject) is None
    stopped = {"rect": {"results": results_of(flc=0.01, smith=0.01), "status": "stopped"}}
    assert judge_subject(stopped, [], "flc") == {"rect": None}


def test_verdicts_are_corrected_for_the_number_of_all_of_them() -> None:
    """Holm's method covers two scenarios, two competitors and two statistics: eight p-values.

    Those of a failed competitor do not exist, so that six count. Both statistics are equal, because
    the errors are constant.
    """
    near, far, lone = (
        [0.0202, 0.0200, 0.0203, 0.0203],
        [0.021, 0.024, 0.022, 0.025],
        [0.03, 0.01, 0.02, 0.05],
    )
    mine = [0.0199, 0.0197, 0.0199, 0.0200]
    entries = {
        "one": {"results": results_of(near=near, far=far, mine=mine), "status": "done"},
        "two": {"results": results_of("near", near=near, lone=lone, mine=mine), "status": "done"},
    }
    verdicts_by_scenario: Any = judge_subject(entries, [], "mine")
    competitors = (("near", near), ("far", far), ("lone", lone))
    p = {
        competitor: scipy.stats.ttest_rel(mine, errors).pvalue for competitor, errors in competitors
    }
    assert p["near"] < 0.05 / 6 < p["far"] < 0.05 < p["lone"]
    expected = {"near": 6 * p["near"], "far": 4 * p["far"], "lone": 2 * p["lone"]}
    for scenario, competitor in (("one", "near"), ("one", "far"), ("two", "lone")):
        for errors in verdicts_by_scenario[scenario]["errors"].values():
            pair = errors["against"][competitor]
            assert pair["p_adjusted"] == pytest.approx(expected[competitor], rel=1e-6)
            assert (
                pair["significant"] is bool(expected[competitor] <= 0.05) is (competitor == "near")
            )
    failed = verdicts_by_scenario["two"]["errors"]["max"]["against"]["near"]
    assert (failed["p"], failed["p_adjusted"], failed["significant"]) == (None, None, None)


def test_seeds_that_never_settle_or_fail_count() -> None:
    """Of four seeds, 1, 3 and 4 settle; the last seed of the third controller fails."""
    of = results_of("failing", few=[0.0, 0.02, 0.02, 0.02], most=[0.0, 0.0, 0.0, 0.02], failing=0.0)
    assert [result["n_settled"] for result in of.values()] == [1, 3, 3]
    assert [result["settle_s"]["mean"] for result in of.values()] == [None] * 3
    assert [result["settle_s"]["median"] for result in of.values()] == [None, 0.0, 0.0]
    assert (
        of["failing"]["effort_m_s2"]["mean"] is of["failing"]["excess_effort_m_s2"]["mean"] is None
    )
    text = compare_table.to_markdown(comparison_summary(of, [], None))
    assert all(words in text for words in ("never (1/4)", "0.00 (3/4)"))
