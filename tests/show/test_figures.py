"""The figures show what was recorded, tellable apart, as small files that are the same every time."""

from collections.abc import Callable, Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import settings as tried
from hypothesis import strategies as st
from logs import failure, filled, rows
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from omni_control.registry import CONTROLLERS
from omni_mj.measure import metrics, summary
from omni_mj.measure.result import Outcome
from omni_mj.scenarios import scenario
from omni_mj.scenarios.settings import PERIOD_S, ControlSettings
from omni_mj.show import figures, style
from omni_mj.show.figures import canvas, comparison, controller, heat, paths, seeds, series
from omni_mj.show.figures.first import FirstRows
from omni_mj.show.wheels import names_of

FRAMES, SPEED, ALPHA = 240, 0.5, 0.8
TURN = 0.02  # rad, by which each controller is turned per cm that it is off


def made(
    controllers: int = 2,
    n_seeds: int = 3,
    frames: int = FRAMES,
    heat: bool = True,
    failed: dict[int, int] | None = None,
    estimate: float = 0.9,
) -> Outcome:
    """Robots that drive x, then turn a corner into y; the i-th controller is off by i cm and all achieve 0.8 of it.

    `failed` are rows that stop after so many frames.
    """
    table = rows([f"c{i}" for i in range(controllers)], range(n_seeds))
    off = 0.01 * np.repeat(np.arange(controllers), n_seeds) + 0.001 * np.tile(np.arange(n_seeds), controllers)
    velocity = np.where(np.arange(frames)[:, None] < FRAMES / 2, (SPEED, 0.0), (0.0, SPEED))
    ref = np.zeros((frames, len(table), 3))
    ref[1:, :, :2] = (np.cumsum(velocity, axis=0)[:-1] * PERIOD_S)[:, None]
    pose = ref + np.stack([off, off, 100 * TURN * off], axis=-1)
    command = np.zeros((frames, len(table), 3))
    command[..., :2] = velocity[:, None] / ALPHA
    warm = (25 + 0.1 * np.arange(frames) if heat else np.full(frames, np.nan))[:, None, None]
    ends = [(failed or {}).get(row, frames) for row in range(len(table))]
    log = filled(
        table, frames, ends, ref=ref, pose=pose, command=command, applied=command, alpha_hat=estimate, winding=warm,
        housing=warm,
    )  # fmt: skip
    failures = [failure(log, row) for row in failed or {}]
    chosen = scenario.load("rect", (), {"plant": "kinematic"})
    measured = metrics.row_metrics(log, failures)
    entry = summary.entry(chosen, log, failures, measured, 0.0, None)
    return Outcome(chosen, entry, table, failures, measured, log)


def first(outcome: Outcome) -> FirstRows:
    assert outcome.log
    return FirstRows(outcome.log, outcome.failures)


def drawings(outcome: Outcome) -> dict[str, Callable[[], Figure]]:
    return figures.drawings(first(outcome), outcome.entry, ControlSettings())


def drawn(draw: Callable[[], Figure]) -> Figure:
    with figures.matplotlib_style.context(style.SHEET):
        return draw()


def curves(axes: Axes, label: str) -> list[np.ndarray]:
    return [np.asarray(line.get_ydata()) for line in axes.get_lines() if line.get_label() == label]


def test_each_figure_is_a_png_and_a_small_svg_the_same_every_time(runs: list[Path], tmp_path: Path) -> None:
    drawn_by_the_run = list((runs[0] / "figures").iterdir())
    names = {f"{name}.{kind}" for name in figures.NAMES if name != "temperatures" for kind in ("png", "svg")}
    assert {path.name for path in drawn_by_the_run} == names
    assert max(path.stat().st_size for path in drawn_by_the_run) < 1_000_000
    for stem in ("a", "b"):
        with figures.matplotlib_style.context(style.SHEET):
            canvas.save(series.error(first(made(frames=60))), tmp_path / stem)
    for kind in ("png", "svg"):
        assert (tmp_path / f"a.{kind}").read_bytes() == (tmp_path / f"b.{kind}").read_bytes()


def test_what_a_run_has_no_data_for_is_not_drawn() -> None:
    names = list(drawings(made(1, n_seeds=2, heat=False)))
    assert names == [name for name in figures.NAMES if name not in ("temperatures", "seeds")]


@pytest.mark.parametrize("frames", [1, 16])
def test_a_run_that_ended_at_once_can_be_drawn(frames: int) -> None:
    for name, draw in drawings(made(2, 3, frames)).items():
        if name not in figures.OF_THE_CONTROLLER:
            drawn(draw).draw_without_rendering()


def test_the_curves_are_the_recorded_values() -> None:
    """The i-th controller's error is i cm and i times 0.02 rad by construction, its command the velocity over alpha."""
    errors, outputs = drawn(lambda: series.error(first(made()))), drawn(lambda: series.output(first(made())))
    for i in range(2):
        for axes in errors.axes[:2]:
            np.testing.assert_allclose(curves(axes, f"c{i}")[0], i, atol=1e-9)
        np.testing.assert_allclose(curves(errors.axes[2], f"c{i}")[0], i * np.rad2deg(TURN), atol=1e-9)
        np.testing.assert_allclose(curves(outputs.axes[0], f"c{i}")[0][0], SPEED / ALPHA)
        np.testing.assert_allclose(curves(outputs.axes[1], f"c{i}")[0][-1], SPEED / ALPHA)


def test_alpha_is_what_the_robots_achieved() -> None:
    """Robots that achieve 0.8 of their command have alpha 0.8, in every window that lies within one side.

    It is shown from where they have been driven for a while; the second side is driven in y, and nothing is shown of x.
    """
    values = curves(drawn(lambda: series.alpha(first(made()))).axes[0], series.RATIO)[0]
    begin, corner = metrics.ALPHA_WINDOW_FRAMES + metrics.ALPHA_START_FRAMES, FRAMES // 2
    assert np.isnan(values[:begin]).all()
    np.testing.assert_allclose(values[begin : corner + 1], ALPHA, atol=1e-9)
    assert np.isnan(values[corner + 1 :]).all()


def test_an_estimate_of_alpha_stands_in_a_band_of_two_deviations() -> None:
    """Of a controller that estimates nothing, or of a run of such ones only, there are no axes."""
    table = rows(["says", "silent"], [0])
    estimate = np.stack([np.full(3, 0.9), np.ones(3)])
    log = filled(table, FRAMES, own={"alpha_sigma": np.full((2, 3), 0.05)}, alpha_hat=estimate)
    axes = drawn(lambda: series.alpha(FirstRows(log))).axes
    assert [each.get_title(loc="left") for each in axes] == ["says, $x$", "says, $y$"]
    (band,) = [each for each in axes[0].collections if each.get_label().startswith("_")]
    edges = band.get_paths()[0].vertices[:, 1]
    np.testing.assert_allclose([edges.min(), edges.max()], [0.8, 1.0])
    assert "alpha" not in drawings(made(1, 1, estimate=1.0))


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


def _of_the_second(name: str, axes: Axes, line: Line2D) -> bool:
    """Whether a curve is that of the controller c1."""
    if name in ("temperatures", "alpha"):  # where each controller has its own axes
        return axes.get_title(loc="left").startswith("c1")
    return bool(line.get_color() == style.colour(style.slots(["c0", "c1"])[1]))


@pytest.mark.parametrize("controllers", [2, 5])
def test_a_row_that_failed_is_drawn_up_to_there_and_says_so(
    controllers: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    outcome = made(controllers, 1, failed={1: 90})
    for name in figures.OVER_TIME:
        figure = drawn(drawings(outcome)[name])
        lines = [line for axes in figure.axes for line in axes.get_lines() if _of_the_second(name, axes, line)]
        curves = [np.asarray(line.get_ydata(), float) for line in lines if len(line.get_ydata()) > 2]
        ends = {np.flatnonzero(~np.isnan(curve))[-1] for curve in curves if not np.isnan(curve).all()}
        assert ends == {89}, name
    titles: list[str] = []
    monkeypatch.setattr(canvas, "save", lambda figure, stem, svg: titles.append(figure.get_suptitle()))
    figures.save_all(outcome, tmp_path)
    said = [title for title in titles if "c1 failed at 1.50 s: toppled over" in title]
    assert len(said) == len(figures.OVER_TIME)


def test_a_row_that_failed_leaves_room_for_the_others() -> None:
    """It is off by 1 m when it is stopped; the others are off by up to 1 cm."""
    outcome = made(3, 1, failed={2: 90})
    assert outcome.log
    outcome.log.channel("pose")[80:90, 2, 0] += 1.0
    assert drawn(lambda: series.error(first(outcome))).axes[0].get_ylim()[1] < 2.0


@pytest.mark.parametrize("count", [3, 6])
def test_every_wheel_of_any_number_is_drawn(count: int, monkeypatch: pytest.MonkeyPatch) -> None:
    azimuths = 2 * np.pi * (np.arange(count) + 0.5) / count
    monkeypatch.setattr(heat, "kinematics", lambda wheels: SimpleNamespace(azimuths=azimuths))
    log = type(made().log)(rows(["c0"]), count)
    for _ in range(5):
        log.write(np.array([True]), {}, winding=25.0 + np.arange(count)[None], housing=np.full((1, count), 25.0))
    axes = drawn(lambda: heat.temperatures(FirstRows(log))).axes[0]
    ends = [line.get_ydata()[-1] for line in axes.get_lines()]
    np.testing.assert_allclose(ends, 25.0 + np.arange(count))
    assert len({line.get_label() for line in axes.get_lines()}) == count


def test_wheels_are_called_by_where_they_are() -> None:
    tigers = names_of(np.deg2rad([60, 135, 225, 300]))
    assert tigers == ("front left", "rear left", "rear right", "front right")
    assert names_of(np.deg2rad([60, 180, 300])) == ("front left", "rear", "front right")
    assert names_of(np.deg2rad([30, 60])) == ("front left (30°)", "front left (60°)")


def spread(*values: float | None) -> dict[str, Any]:
    """As in a summary; the half interval is a tenth of the mean."""
    whole = None not in values
    mean = float(np.mean(values)) if whole else None
    return {"seeds": list(values), "mean": mean, "plus_minus": mean / 10 if mean and len(values) > 1 else None}


def judged(errors: Sequence[float | None], settled: Sequence[float | None]) -> dict[str, Any]:
    scaled = {stat: spread(*errors) for stat in ("max", "mean")}
    return {"error_m": {"distance": scaled}, "error_rad": {"heading": scaled}, "excess_effort_m_s2": spread(*errors),
            "settle_s": spread(*settled)}  # fmt: skip


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


@pytest.mark.parametrize("controllers", [2, 5])
def test_a_path_is_enlarged_where_controllers_stray_farthest(controllers: int) -> None:
    """All keep 1 mm aside of 2 m straight ahead, but for 5 cm half-way; a square there shows it, at least three times
    as large as the overview does."""
    table, along = rows([f"c{i}" for i in range(controllers)], [0]), np.linspace(0, 2, FRAMES)
    aside = 0.001 + 0.05 * np.exp(-((along - 1) ** 2) / (2 * 0.02**2))
    ref = np.zeros((FRAMES, controllers, 3))
    ref[..., 0] = along[:, None]
    log = filled(table, FRAMES, ref=ref, pose=ref + np.stack([0 * aside, aside, 0 * aside], axis=-1)[:, None])
    figure = drawn(lambda: paths.path(FirstRows(log)))
    figure.draw_without_rendering()
    overview = figure.axes[0]
    inside = [a for a in figure.axes if a.get_title(loc="left") and a.get_xlim()[0] < 1 < a.get_xlim()[1]]
    assert inside
    for axes in inside:
        scales = [each.get_window_extent().width / np.ptp(each.get_xlim()) for each in (axes, overview)]
        assert scales[0] > 3 * scales[1]
        assert axes.get_ylim()[1] > 0.051


def test_each_of_many_controllers_has_axes_of_its_own() -> None:
    for draw in (series.error, series.output, series.alpha):
        titles = [axes.get_title(loc="left") for axes in drawn(lambda draw=draw: draw(first(made(8, 1)))).axes]
        for i in range(8):
            assert sum(title.startswith(f"c{i}") for title in titles) == (2 if draw == series.alpha else 1)


def test_controllers_are_tellable_without_colour() -> None:
    lines = [style.line(slot) for slot in style.slots([*CONTROLLERS, "mine", "yours", "theirs"])]
    assert len({str(line["linestyle"]) + line["marker"] for line in lines}) == len(lines)
    assert len({line["marker"] for line in lines}) == len({line["color"] for line in lines}) == len(lines)
    assert len({str(line["linestyle"]) for line in lines[: canvas.TOGETHER]}) == canvas.TOGETHER


@given(st.lists(st.sampled_from([*CONTROLLERS, "mine", "yours", "theirs"]), unique=True))
def test_a_controller_that_ships_looks_the_same_in_whatever_company(controllers: list[str]) -> None:
    slots = dict(zip(controllers, style.slots(controllers), strict=True))
    assert len(set(slots.values())) == len(controllers)
    assert all(slots[name] == style.slots([name])[0] for name in controllers if name in CONTROLLERS)


def test_memberships_are_triangles_that_cross_at_half_height() -> None:
    figure = drawn(lambda: controller.memberships(ControlSettings()))
    for axes, reach in zip(figure.axes, (10.0, 1.0), strict=True):
        x = np.linspace(-1, 1, 81)
        for peak, line in zip(np.linspace(-1, 1, 5), axes.get_lines(), strict=True):
            degree = np.interp(reach * x, *line.get_data())
            np.testing.assert_allclose(degree, np.maximum(0, 1 - 2 * np.abs(x - peak)), atol=1e-9)


def test_sections_of_the_surface_are_odd_and_meet_the_peaks() -> None:
    """At a peak of an input set only one rule fires fully: half of the error's range gives half of the speed's."""
    sections = drawn(lambda: controller.surface(ControlSettings())).axes[1]
    x, v = (np.asarray(data) for data in sections.get_lines()[0].get_data())
    np.testing.assert_allclose(v, -v[::-1], atol=1e-9)
    np.testing.assert_allclose(np.interp([-5, 0, 5], x, v), [-0.5, 0, 0.5], atol=1e-9)


@tried(deadline=None, derandomize=True, max_examples=30)
@given(st.integers(0, 2**32 - 1), st.integers(1, 5 * canvas.BINS), st.floats(0, 1))
def test_thinning_keeps_the_extremes_and_invents_nothing(seed: int, length: int, unknown: float) -> None:
    random = np.random.default_rng(seed)
    values = np.where(random.random(length) < unknown, np.nan, random.normal(size=length))
    frames, kept = canvas.thin(values)
    np.testing.assert_array_equal(kept, values[frames])
    assert (np.diff(frames) > 0).all()
    assert len(frames) <= max(2 * canvas.BINS, 1)
    if not np.isnan(values).all():
        assert (np.nanmin(kept), np.nanmax(kept)) == (np.nanmin(values), np.nanmax(values))
