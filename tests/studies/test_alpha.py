"""Test that gain and lag follow from creep and drag, and that contributions add up."""

from collections.abc import Iterator

import numpy as np
import pytest
from benches.creep import traction_per_load
from benches.studies import AlphaResult, AlphaStudy, RampResponse, StoppedError, conditions
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays
from scipy.optimize import brentq

import omni_mj as om

CHANGED = {
    "acceleration_m_s2": (3.0,),
    "carpet.rolling_resistance": (0.1,),
    "motor.winding_c": (120.0,),
    "battery.charge": (1.0,),
}
FORWARD, SIDEWAYS, _ = range(3)


def fast_scenario() -> om.Scenario:
    """Return the scenario on the fast plant."""
    return om.load_scenario("rect", plant="planar")


@pytest.fixture(scope="module")
def result() -> Iterator[AlphaResult]:
    """Vary four conditions; causes are creep, drag and battery.

    Leaving out heat, which is one of the conditions, halves the number of robots.
    """
    with pytest.MonkeyPatch.context() as patched:
        patched.delitem(conditions.CAUSES, "heat")
        yield om.measure_alpha(fast_scenario(), CHANGED)


@pytest.fixture(scope="module")
def study(result: AlphaResult) -> AlphaStudy:
    assert result.study is not None
    return result.study


def slip_times(scenario: om.Scenario, acceleration: float) -> np.ndarray:
    """Return slip over speed and acceleration, forward and sideways, s^2/m.

    The tractions by Pacejka's cubic add up to the mass times the acceleration. Wheels carry equal
    loads and share one slip twist without rotation.
    """
    settings = scenario.settings
    azimuths = np.radians(settings.wheels.azimuths_deg)
    rims = np.array([-np.sin(azimuths), np.cos(azimuths)])
    axles = np.array([np.cos(azimuths), np.sin(azimuths)])
    stiffness = settings.drivetrain.creep_stiffness
    grip = np.sqrt(settings.carpet.friction**2 - settings.drivetrain.roller_friction**2)
    times = np.zeros(2)
    for i, (rim, axle) in enumerate(zip(rims, axles, strict=True)):
        travel = np.stack([rim, axle], axis=-1)

        def excess(slip: float, rim: np.ndarray = rim, travel: np.ndarray = travel) -> float:
            traction = traction_per_load(slip * rim, travel, stiffness, grip)
            return float(9.81 * np.mean(rim * traction) - acceleration)

        times[i] = brentq(excess, 0.0, 1.0) / acceleration
    return times


def test_creep_alone_has_the_lag_and_gain_of_its_closed_form(study: AlphaStudy) -> None:
    """Lag T g^2 U / 2 in addition to the wheel loop's; ramp slope s with T a s^2 + s / g = 1."""
    profile = conditions.PROFILE
    axes = slice(0, 2)
    curve = slip_times(om.load_scenario("rect"), profile.acceleration_m_s2)
    creep_only = study.by_causes.at((1, 0, 0))  # creep without drag and battery
    creep = {
        name: (getattr(creep_only, name) - getattr(study.wheel_loop, name))[axes]
        for name in RampResponse._fields
    }
    gain = study.wheel_loop.steady_gain[axes] + creep["steady_gain"]
    # Acceleration shifts load between wheels; the closed form uses the mean load.
    np.testing.assert_allclose(creep["lag_s"], curve * gain**2 * profile.speed_m_s / 2, rtol=0.1)
    curve = curve * profile.acceleration_m_s2
    slope = (np.sqrt(1 + 4 * curve) - 1) / (2 * curve)
    np.testing.assert_allclose(
        study.wheel_loop.acceleration_gain[axes] + creep["acceleration_gain"], slope, atol=0.05
    )


def test_lag_is_independent_of_acceleration_but_acceleration_gain_is_not(
    study: AlphaStudy,
) -> None:
    slow, fast = study.baseline, study.by_condition["acceleration_m_s2"].at(0)
    # Lags of 60 to 100 ms, with ripple from the rollers
    np.testing.assert_allclose(fast.lag_s[:2], slow.lag_s[:2], rtol=0.05)
    np.testing.assert_allclose(fast.steady_gain, slow.steady_gain, atol=0.005)
    assert (fast.acceleration_gain < slow.acceleration_gain - 0.02).all()
    assert (fast.acceleration_gain < fast.steady_gain - 0.02).all()


def test_robots_slip_more_sideways(study: AlphaStudy) -> None:
    """Rims point less in this direction, see `slip_times`."""
    for response in (study.baseline, study.worn):
        assert response.steady_gain[SIDEWAYS] < response.steady_gain[FORWARD]
        assert response.lag_s[SIDEWAYS] > response.lag_s[FORWARD]


def test_rolling_resistance_and_low_charge_reduce_gain_and_heat_adds_lag(study: AlphaStudy) -> None:
    """Heat makes the wheel loops less stiff."""
    for name, sign in (("carpet.rolling_resistance", -1), ("battery.charge", 1)):
        assert (
            sign * (study.by_condition[name].steady_gain[0] - study.baseline.steady_gain) > 0.01
        ).all(), name
    assert (study.by_condition["motor.winding_c"].lag_s[0] > study.baseline.lag_s + 0.001).all()


def test_contributions_add_up_to_the_effect_of_all_causes(study: AlphaStudy) -> None:
    for name in RampResponse._fields:
        added = sum(study.contributions(name).values())
        np.testing.assert_allclose(
            added, getattr(study.worn, name) - getattr(study.wheel_loop, name), atol=1e-12
        )


@given(st.data())
def test_shapley_values_have_their_defining_properties(data: st.DataObject) -> None:
    """They add up, are 0 without an effect, and equal for two causes that only act together."""
    n_causes = len(conditions.CAUSES)
    values = data.draw(arrays.arrays(float, (2,) * n_causes, elements=st.floats(-1, 1)))
    idle = data.draw(st.sampled_from(range(n_causes)))
    contributions = conditions.shapley_values(values).values()
    assert sum(contributions) == pytest.approx(values.flat[-1] - values.flat[0], abs=1e-12)
    without = np.take(values, [0], idle)
    ineffective = np.concatenate([without, without], axis=idle)
    assert list(conditions.shapley_values(ineffective).values())[idle] == pytest.approx(
        0, abs=1e-12
    )
    together = np.zeros_like(values)
    together[1, 1] = 0.5
    contributions = list(conditions.shapley_values(together).values())
    assert contributions == pytest.approx([0.25, 0.25, *[0] * (n_causes - 2)], abs=1e-12)


def test_rows_summary_and_table_agree(result: AlphaResult, study: AlphaStudy) -> None:
    """A row per robot has settings, direction, profile and response."""
    rows = [row for row in result.rows().to_pylist() if row["direction"] is not None]
    assert len(rows) == 3 * (1 + len(CHANGED) + 2 ** len(conditions.CAUSES))
    full = [row for row in rows if row["battery.charge"] == 1.0]
    assert [row["lag_s"] for row in full] == pytest.approx(
        study.by_condition["battery.charge"].lag_s[0]
    )
    summary = result.summary()
    assert summary["complete"]
    reported = summary["alpha"]["by_condition"]["battery.charge"]["steady_gain"][0]
    assert reported == pytest.approx(study.by_condition["battery.charge"].steady_gain[0], abs=1e-6)
    assert f"{study.baseline.steady_gain[0]:.3f}" in result.table()


def test_unknown_condition_and_plant_without_wheels_are_rejected() -> None:
    with pytest.raises(om.OmniError, match="unknown setting lint"):
        om.measure_alpha(condition_values={"lint": (0.1,)})
    with pytest.raises(om.OmniError, match="the plant 'kinematic' has none"):
        om.measure_alpha(om.load_scenario("rect", plant="kinematic"), {})


def test_stopped_alpha_study_has_no_result() -> None:
    def stop(frame: int) -> None:
        if frame == 3:
            raise StoppedError("interrupted")

    stopped = om.measure_alpha(fast_scenario(), {}, start_progress=lambda title, frames: stop)
    assert (stopped.study, stopped.stopped, stopped.table()) == (None, "interrupted", "")
    assert stopped.summary()["alpha"] is None
