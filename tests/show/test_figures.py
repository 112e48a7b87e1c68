"""The figures show what was recorded, tellable apart, as small files that are the same every time."""

import itertools
from io import BytesIO
from pathlib import Path

import numpy as np
import pytest
from drawn import ALPHA, FRAMES, SPEED, TURN, curves, drawings, drawn, first, made
from logs import filled, rows
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.image import imread
from matplotlib.lines import Line2D

from omni_mj.measure import metrics
from omni_mj.show import figures, style
from omni_mj.show.figures import canvas, lettering, paths, series
from omni_mj.show.figures.first import FirstRows


def test_each_figure_is_a_png_and_a_small_svg_the_same_every_time(runs: list[Path], tmp_path: Path) -> None:
    drawn_by_the_run = list((runs[0] / "figures").iterdir())
    names = {f"{name}.{kind}" for name in style.FIGURES if name != "temperatures" for kind in ("png", "svg")}
    assert {path.name for path in drawn_by_the_run} == names
    assert max(path.stat().st_size for path in drawn_by_the_run) < 1_000_000
    for stem in ("a", "b"):
        with figures.matplotlib_style.context(style.SHEET):
            canvas.save(series.error(first(made(frames=60))), tmp_path / stem)
    for kind in ("png", "svg"):
        assert (tmp_path / f"a.{kind}").read_bytes() == (tmp_path / f"b.{kind}").read_bytes()


def test_a_picture_is_what_is_drawn_and_keeps_to_its_edges(runs: list[Path]) -> None:
    """Each has ink, and none at the edge, where what is drawn would be cut off."""
    for path in (runs[0] / "figures").glob("*.png"):
        ink = imread(path)[..., :3].min(axis=-1) < 0.9
        assert ink.mean() > 0.01, path
        assert not any(edge.any() for edge in (ink[0], ink[-1], ink[:, 0], ink[:, -1])), path


def test_text_lies_where_matplotlib_would_draw_it() -> None:
    """Of level and of upright lines in several sizes, to a pixel: their ink, and the middle of it."""
    for angle, size, ha, va in itertools.product((0, 90), (8, 10), ("left", "right", "center"), ("top", "baseline")):
        figure = Figure(figsize=(3, 3), dpi=150)
        figure.text(0.5, 0.5, "Agq |x|", rotation=angle, fontsize=size, ha=ha, va=va)
        pictures = [np.asarray(lettering.picture(figure))]
        figure.savefig(file := BytesIO(), format="png")
        pictures.append(255 * imread(BytesIO(file.getvalue())))
        ours, theirs = (255.0 - each[..., 0] for each in pictures)
        assert ours.sum() == pytest.approx(theirs.sum(), rel=0.02)
        for axis in range(2):
            middles = [each.sum(1 - axis) @ np.arange(len(each)) / each.sum() for each in (ours, theirs)]
            assert middles[0] == pytest.approx(middles[1], abs=1)


def test_what_a_run_has_no_data_for_is_not_drawn() -> None:
    names = list(drawings(made(1, n_seeds=2, heat=False)))
    assert names == [name for name in style.FIGURES if name not in ("temperatures", "seeds")]


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
    assert [each.get_title(loc="left") for each in axes] == ["says, x", "says, y"]
    (band,) = [each for each in axes[0].collections if each.get_label().startswith("_")]
    edges = band.get_paths()[0].vertices[:, 1]
    np.testing.assert_allclose([edges.min(), edges.max()], [0.8, 1.0])
    assert "alpha" not in drawings(made(1, 1, estimate=1.0))


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
