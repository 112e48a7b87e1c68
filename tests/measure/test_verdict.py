"""Who is better, and what the tables say of it: errors given, verdicts known, whoever is asked about."""

from typing import Any

import numpy as np
import pytest
import scipy.stats
from logs import failure, filled, rows
from numpy.typing import ArrayLike

from omni_mj.measure import metrics, summary, table
from omni_mj.measure.verdict import verdict
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


def test_a_subject_beats_those_whose_error_is_above_its_own() -> None:
    """As good as is not beaten, a limit is no rival, and errors of zero have no ratio."""
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
    assert all("oracle, a limit: 0.10 cm" in sentence for sentence in mine["why_not"])


def test_without_a_subject_or_rivals_there_is_no_verdict() -> None:
    assert verdict(found(mine=0.01, oracle=0.001), ["oracle"], "mine") is None
    assert verdict(found(flc=0.01, smith=0.01), [], "mine") is None
    assert verdict(found(flc=0.01, smith=0.01), [], None) is None


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
        "ratio": None, "difference_m": None, "plus_minus_m": None, "beyond_chance": None
    }  # fmt: skip
    assert mine["why_not"][0] == "maximum error unknown (1 of 4 failed), that of flc 3.00 cm"


def compared(results: dict[str, Any], limits: list[str], subject: str | None) -> dict[str, Any]:
    """What `omni-mj compare` would write of one scenario that was run and one that could not be."""
    entry = {
        "description": "one | two", "plant": "mujoco", "robot": "tigers-v2016", "status": "done", "reason": None,
        "frames": FRAMES, "simulated_s": 1.0, "wall_s": 1.0, "settings": {}, "paper_table": 0, "paper": None,
        "events": [], "failed": [], "results": results, "verdict": verdict(results, limits, subject),
    }  # fmt: skip
    failed = entry | {"status": "failed", "reason": "robots overlap", "results": {}, "verdict": None}
    return summary.document(
        {"rect": entry, "circle": failed}, results, limits, range(SEEDS),
        created="", wall_s=1.0, complete=True, stopped=None, subject=subject, repeat="omni-mj compare",
    )  # fmt: skip


def test_markdown_marks_the_best_competitor_limits_and_what_failed() -> None:
    results = found("mine", flc=[0.01, 0.02, 0.03, 0.04], lqr=0.015, mine=0.0, oracle=0.001)
    lines = compare_table.markdown(compared(results, ["oracle"], "lqr")).splitlines()
    half = 100 * scipy.stats.t.ppf(0.975, 3) * scipy.stats.sem([0.01, 0.02, 0.03, 0.04])
    for line in (
        f"| rect | 2.50±{half:.2f} | **1.50±0.00** | failed 1 of 4 | 0.10±0.00 |",
        "|  | flc | lqr | mine | oracle (limit) |",
        "| circle | failed |  |  |  |",
        "- circle: failed: robots overlap",
        "| rect | one \\| two | 1.0 | 1.0 |",
        "## Verdicts on lqr",
        f"| rect | maximum | -40 ? | {table.DASH} | 2 of 2 | flc |",
    ):
        assert line in lines, line
    assert not any("Verdicts" in line for line in compare_table.markdown(compared(results, [], None)).splitlines())


def test_the_terminal_shows_the_same(capsys: pytest.CaptureFixture[str]) -> None:
    results = found(flc=0.473, mine=0.015, p=0.01, oracle=0.001)
    given = compared(results, ["oracle"], "mine")
    compare_table.show(given)
    out = capsys.readouterr().out
    cells = table.table(given).rows
    assert [row[4] for row in cells] == [f"{e}±0.00/{e}±0.00" for e in ("47.30", "1.50", "1.00", "0.10")]
    for row in cells:
        assert " ".join(row).split() in [line.split() for line in out.splitlines()]
    assert "why not: rect: maximum error 1.50 cm, that of p 1.00 cm" in out
    assert "note: circle: failed: robots overlap" in out
