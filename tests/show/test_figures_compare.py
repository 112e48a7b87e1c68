"""Figures over seeds and of comparisons show the numbers of the summary."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from drawn import TURN, drawn, made

from omni_mj.show import figures
from omni_mj.show.figures import comparison, seeds


def spread(*values: float | None) -> dict[str, Any]:
    """As in a summary; the half interval is a tenth of the mean."""
    whole = None not in values
    mean = float(np.mean(values)) if whole else None
    return {"seeds": list(values), "mean": mean, "plus_minus": mean / 10 if mean and len(values) > 1 else None}


def judged(errors: Sequence[float | None], settled: Sequence[float | None]) -> dict[str, Any]:
    scaled = {stat: spread(*errors) for stat in ("max", "mean")}
    return {"error_m": {"distance": scaled}, "error_rad": {"heading": scaled}, "excess_effort_m_s2": spread(*errors),
            "settle_s": spread(*settled)}  # fmt: skip


def test_boxes_hold_all_seeds_that_did_not_fail() -> None:
    """Seed j of controller i is off by i + 0.1 j cm: without the last of the last, medians are 0.1 and 1.05."""
    axes = drawn(lambda: seeds.seeds(made(failed={5: 100}).entry, heading=True)).axes
    found = []
    for panel in axes:
        lines = [line for line in panel.get_lines() if line.get_linewidth() == pytest.approx(1.6)]
        found.append([np.asarray(line.get_xdata())[0] for line in lines])
    x, y, plane, heading = np.array(found[:4])
    np.testing.assert_allclose(x, [0.1, 1.05], atol=1e-9)
    np.testing.assert_allclose(y, x, atol=1e-9)
    np.testing.assert_allclose(plane, np.sqrt(2) * x, atol=1e-9)
    np.testing.assert_allclose(heading, np.rad2deg(TURN) * x, atol=1e-9)
    assert [label.get_text() for label in axes[0].get_yticklabels()] == ["c0", "c1\n(1 failed)"]


def test_a_known_limit_is_a_line_through_the_boxes() -> None:
    """At 0.5 cm in each error of position; of heading none is known."""
    limit = {axis: {stat: {"median": 0.005} for stat in ("max", "mean")} for axis in ("x", "y", "distance")}
    axes = drawn(lambda: seeds.seeds(made().entry | {"limit": limit}, heading=True)).axes
    lines = [[line for line in panel.get_lines() if line.get_label() == "limit"] for panel in axes]
    assert [[line.get_xdata()[0] for line in panel] for panel in lines] == [*[[0.5]] * 3, [], *[[0.5]] * 3, []]


def test_a_comparison_has_a_dot_where_each_mean_is(tmp_path: Path) -> None:
    """Errors in cm and degrees, hollow for the informed; what not every seed has is named, right of all the others."""
    limit = {"distance": {stat: spread(0.004, 0.006) for stat in ("max", "mean")}}
    entries: dict[str, dict[str, Any]] = {
        "s1": {"seeds": [0, 1], "results": {"a": judged([0.01, 0.03], [0.5, 0.7]), "b": judged([0.1, 0.3], [1, 1])}},
        "s2": {"seeds": [0, 1], "results": {"b": judged([0.2, None], [None, None])}, "limit": limit},
        "s3": {"seeds": [], "results": {}},
    }
    entries = {name: {"plant": "mujoco", "robot": "tigers-v2016", **entry} for name, entry in entries.items()}
    document = {"scenarios": entries, "informed": ["a"]}
    figure = drawn(lambda: comparison.comparison(comparison.with_results(entries), document["informed"]))
    figure.draw_without_rendering()
    scales = (100, 100, np.rad2deg(1), 1)
    for axes, scale in zip(figure.axes, scales, strict=False):
        dots = {
            line.get_label(): np.asarray(line.get_xdata()) for line in axes.get_lines() if line.get_label()[0] != "_"
        }
        np.testing.assert_allclose(dots["a (informed)"], [0.02 * scale])
        np.testing.assert_allclose(dots["b"][0], 0.2 * scale)
        labels = {label.get_text(): x for label, x in zip(axes.get_xticklabels(), axes.get_xticks(), strict=True)}
        assert dots["b"][1] == labels["failed"] == max(labels.values())
        assert labels["failed"] > 0.22 * scale  # beyond the longest interval
    settling = figure.axes[4]
    assert [label.get_text() for label in settling.get_xticklabels()][-1] == "never"
    hollow = [line.get_markerfacecolor() for line in figure.axes[0].get_lines() if line.get_label() == "a (informed)"]
    assert hollow == ["white"]
    assert [label.get_text() for label in figure.axes[0].get_yticklabels()] == ["s1", "s2"]
    for axes in figure.axes[:2]:  # the limit spans the band of its scenario, and is in sight
        ((start, end),) = [line.get_segments()[0] for line in axes.collections if line.get_label() == "limit"]
        assert start[0] == end[0] == pytest.approx(0.5)
        assert start[0] > axes.get_xlim()[0]
        middle = dict(zip(("s1", "s2"), axes.get_yticks(), strict=True))
        assert middle["s1"] < start[1] < middle["s2"] < end[1]
    assert "mean of 2 seeds" in figure.get_suptitle()
    figures.save_comparison(document, tmp_path / "compare")
    assert {path.name for path in tmp_path.iterdir()} == {"compare.png", "compare.svg"}
    assert figures.comparison_svg(entries).startswith(b"<?xml")
