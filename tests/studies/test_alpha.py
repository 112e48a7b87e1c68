"""Gain and lag come out of the physics: by the laws of creep and drag, and with shares that add up."""

from collections.abc import Iterator

import numpy as np
import pytest
from benches.studies import RESPONSE_FIELDS, AlphaResult, AlphaStudy, StoppedError, conditions
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

import omni_mj as om

CHANGED = {
    "acceleration_m_s2": (3.0,),
    "rolling_resistance": (0.2,),
    "winding_c": (120.0,),
    "charge": (1.0,),
}
FORWARD, SIDEWAYS, _ = range(3)


def fast() -> om.Scenario:
    """On what costs least."""
    return om.load_scenario("rect", plant="planar")


@pytest.fixture(scope="module")
def result() -> Iterator[AlphaResult]:
    """More of some conditions than the robot has as it is; causes are creep, drag and battery.

    A cause less halves the robots; what heat does is among the conditions.
    """
    with pytest.MonkeyPatch.context() as patched:
        patched.delitem(conditions.CAUSES, "heat")
        yield om.measure_alpha(fast(), CHANGED)


@pytest.fixture(scope="module")
def study(result: AlphaResult) -> AlphaStudy:
    assert result.study is not None
    return result.study


def softness(settings: om.Scenario) -> np.ndarray:
    """T forward and sideways, s^2/m: W / (g C sum of d^2) with the wheels' direction cosines d; see `model.creep`."""
    wheels, drivetrain = settings.settings.wheels, settings.settings.drivetrain
    azimuths = np.radians(wheels.azimuths_deg)
    squares = np.array([(np.sin(azimuths) ** 2).sum(), (np.cos(azimuths) ** 2).sum()])
    of_both: np.ndarray = len(azimuths) / (9.81 * drivetrain.creep_stiffness * squares)
    return of_both


def test_creep_alone_takes_what_its_law_says(study: AlphaStudy) -> None:
    """Its lag is T g^2 U / 2, beside the wheel loops'; the slope of the ramp that of T a s^2 + s / g = 1."""
    found, speed = conditions.PROFILE, conditions.PROFILE.speed_m_s
    both, curve = slice(0, 2), softness(om.load_scenario("rect"))
    alone = study.by_causes.at((1, 0, 0))  # creep without drag and battery
    creep = {
        name: (getattr(alone, name) - getattr(study.wheel_loop, name))[both]
        for name in RESPONSE_FIELDS
    }
    gain = study.wheel_loop.steady_gain[both] + creep["steady_gain"]
    # What accelerates the robot leans on some wheels more than others, and the law has their mean.
    np.testing.assert_allclose(creep["lag_s"], curve * gain**2 * speed / 2, rtol=0.1)
    curve = curve * found.acceleration_m_s2
    slope = (np.sqrt(1 + 4 * curve) - 1) / (2 * curve)
    np.testing.assert_allclose(
        study.wheel_loop.acceleration_gain[both] + creep["acceleration_gain"], slope, atol=0.05
    )


def test_lag_does_not_depend_on_acceleration_but_the_gain_of_speeding_up_does(
    study: AlphaStudy,
) -> None:
    slow, fast = study.baseline, study.by_condition["acceleration_m_s2"].at(0)
    np.testing.assert_allclose(
        fast.lag_s[:2], slow.lag_s[:2], rtol=0.05
    )  # of 60 to 100 ms: rollers ripple
    np.testing.assert_allclose(fast.steady_gain, slow.steady_gain, atol=0.005)
    assert (fast.acceleration_gain < slow.acceleration_gain - 0.02).all()
    assert (fast.acceleration_gain < fast.steady_gain - 0.02).all()


def test_robots_creep_more_sideways(study: AlphaStudy) -> None:
    """Where fewer wheels pull, see `softness`."""
    for each in (study.baseline, study.worn):
        assert each.steady_gain[SIDEWAYS] < each.steady_gain[FORWARD]
        assert each.lag_s[SIDEWAYS] > each.lag_s[FORWARD]


def test_more_pile_less_charge_and_heat_cost_what_they_can(study: AlphaStudy) -> None:
    """Pile and charge the gain; heat, which takes stiffness from the wheel loops, lag."""
    for name, sign in (("rolling_resistance", -1), ("charge", 1)):
        assert (
            sign * (study.by_condition[name].steady_gain[0] - study.baseline.steady_gain) > 0.01
        ).all(), name
    assert (study.by_condition["winding_c"].lag_s[0] > study.baseline.lag_s + 0.001).all()


def test_shares_add_up_to_what_all_causes_do(study: AlphaStudy) -> None:
    for name in RESPONSE_FIELDS:
        added = sum(study.contributions(name).values())
        np.testing.assert_allclose(
            added, getattr(study.worn, name) - getattr(study.wheel_loop, name), atol=1e-12
        )


@given(st.data())
def test_shares_are_fair(data: st.DataObject) -> None:
    """They add up; what adds nothing has none; two that only act together share alike."""
    causes = len(conditions.CAUSES)
    values = data.draw(arrays.arrays(float, (2,) * causes, elements=st.floats(-1, 1)))
    idle = data.draw(st.sampled_from(range(causes)))
    found = conditions.shapley_values(values).values()
    assert sum(found) == pytest.approx(values.flat[-1] - values.flat[0], abs=1e-12)
    first = np.take(values, [0], idle)
    of_idle = list(conditions.shapley_values(np.concatenate([first, first], axis=idle)).values())[
        idle
    ]
    assert of_idle == pytest.approx(0, abs=1e-12)
    together = np.zeros_like(values)
    together[1, 1] = 0.5
    both = list(conditions.shapley_values(together).values())
    assert both == pytest.approx([0.25, 0.25, *[0] * (causes - 2)], abs=1e-12)


def test_rows_summary_and_table_say_the_same(result: AlphaResult, study: AlphaStudy) -> None:
    """One line per robot: settings, direction, profile and response."""
    rows = [row for row in result.rows().to_pylist() if row["direction"] is not None]
    assert len(rows) == 3 * (1 + len(CHANGED) + 2 ** len(conditions.CAUSES))
    full = [row for row in rows if row["battery.charge"] == 1.0]
    assert [row["lag_s"] for row in full] == pytest.approx(study.by_condition["charge"].lag_s[0])
    summary = result.summary()
    assert summary["complete"]
    told = summary["alpha"]["by_condition"]["charge"]["steady_gain"][0]
    assert told == pytest.approx(study.by_condition["charge"].steady_gain[0], abs=1e-6)
    assert f"{study.baseline.steady_gain[0]:.3f}" in result.table()


def test_what_cannot_be_studied_is_said() -> None:
    with pytest.raises(om.OmniError, match="unknown condition 'lint'"):
        om.measure_alpha(condition_values={"lint": (0.1,)})
    with pytest.raises(om.OmniError, match="the plant 'kinematic' has none"):
        om.measure_alpha(om.load_scenario("rect", plant="kinematic"), {})


def test_a_study_that_is_stopped_has_found_nothing() -> None:
    def stop(frame: int) -> None:
        if frame == 3:
            raise StoppedError("interrupted")

    stopped = om.measure_alpha(fast(), {}, start_progress=lambda title, frames: stop)
    assert (stopped.study, stopped.stopped, stopped.table()) == (None, "interrupted", "")
    assert stopped.summary()["alpha"] is None
