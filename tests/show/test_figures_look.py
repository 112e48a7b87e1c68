"""Curves, wheels and controllers can be told apart, and the fuzzy controller is drawn as it is."""

from types import SimpleNamespace

import numpy as np
import pytest
from drawn import drawn, made
from hypothesis import given
from hypothesis import settings as tried
from hypothesis import strategies as st
from logs import rows

from omni_control.registry import CONTROLLERS
from omni_mj.scenarios.settings import ControlSettings
from omni_mj.show import style
from omni_mj.show.figures import canvas, controller, heat, why
from omni_mj.show.figures.first import FirstRows
from omni_mj.show.wheels import names_of


def test_wheels_are_called_by_where_they_are() -> None:
    tigers = names_of(np.deg2rad([60, 135, 225, 300]))
    assert tigers == ("front left", "rear left", "rear right", "front right")
    assert names_of(np.deg2rad([60, 180, 300])) == ("front left", "rear", "front right")
    assert names_of(np.deg2rad([30, 60])) == ("front left (30°)", "front left (60°)")


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


def test_frames_in_which_a_cause_is_there_are_drawn_as_spans() -> None:
    frames = np.array([1, 1, 0, 1, 0, 0, 1], bool)
    assert why.spans(frames) == [(0, 2), (3, 1), (6, 1)]
    assert why.spans(frames[:0]) == []


def test_one_that_strays_several_times_as_far_leaves_room_for_the_others() -> None:
    """Nine stray by 1 to 1.8 and one by 100: shown is half as much again as the others need; without it, all."""
    values = np.array([[*(1 + 0.1 * np.arange(9)), 100.0]])
    assert canvas.reach(values, []) == (0.0, pytest.approx(2.7))
    assert canvas.reach(values[:, :9], []) == (0.0, pytest.approx(1.8))
