"""What laws are compiled to is what they are."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from laws import LAW
from omni_mj.onboard import wide

# A rounding of the angle's reduction, one of the series, half of one in the last place of numbers up to 1.
ROUNDING = 3e-16


@LAW
@given(angle=st.floats(-1e4, 1e4) | st.integers(-100, 100).map(lambda eighths: eighths * np.pi / 4))
def test_directions_without_a_call_are_cosine_and_sine(angle: float) -> None:
    np.testing.assert_allclose(wide.direction(angle), [np.cos(angle), np.sin(angle)], rtol=0, atol=ROUNDING)


def test_an_angle_that_is_not_a_number_has_no_direction() -> None:
    assert np.isnan(wide.direction(np.nan)).all()
