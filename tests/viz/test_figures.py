"""Figures show recorded values, and controllers can be distinguished."""

import numpy as np
import pytest
from benches.figures import (
    ALPHA,
    FRAMES,
    NAMES,
    SPEED,
    TURN,
    draw_comparison,
    draw_figures,
    line_styles,
    line_values,
    make_outcome,
)
from hypothesis import given
from hypothesis import strategies as st
from matplotlib.figure import Figure

from omni_control.controllers.registry import CONTROLLERS
from omni_mj.viz import figure_helpers

USER_CONTROLLERS = ("mine", "yours")


def test_only_figures_with_data_are_drawn() -> None:
    figures = draw_figures(make_outcome(["c0"], n_seeds=2, alpha_hat=1.0))
    assert set(figures) == set(NAMES) - {"alpha", "seeds"}


@pytest.mark.parametrize("frames", [1, 16])
def test_a_run_that_ended_at_once_can_be_drawn(frames: int) -> None:
    for figure in draw_figures(make_outcome(frames=frames)).values():
        figure.draw_without_rendering()


def test_curves_are_the_recorded_values() -> None:
    """Controller i has errors of i cm and i TURN rad; its command is the velocity / alpha."""
    figures = draw_figures(make_outcome(), "error", "command")
    for i in range(2):
        for axes, expected in zip(figures["error"].axes, (i, i, i * np.rad2deg(TURN)), strict=True):
            np.testing.assert_allclose(line_values(axes, f"c{i}")[0], expected, atol=1e-9)
        for axes, frame in zip(figures["command"].axes, (0, -1), strict=False):
            np.testing.assert_allclose(line_values(axes, f"c{i}")[0][frame], SPEED / ALPHA)


def test_alpha_is_the_achieved_fraction_and_estimates_have_a_two_sigma_band() -> None:
    """Robots that achieve 0.8 of their command have alpha 0.8 while they drive along that axis."""
    estimate = np.stack([np.full(3, 0.9), np.ones(3)])  # 1: no estimate
    sigma = {"alpha_sigma": np.full((2, 3), 0.05)}
    names = ["estimator", "other"]
    run = make_outcome(names, 1, controller_channels=sigma, alpha_hat=estimate)
    axes = draw_figures(run, "alpha")["alpha"].axes
    assert [panel.get_title(loc="left") for panel in axes] == ["estimator, x", "estimator, y"]
    for panel, driven in zip(
        axes, (slice(40, FRAMES // 2), slice(FRAMES // 2 + 40, FRAMES)), strict=True
    ):
        (ratio,) = (
            y
            for line in panel.get_lines()
            if "achieved" in str(line.get_label())
            for y in [line.get_ydata()]
        )
        known = np.asarray(ratio, float)
        np.testing.assert_allclose(known[driven], ALPHA, atol=1e-9)
        assert np.isnan(np.r_[known[: driven.start - 20], known[driven.stop + 1 :]]).all()
        (band,) = (part for part in panel.collections if "sigma" in str(part.get_label()))
        edges = band.get_paths()[0].vertices[:, 1]
        np.testing.assert_allclose([edges.min(), edges.max()], [0.8, 1.0])


def test_alpha_beyond_its_axis_is_said_and_its_legend_has_no_controllers_color() -> None:
    estimate = np.stack([np.full(3, 0.2), np.full(3, 1.9)])
    run = make_outcome(["low", "high"], 1, alpha_hat=estimate)
    figure = draw_figures(run, "alpha")["alpha"]
    titles = [panel.get_title(loc="left") for panel in figure.axes]
    assert titles == [
        f"{name}, {axis}; from {low} to {high}"
        for name, low, high in (("low", "0.20", "0.80"), ("high", "0.80", "1.90"))
        for axis in "xy"
    ]
    colors = {line.get_color() for panel in figure.axes for line in panel.get_lines()[1:2]}
    legend_colors = {handle.get_color() for handle in figure.legends[0].get_lines()}
    assert len(colors) == 2
    assert not colors & legend_colors


@pytest.mark.parametrize("controllers", [3, 5])
def test_a_failed_row_ends_early_and_does_not_set_the_limits(
    controllers: int,
) -> None:
    """The last one fails after 90 frames, 1 m from its reference; the others are within 3 cm."""
    names = [f"c{i}" for i in range(controllers)]
    log = make_outcome(names, 1).log
    assert log
    pose = log.channel("pose")
    pose[80:90, -1, 0] += 1.0
    run = make_outcome(names, 1, ends={controllers - 1: 90}, pose=pose)
    figures = draw_figures(run, "path", "command", "error")
    for name in ("command", "error"):
        lines = [line for axes in figures[name].axes for line in line_values(axes, names[-1])]
        assert {np.flatnonzero(~np.isnan(line))[-1] for line in lines} == {89}
    assert figures["error"].axes[0].get_ylim()[1] < 10
    assert f"{names[-1]} failed" in [
        text.get_text() for text in figures["path"].legends[0].get_texts()
    ]


@pytest.mark.parametrize("controllers", [2, 5])
def test_a_close_up_shows_the_largest_deviation_of_each_controller(controllers: int) -> None:
    """The path deviates by 1 mm, and by 5 cm half-way, which close-ups 13 cm wide show in cm."""
    x = np.linspace(0, 2, FRAMES)
    y = 0.001 + 0.05 * np.exp(-((x - 1) ** 2) / (2 * 0.02**2))
    ref = np.zeros((FRAMES, controllers, 3))
    ref[..., 0] = x[:, None]
    pose = ref.copy()
    pose[..., 1] = y[:, None]
    outcome = make_outcome([f"c{i}" for i in range(controllers)], 1, ref=ref, pose=pose)
    _, *close_ups = draw_figures(outcome, "path")["path"].axes
    assert len(close_ups) == controllers
    for axes in close_ups:
        assert np.ptp(axes.get_xlim()) == pytest.approx(2.5 * 5.1, rel=0.03)
        path = next(line for line in axes.get_lines() if str(line.get_label()).startswith("c"))
        assert np.max(path.get_ydata()) == pytest.approx(0, abs=0.1)
        assert float(axes.get_xlabel().split()[0]) == pytest.approx(5.1, rel=0.03)
        ring = axes.get_lines()[-1].get_xydata()
        np.testing.assert_allclose(ring, [[0, -5.1]], atol=0.15)


def test_a_close_up_shows_the_first_of_equal_deviations() -> None:
    """The path deviates by exactly 5 cm at 0.5 m and at 1.5 m from its start."""
    ref = np.zeros((FRAMES, 1, 3))
    ref[..., 0] = np.linspace(0, 2, FRAMES)[:, None]
    pose = ref.copy()
    peaks = [FRAMES // 4, FRAMES - 1 - FRAMES // 4]
    pose[peaks, :, 1] = 0.05
    _, close_up = draw_figures(make_outcome(["c"], 1, ref=ref, pose=pose), "path")["path"].axes
    path = next(line for line in close_up.get_lines() if line.get_label() == "c")
    assert path.get_xdata()[0] == pytest.approx(-100 * ref[peaks[0], 0, 0], abs=0.01)


@given(st.lists(st.sampled_from([*CONTROLLERS, *USER_CONTROLLERS]), unique=True, min_size=1))
def test_line_styles_are_distinct_without_color_and_fixed_for_built_in_controllers(
    controllers: list[str],
) -> None:
    lines = line_styles(controllers)
    assert (
        len({line["marker"] for line in lines})
        == len({line["color"] for line in lines})
        == len(lines)
    )
    assert len({str(line["linestyle"]) + line["marker"] for line in lines}) == len(lines)
    assert all(
        line_styles([name]) == [line]
        for name, line in zip(controllers, lines, strict=True)
        if name in CONTROLLERS
    )


def test_a_heat_map_holds_the_maximum_error_of_all_seeds() -> None:
    """In cm; "failed" where a seed has no value, and no line for a scenario without results.

    Scenarios with faults come last.
    """
    run = make_outcome(ends={5: 100}).entry
    good = make_outcome().entry
    entries = {"fault": good, "s1": good, "s2": run, "s3": run | {"results": {}}}
    figure = draw_comparison({name: e for name, e in entries.items() if e["results"]}, ["c1"])
    axes = figure.axes[0]
    cells = [text.get_text() for text in axes.texts]
    assert cells == ["0.14", "1.56", "0.14", "failed", "0.14", "1.56"]
    assert [label.get_text() for label in axes.get_yticklabels()] == ["s1", "s2", "fault"]


def test_a_figure_over_seeds_has_a_dot_at_each_mean() -> None:
    """In cm; no dot if a seed has no value."""
    figure = draw_figures(make_outcome(ends={5: 100}), "seeds")["seeds"]
    dots = {bar.get_label(): bar.lines[0].get_xdata()[0] for bar in figure.axes[0].containers}
    np.testing.assert_allclose([dots["c0"], dots["c1"]], [np.sqrt(2) * 0.1, np.nan])


def test_a_line_of_a_long_run_shows_its_extremes_and_gaps_with_few_points() -> None:
    n = 200_001
    values = np.sin(np.arange(n) / 1000)
    values[[70_001, n - 1]], values[123_456] = [2.0, 3.0], -4.0
    values[150_000:150_100] = np.nan
    axes = Figure().subplots()
    figure_helpers.plot_frames(axes, values)
    x, y = axes.lines[0].get_data()
    assert len(x) <= figure_helpers.MAX_POINTS + 2
    np.testing.assert_array_equal(values[np.rint(60 * np.asarray(x)).astype(int)], y)
    assert {2.0, 3.0, -4.0} <= set(np.asarray(y).tolist())
    assert np.isnan(y).any()
    assert (np.diff(x) > 0).all()
