"""Who is better, and what the table says of it: errors given, verdicts known."""

from typing import Any

import numpy as np
import pytest
import scipy.stats
from numpy.typing import ArrayLike

from omni_mj.measure import compare_statistics
from omni_mj.measure.compare_statistics import SUBJECT, verdict
from omni_mj.show import compare_table
from omni_mj.simulate.log import Trajectory

FRAMES, SEEDS = 60, 4


def found(**errors_m: ArrayLike) -> dict[str, Any]:
    """Results of controllers whose error is the same in all frames, one number for all seeds or one each.

    An underscore stands for the hyphen of a name.
    """
    names = tuple(name.replace("_", "-") for name in errors_m)
    trajectory = Trajectory(names, list(range(SEEDS)), FRAMES)
    x = np.concatenate([np.broadcast_to(error, SEEDS) for error in errors_m.values()])
    for frame in range(FRAMES):
        ref = np.zeros((len(x), 3))
        pose = np.stack([x, ref[:, 0], ref[:, 0]], axis=1)
        trajectory.write(frame, ref=ref, pose=pose, command=ref)
    return compare_statistics.results(trajectory)


def test_it_beats_the_baselines_when_it_is_below_each_of_them() -> None:
    best = verdict(found(flc=0.03, comp_flc=0.02, p=0.011, adaptive_comp_flc=0.01), [])
    assert best is not None
    assert [best["errors"][statistic]["beats"] for statistic in ("max", "mean")] == [True, True]
    assert best["why_not"] == []
    equal = verdict(found(flc=0.03, comp_flc=0.01, p=0.011, adaptive_comp_flc=0.01), [])
    assert equal is not None
    assert equal["errors"]["max"]["beats"] is False
    assert len(equal["why_not"]) == 2
    assert "that of comp-flc 1.00 cm" in equal["why_not"][0]


@pytest.mark.parametrize(("ours", "within"), [(0.0124, True), (0.0126, False)])
def test_it_may_exceed_the_better_contender_by_a_quarter(ours: float, within: bool) -> None:
    result = verdict(found(smith=0.02, lqr=0.01, adaptive_comp_flc=ours, oracle=0.001), ["oracle"])
    assert result is not None
    for errors in result["errors"].values():
        assert errors["contender"] == "lqr"
        assert errors["within"] is within
        assert errors["against"]["lqr"]["ratio"] == pytest.approx(ours / 0.01)
        assert errors["beats"] is None, "no baseline was run"
        assert "oracle" not in errors["against"], "a limit is no rival"
    assert len(result["why_not"]) == (0 if within else 2)
    assert all("oracle, a limit: 0.10 cm" in sentence for sentence in result["why_not"])


@pytest.mark.parametrize("shift_m", [0.0005, 0.003])
def test_two_controllers_are_compared_seed_by_seed(shift_m: float) -> None:
    """scipy's test of related samples gives the interval; it sees a shift that two separate intervals would hide."""
    theirs = np.array([0.010, 0.030, 0.050, 0.070])
    ours = theirs - shift_m + 0.001 * np.array([0.4, -1.0, 0.7, -0.1])
    result = verdict(found(flc=theirs, adaptive_comp_flc=ours), [])
    assert result is not None
    pair = result["errors"]["max"]["against"]["flc"]
    interval = scipy.stats.ttest_rel(ours, theirs).confidence_interval(0.95)
    low, high = pair["difference_m"] - pair["plus_minus_m"], pair["difference_m"] + pair["plus_minus_m"]
    assert (low, high) == pytest.approx(tuple(interval), abs=1e-12)
    assert pair["beyond_chance"] is bool(high < 0)
    assert pair["beyond_chance"] is (shift_m == 0.003)


def test_without_rivals_or_without_itself_there_is_no_verdict() -> None:
    assert verdict(found(adaptive_comp_flc=0.01, oracle=0.001), ["oracle"]) is None
    assert verdict(found(flc=0.01, smith=0.01), []) is None


def test_errors_of_zero_are_compared_too() -> None:
    result = verdict(found(flc=0.0, lqr=0.0, adaptive_comp_flc=0.0), [])
    assert result is not None
    for errors in result["errors"].values():
        assert errors["against"]["lqr"]["ratio"] is None
        assert errors["within"] is True
        assert errors["beats"] is False


def table(results: dict[str, Any], limits: list[str]) -> dict[str, Any]:
    """What `omni-mj compare` would write of one scenario."""
    entry = {
        "description": "one | two", "status": "done", "reason": None, "simulated_s": 1.0, "wall_s": 1.0,
        "results": results, "verdict": verdict(results, limits),
    }  # fmt: skip
    failed = entry | {"status": "failed", "reason": "robot 3 fell over", "results": {}, "verdict": None}
    return {
        "stopped": None, "repeat": "omni-mj compare", "plant": "mujoco", "seeds": list(range(SEEDS)),
        "controllers": list(results), "limits": limits, "scenarios": {"rect": entry, "circle": failed},
        "definitions": {}, "versions": {},
    }  # fmt: skip


def test_markdown_marks_the_best_competitor_the_limit_and_what_failed() -> None:
    results = found(flc=[0.01, 0.02, 0.03, 0.04], adaptive_comp_flc=0.015, oracle=0.001)
    text = compare_table.markdown(table(results, ["oracle"]))
    half = 100 * scipy.stats.t.ppf(0.975, 3) * scipy.stats.sem([0.01, 0.02, 0.03, 0.04])
    lines = text.splitlines()
    assert f"| rect | 2.50±{half:.2f} | **1.50±0.00** | 0.10±0.00 |" in lines
    assert "|  | flc | adaptive-comp-flc | oracle (limit) |" in lines
    assert "| circle | failed |  |  |" in lines
    assert "- circle: failed: robot 3 fell over" in lines
    assert "| rect | one \\| two | 1.0 | 1.0 |" in lines
    assert f"## Verdicts on {SUBJECT}" in lines
    assert "| rect | maximum | -40 ? | - | - | - | - | yes | - |" in lines


def test_the_terminal_shows_the_same_within_80_columns(capsys: pytest.CaptureFixture[str]) -> None:
    results = found(flc=0.473, comp_flc=0.02, adaptive_comp_flc=0.015, p=0.01, smith=0.012, lqr=0.013, oracle=0.001)
    compare_table.show(table(results, ["oracle"]))
    out = capsys.readouterr().out
    rows = [line for line in out.splitlines() if "±0" in line]
    assert [row.split()[-4] for row in rows] == [
        f"{100 * r['error_m']['position']['max']['mean']:.2f}±0.00" for r in results.values()
    ]
    assert max(map(len, rows)) <= 80
    assert "why not: rect: maximum error 1.50 cm, that of p 1.00 cm" in out
    assert "note: circle: failed: robot 3 fell over" in out
