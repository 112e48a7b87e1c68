"""Single steps: the same as `run`, with commands of the caller, and after a reset."""

import numpy as np
import pytest
from benches.short_simulations import DISTURBED, IDEAL, PLANTS, Grid, Log, run, simulation

LONG = 600  # frames, more than a log has room for at first
RANDOM = (*DISTURBED, "radio.jitter_frames=4")
BRIEF = ("reference.waypoints=[[0,0],[0.2,0]]", "reference.settle_s=0.1")


def assert_logs_equal(log: Log, other_log: Log) -> None:
    """Check that all channels are equal, NaN included."""
    assert log.length == other_log.length
    for name in log.columns:
        np.testing.assert_array_equal(log.channel(name), other_log.channel(name), err_msg=name)


@pytest.mark.parametrize("plant", PLANTS)
def test_steps_equal_the_run_however_often_the_team_observes(plant: str) -> None:
    stepped = simulation(plant, RANDOM, seeds=2, route=BRIEF)
    n_observations = 0
    while not stepped.done:
        for _ in range(
            n_observations % 3
        ):  # none, once, twice: a look takes nothing from the streams of noise
            observation = stepped.observe()
            assert observation is stepped.observe()
        stepped.step()
        n_observations += 1
    assert_logs_equal(stepped.log, run(plant, RANDOM, seeds=2, route=BRIEF).log)


def test_a_reset_starts_the_same_run_again_or_that_of_another_seed() -> None:
    simulated = simulation("kinematic", RANDOM, seeds=2)
    for _ in range(20):
        simulated.step()
    simulated.reset()
    assert (simulated.frame, simulated.log.length) == (0, 0)
    assert_logs_equal(simulated.run(), run("kinematic", RANDOM, seeds=2).log)
    simulated.reset(seed=7)
    assert [row.seed for row in simulated.rows] == [7, 8, 7, 8]
    while not simulated.done:
        simulated.step()
    assert_logs_equal(simulated.log, run("kinematic", RANDOM, seed=7, seeds=2).log)


def test_a_callers_command_replaces_the_controllers_and_is_limited() -> None:
    simulated = simulation(
        "kinematic", (*IDEAL, "control.max_acceleration_m_s2=4.7", "radio.delay_frames=3")
    )
    desired = np.array([[1.0, 0.5, 0.2], [0.0, -9.0, 0.0]])
    for _ in range(120):
        simulated.step(desired)
    command, pose = simulated.log.channel("command"), simulated.log.channel("pose")
    # After the ramps, what was asked for, or the highest speed in its direction: 3.7 m/s
    # (ssl-simulation-setup).
    np.testing.assert_allclose(command[-1], [[1.0, 0.5, 0.2], [0.0, -3.7, 0.0]], atol=1e-12)
    change = np.diff(command, axis=0, prepend=0.0)[..., :2]
    assert np.linalg.norm(change, axis=-1).max() <= 4.7 / 60 * (1 + 1e-12)
    # Equation 7 with alpha = 1: what was commanded until three frames ago, summed up. Rounding of
    # 120 sums.
    np.testing.assert_allclose(pose[-1] - pose[0], command[:-4].sum(0) / 60, atol=1e-12)
    assert np.isnan(simulated.log.channel("predicted")).all(), "no controller was asked"


def test_a_simulation_can_be_stepped_beyond_the_end() -> None:
    """Beyond the end of the reference and the log's initial capacity, robots rest."""
    simulated = simulation("kinematic", (*IDEAL, "radio.delay_frames=0"))
    frames = simulated.references[0].frames
    for _ in range(LONG):
        simulated.step()
    assert simulated.done
    log = Grid(simulated.log)
    # What comes after a row's end belongs to no run: it is not recorded.
    assert (simulated.log.lengths == frames).all()
    assert log.length == LONG
    assert np.isnan(log.channel("pose")[frames:]).all()
    np.testing.assert_allclose(simulated.plant.pose(), [[0.5, 0, 0]] * 2, atol=1e-9)
