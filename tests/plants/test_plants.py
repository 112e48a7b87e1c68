"""The plants: equation 7 in closed form, and properties of both plants."""

import math

import numpy as np
import pytest
from benches.plant import (
    FRAME_S,
    SIGMAS,
    constant,
    drive,
    noiseless,
    receive_at_once,
    rows,
    with_settings,
)
from benches.plant import mujoco as plant_of
from hypothesis import given
from hypothesis import settings as hypothesis_settings
from hypothesis import strategies as st
from scipy import stats

from omni_mj.config.resolve import resolve_settings
from omni_mj.plants.kinematic_plant import KinematicPlant
from omni_mj.plants.mujoco_plant import MujocoPlant
from omni_mj.plants.telemetry import TELEMETRY_NAMES

# --- kinematic ---


@hypothesis_settings(max_examples=50)
@given(
    alpha=st.floats(0, 2), frames=st.integers(1, 50), seed=st.integers(0, 2**63 - 1), data=st.data()
)
def test_with_a_fixed_alpha_equation_7_is_a_sum(
    alpha: float, frames: int, seed: int, data: st.DataObject
) -> None:
    start = np.array([data.draw(st.tuples(*[st.floats(-10, 10)] * 3))])
    commands = np.random.default_rng(frames).normal(size=(frames, 1, 3))
    settings = with_settings(kinematic={"alpha_low": alpha, "alpha_high": alpha})
    poses = drive(KinematicPlant(rows([settings], [seed]), start), commands)
    expected = start + FRAME_S * alpha * np.cumsum(commands, axis=0)
    # Rounding of 50 sums; a drawn alpha may be off the bounds by the last bit.
    np.testing.assert_allclose(poses[1:], expected, rtol=0, atol=1e-12)


def test_alpha_is_uniform_between_its_bounds_and_new_in_every_frame_and_axis() -> None:
    frames = 5000
    settings = with_settings(kinematic={"alpha_low": 0.7, "alpha_high": 1.0})
    poses = drive(
        KinematicPlant(rows([settings], [4]), np.zeros((1, 3))),
        constant([1.0, 1.0, 1.0], frames, 1),
    )
    alpha = np.diff(poses[:, 0], axis=0) / FRAME_S
    assert alpha.min() >= 0.7 - 1e-9  # differences of positions of up to 70 m
    assert alpha.max() <= 1.0 + 1e-9
    for axis in alpha.T:
        # Kolmogorov-Smirnov; the level is that of five sigmas.
        assert stats.kstest(axis, stats.uniform(0.7, 0.3).cdf).pvalue > 6e-7
    centred = (alpha - alpha.mean(0)) / alpha.std(0)
    # Correlations of independent samples spread by 1 / sqrt(n).
    assert np.abs((centred[1:] * centred[:-1]).mean(0)).max() < SIGMAS / math.sqrt(frames)
    assert np.abs(np.corrcoef(alpha.T)[np.triu_indices(3, 1)]).max() < SIGMAS / math.sqrt(frames)


def test_the_disturbance_is_uniform_with_the_set_amplitude() -> None:
    frames, amplitude = 5000, 0.1
    settings = with_settings(disturbance={"velocity_m_s": amplitude})
    poses = drive(
        KinematicPlant(rows([settings], [9]), np.zeros((1, 3))),
        constant([0.0, 0.0, 0.0], frames, 1),
    )
    velocity = np.diff(poses[:, 0], axis=0) / FRAME_S
    assert (velocity[:, 2] == 0).all()  # it acts on the position only
    drift = velocity[:, :2]
    assert np.abs(drift).max() <= amplitude + 1e-12
    # The largest of 5000 uniform numbers misses the amplitude by 1 % with probability 0.99^5000.
    assert (np.abs(drift).max(0) > 0.99 * amplitude).all()
    # Mean and deviation of a uniform variable, a / sqrt(3), and their spreads: sigma / sqrt(n),
    # sigma / sqrt(5 n).
    sigma = amplitude / math.sqrt(3)
    np.testing.assert_allclose(drift.mean(0), 0.0, atol=SIGMAS * sigma / math.sqrt(frames))
    np.testing.assert_allclose(drift.std(0), sigma, atol=SIGMAS * sigma / math.sqrt(5 * frames))


# --- both ---


@pytest.mark.parametrize("kind", [KinematicPlant, MujocoPlant])
def test_returned_poses_and_twists_do_not_change_afterwards(
    kind: type[KinematicPlant] | type[MujocoPlant],
) -> None:
    plant = kind(rows([resolve_settings()]), np.zeros((1, 3)))
    pose, twist = plant.pose(), plant.twist()
    plant.advance(receive_at_once(np.ones((1, 3)), np.zeros(1)))
    plant.advance(receive_at_once(np.ones((1, 3)), np.zeros(1)))
    for old, new in ((pose, plant.pose()), (twist, plant.twist())):
        assert (old == 0).all()
        assert (new != 0).all()


def test_the_mujoco_plants_twist_is_the_rate_of_its_pose_in_the_world() -> None:
    """The integral of the twist of a turning robot is its displacement, for any start heading."""
    frames, start = 60, np.array([[0.0, 0.0, 0.0], [1.0, 2.0, 2.5]])
    plant = plant_of([noiseless()] * 2, start)
    np.testing.assert_array_equal(plant.twist(), np.zeros((2, 3)))
    integral = np.zeros((2, 3))
    for frame in range(frames):
        old_twist = plant.twist()
        plant.advance(
            receive_at_once(np.tile([0.5 + 0.3 * math.sin(frame / 10), 0.5, 3.0], (2, 1)))
        )
        integral += (old_twist + plant.twist()) / 2 * FRAME_S
    displacement = plant.pose() - start
    # Trapezoidal rule over frames: rollers and encoder counts vibrate within a frame by 1 %.
    assert (np.abs(integral - displacement) < 0.01 * np.abs(displacement)).all()
    assert (np.abs(displacement) > 0.3).all()


def test_returned_telemetry_does_not_change_afterwards() -> None:
    plant = plant_of([resolve_settings()])
    plant.advance(receive_at_once(0.1 * np.ones((1, 3)), np.zeros(1)))
    telemetry = plant.telemetry()
    columns = telemetry.columns.copy()
    plant.advance(receive_at_once(-np.ones((1, 3)), np.zeros(1)))
    new_telemetry = plant.telemetry()
    np.testing.assert_array_equal(telemetry.columns, columns)
    for name in TELEMETRY_NAMES:
        assert (getattr(telemetry, name) != getattr(new_telemetry, name)).any(), name
