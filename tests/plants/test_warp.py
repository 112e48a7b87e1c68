"""The physics by MuJoCo Warp, on its device for processors, against MuJoCo's own."""

import numpy as np
import pytest
from driving import drive, mujoco, ramp, rows, with_settings

from omni_control.errors import OmniError

pytest.importorskip("mujoco_warp")
from omni_mj.plants.warp import WarpPlant


def test_a_second_is_that_of_mujoco() -> None:
    """Two robots on full wheels, one of them turning, within a tenth of a millimetre rms.

    Of float32's 1e-7 contacts make some ten times as much in a second: 0.6 um were seen.
    """
    chosen = with_settings()
    commands = ramp(np.array([[1.0, 0.5, 0.5], [0.0, -0.5, 0.0]]), 2.0, 60)
    full = drive(mujoco([chosen] * 2), commands)
    other = drive(WarpPlant(rows([chosen] * 2), np.zeros((2, 3))), commands)
    assert np.hypot(*full[-1, 0, :2]) > 0.4
    assert np.sqrt(((other - full)[..., :2] ** 2).sum(-1).mean(0)).max() < 1e-4


def test_compiled_loops_are_refused() -> None:
    with pytest.raises(OmniError, match=r"^physics by MuJoCo Warp needs physics.kernel = numpy"):
        WarpPlant(rows([with_settings(physics={"kernel": "numba"})]), np.zeros((1, 3)))
