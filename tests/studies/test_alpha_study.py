"""alpha comes out of the physics: in the interval that real robots show, and with the physical trends."""

import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

import omni_control
import omni_mj as om
from omni_mj.studies import alpha


@pytest.fixture(scope="module")
def corners() -> alpha.Study:
    """The extremes of every condition."""
    ends = {"friction": (0.3, 0.8), "winding_c": (25.0, 120.0), "charge": (0.15, 1.0), "lint": (0.03, 0.15)}
    study = om.alpha(conditions=ends).study
    assert study is not None
    return study


@pytest.fixture(scope="module")
def usual() -> alpha.AlphaResult:
    """Some usual conditions."""
    return om.alpha(
        conditions={
            "friction": (0.5, 0.7, 0.9),
            "winding_c": (25.0, 120.0),
            "charge": (0.15, 0.5, 1.0),
            "lint": (0.065,),
        }
    )


def test_hotter_emptier_slipperier_and_more_lint_all_lower_alpha(corners: alpha.Study) -> None:
    for condition, sign in (("friction", 1), ("winding_c", -1), ("charge", 1), ("lint", -1)):
        low, high = corners.trend(condition)
        # A hundredth: what the weakest of them moves, and ten times what rounding and rollers do.
        assert sign * (high - low) > 0.01, condition


def test_alpha_is_lowest_while_accelerating(corners: alpha.Study) -> None:
    assert (corners.phase("accelerating").mean(-1) < corners.phase("cruising").mean(-1)).all()


def test_alpha_lies_where_the_paper_saw_it(usual: alpha.AlphaResult) -> None:
    """The paper reports [0.7, 1]; the bounds are wider than that by what the conditions chosen may shift."""
    assert usual.study is not None
    p5, p95 = np.percentile(usual.study.usual(), [5, 95])
    assert 0.65 <= p5 <= 0.85
    assert 0.95 <= p95 <= 1.03


def test_rows_hold_conditions_direction_and_alpha(usual: alpha.AlphaResult) -> None:
    """One line per robot, from which the trends follow; percentiles are in the summary and the table."""
    rows = usual.rows().to_pylist()
    assert usual.study is not None
    assert len(rows) == 3 * 2 * 3 * 3
    assert {name for name in rows[0] if "." in name} == {
        "carpet.friction",
        "motor.winding_c",
        "motor.housing_c",
        "battery.charge",
    }
    for value, mean in zip((0.5, 0.7, 0.9), usual.study.trend("friction"), strict=True):
        of = [
            (2 * r["alpha_accelerating"] + 3 * r["alpha_cruising"]) / 5 for r in rows if r["carpet.friction"] == value
        ]
        assert np.mean(of) == pytest.approx(mean, rel=1e-12)
    summary = usual.summary()
    assert summary["complete"]
    assert np.shape(summary["alpha"]["alpha"]["cruising"]) == (3, 2, 3, 1, 3)
    assert f"{summary['alpha']['usual']['p50']:.3f}" in usual.table()
    assert summary["scenarios"]["alpha"]["failed"] == []


def sources() -> Iterator[Path]:
    for package in (om, omni_control):
        yield from Path(next(iter(package.__path__))).rglob("*.py")


def test_only_the_kinematic_plant_scripts_alpha() -> None:
    """No part of the MuJoCo plant reads the settings of the paper's plant."""
    readers = {p.name for p in sources() if re.search(r"\.kinematic\b|alpha_low", p.read_text(encoding="utf-8"))}
    assert readers == {"settings.py", "plants.py", "kinematic.py"}  # the registry of plants imports plants.kinematic
