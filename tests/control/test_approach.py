"""Laws of the rule by which a reference moves: it stops exactly, as fast as its limits let it, and keeps them."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from laws import LAW

from omni_control.reference.limits import approach, stopping_speed

T = 1 / 60


def brake(speed: float, unit: float) -> float:
    """Distance, in frames times m/s, covered while the speed falls by a unit a frame: a sum, not a formula."""
    total = 0.0
    while speed > 0:
        total += speed
        speed -= unit
    return total


@LAW
@given(st.floats(0, 5), st.floats(0.3, 6))
def test_stopping_speed_is_the_speed_whose_braking_distance_is_the_distance(distance: float, limit: float) -> None:
    """Summed frame by frame, braking as hard as allowed from the stopping speed covers the distance."""
    speed = float(stopping_speed(np.array(distance), limit, T))
    # The sum of up to 600 frames rounds by 600 times 1e-16 of 5 m.
    assert brake(speed, limit * T) * T == pytest.approx(distance, abs=1e-12)


@LAW
@given(st.floats(0, 5), st.floats(0.3, 6))
def test_stopping_speed_falls_by_one_unit_a_frame(distance: float, limit: float) -> None:
    """Followed until it stops, the speed falls by a T in every frame, by less only in the last, and d is used up."""
    unit, speeds = limit * T, []
    for _ in range(1000):
        speed = float(stopping_speed(np.array(max(distance, 0.0)), limit, T))
        # Near the end the square root of rounding errors of the distance, 1e-15 m, is not yet visible.
        if speed < 1e-9:
            break
        speeds.append(speed)
        distance -= speed * T
    falls = -np.diff([*speeds, 0.0])
    # Distances of 5 m are rounded at 1e-15, and the speed is at most distance / T.
    np.testing.assert_allclose(falls[:-1], unit, rtol=0, atol=1e-11)
    assert len(falls) == 0 or falls[-1] <= unit + 1e-11
    assert distance == pytest.approx(0, abs=1e-10)


@LAW
@given(*[st.tuples(st.floats(-3, 3), st.floats(-3, 3))] * 2, st.floats(0.1, 4), st.floats(0.1, 6))
def test_approach_keeps_its_limits_from_any_velocity(
    offset: tuple[float, float], velocity: tuple[float, float], speed: float, acceleration: float
) -> None:
    """One frame changes the velocity by at most a T, and never makes it faster than the limit if it was not so."""
    old = np.array([velocity])
    new = approach(np.array([offset]), old, speed, acceleration, T)
    # Roundings of numbers of size 4.
    assert np.hypot(*(new - old)[0]) <= acceleration * T + 1e-14
    assert np.hypot(*new[0]) <= max(speed, np.hypot(*velocity)) + 1e-14


@LAW
@given(angle=st.floats(0, 2 * np.pi), sideways=st.floats(0, 3), ahead=st.floats(-1, 1), distance=st.floats(0.01, 2))
def test_what_leads_past_the_set_point_is_braked_also_while_speeding_up(
    angle: float, sideways: float, ahead: float, distance: float
) -> None:
    """Of a frame's change of velocity at least 1/sqrt(2) goes against sideways velocity, unless braking needs more."""
    period, acceleration = 1 / 60, 0.826
    step = acceleration * period
    along, across = np.array([np.cos(angle), np.sin(angle)]), np.array([-np.sin(angle), np.cos(angle)])
    velocity = ahead * along + sideways * across
    after = approach(distance * along[None], velocity[None], 10.0, acceleration, period)[0]
    # Velocities of size 3 round at 4e-16.
    assert np.hypot(*(after - velocity)) <= step + 1e-12
    assert -1e-12 <= after @ across <= sideways + 1e-12
    if ahead + step <= math.sqrt(2 * acceleration * distance) - step:  # far from where it must brake
        kept = max(1 - math.sqrt(0.5), 1 - step / math.sqrt(2) / max(sideways, 1e-300))
        assert after @ across <= sideways * kept + 1e-12
        assert after @ along > ahead
