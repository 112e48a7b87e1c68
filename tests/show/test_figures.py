"""The figures show what was recorded, tellable apart, as small files that are the same every time."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import settings as tried
from hypothesis import strategies as st
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from omni_mj.measure.paper import TABLES
from omni_mj.scenarios.settings import PERIOD_S, ControlSettings, Settings
from omni_mj.show import figures, style
from omni_mj.show.figures import canvas, controller, paths, seeds, series
from omni_mj.simulate.log import CHANNELS, Trajectory

FRAMES, SPEED, ALPHA = 240, 0.5, 0.8


def made(controllers: int = 2, n_seeds: int = 3, frames: int = FRAMES, heat: bool = True) -> Trajectory:
    """Robots that drive x, then turn a corner into y; the i-th controller is off by i cm and all achieve 0.8 of it."""
    names = tuple(f"c{i}" for i in range(controllers))
    trajectory = Trajectory(names, list(range(n_seeds)), frames)
    n = controllers * n_seeds
    off = 0.01 * np.repeat(np.arange(controllers), n_seeds) + 0.001 * np.tile(np.arange(n_seeds), controllers)
    velocity = np.where(np.arange(frames)[:, None] < frames / 2, (SPEED, 0.0), (0.0, SPEED))
    ref = np.concatenate([np.zeros((1, 2)), np.cumsum(velocity, axis=0)[:-1]]) * PERIOD_S
    for k in range(frames):
        channels = {name: np.zeros((n, len(columns))) for name, columns in CHANNELS.items()}
        channels["ref"][:, :2] = ref[k]
        channels["pose"][:, :2] = ref[k] + off[:, None]
        channels["command"][:, :2] = channels["applied"][:, :2] = velocity[k] / ALPHA
        for name in ("winding", "housing"):
            channels[name][:] = 25 + 0.1 * k if heat else np.nan
        trajectory.write(k, **channels)
    return trajectory


def drawn(draw: Callable[[], Figure]) -> Figure:
    with figures.matplotlib_style.context(style.SHEET):
        return draw()


def curves(axes: Axes, label: str) -> list[np.ndarray]:
    return [np.asarray(line.get_ydata()) for line in axes.get_lines() if line.get_label() == label]


def test_each_figure_is_a_png_and_a_small_svg_the_same_every_time(tmp_path: Path) -> None:
    for folder in ("a", "b"):
        figures.save_all(made(), "a run", tmp_path / folder, paper=TABLES[3])
    names = {f"{name}.{kind}" for name in figures.NAMES for kind in ("png", "svg")}
    assert {path.name for path in (tmp_path / "a").iterdir()} == names
    for name in names:
        data = (tmp_path / "a" / name).read_bytes()
        assert data == (tmp_path / "b" / name).read_bytes(), name
        assert len(data) < 1_000_000


def test_what_a_run_has_no_data_for_is_not_drawn() -> None:
    names = list(figures.drawings(made(1, n_seeds=2, heat=False), Settings(), None))
    assert names == [name for name in figures.NAMES if name not in ("temperatures", "seeds")]


@pytest.mark.parametrize("frames", [1, 2, 15, 16])
def test_a_run_that_ended_at_once_can_be_drawn(frames: int) -> None:
    for name, draw in figures.drawings(made(2, 3, frames), Settings(), None).items():
        if name not in figures.OF_THE_CONTROLLER:
            drawn(draw).draw_without_rendering()


def test_the_curves_are_the_recorded_values() -> None:
    """The i-th controller's error is i cm by construction, its command the velocity over alpha."""
    errors, outputs = drawn(lambda: series.error(made())), drawn(lambda: series.output(made()))
    for i in range(2):
        for axes in errors.axes[:2]:
            np.testing.assert_allclose(curves(axes, f"c{i}")[0], i, atol=1e-9)
        np.testing.assert_allclose(curves(outputs.axes[0], f"c{i}")[0][0], SPEED / ALPHA)
        np.testing.assert_allclose(curves(outputs.axes[1], f"c{i}")[0][-1], SPEED / ALPHA)


def test_alpha_is_what_the_robots_achieved() -> None:
    """Robots that achieve 0.8 of their command have alpha 0.8, in every window that lies within one side."""
    values = curves(drawn(lambda: series.alpha(made())).axes[0], "alpha over 15 frames")[0]
    assert np.isnan(values[:15]).all()
    np.testing.assert_allclose(values[15 : FRAMES // 2 + 1], ALPHA, atol=1e-9)


def test_boxes_hold_all_seeds() -> None:
    """Seed j of controller i is off by i + 0.1 j cm: the medians are 0.1 and 1.1 cm."""
    axes = drawn(lambda: seeds.seeds(made(), None)).axes[0]
    medians = [line.get_xdata() for line in axes.get_lines() if line.get_linewidth() == pytest.approx(1.6)]
    np.testing.assert_allclose(np.ravel(medians), [0.1, 0.1, 1.1, 1.1], atol=1e-9)


def test_a_path_is_enlarged_at_its_corner() -> None:
    """The reference turns at (1, 0) m, and nowhere else."""
    figure = drawn(lambda: paths.path(made()))
    corner = np.array([SPEED * FRAMES / 2 * PERIOD_S, 0.0])
    details = [axes for axes in figure.axes if "wide" in axes.get_title(loc="left")]
    inside = [a.get_xlim()[0] < corner[0] < a.get_xlim()[1] and a.get_ylim()[0] < 0 < a.get_ylim()[1] for a in details]
    assert any(inside)
    assert all(np.ptp(axes.get_xlim()) < 0.5 for axes in details)


def test_each_of_many_controllers_has_axes_of_its_own() -> None:
    for draw in (series.error, series.output, series.alpha):
        titles = [axes.get_title(loc="left") for axes in drawn(lambda draw=draw: draw(made(8, 1))).axes]
        for i in range(8):
            assert sum(title.startswith(f"c{i}") for title in titles) == 2


def test_controllers_are_tellable_without_colour() -> None:
    lines = [style.line(i) for i in range(8)]
    assert len({str(line["linestyle"]) + line["marker"] for line in lines}) == 8
    assert len({line["marker"] for line in lines}) == 8
    assert len({str(line["linestyle"]) for line in lines[: canvas.TOGETHER]}) == canvas.TOGETHER


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
