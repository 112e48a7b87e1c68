"""The scenario with all faults at once: robots deviate, but stay on the field and come to rest."""

import numpy as np

import omni_mj as om

HALF_FIELD_M = (4.5, 3.0)  # division B
# A second of calm at the end, of three.
ALL_FAULTS = om.load_scenario(
    "fault-all", plant="mujoco", wheels={"model": "two-rollers"}, reference={"settle_s": 1.0}
)


def test_robots_end_on_the_field_and_at_rest_after_all_faults() -> None:
    """The estimates of their controller stay within its limits."""
    simulation = om.Simulation(ALL_FAULTS, ["comp-flc", "adaptive-comp-flc"], seeds=[5])
    log = simulation.run()
    assert not simulation.failures
    pose = log.channel("pose")
    assert (np.abs(pose[..., :2]).max((0, 1)) < HALF_FIELD_M).all()
    assert np.abs(pose[..., :2] - log.channel("ref")[..., :2]).max() > 0.1, (
        "the faults must disturb the robots"
    )
    final_speed = np.abs(np.diff(pose[-15:], axis=0)).max((0, 1)) * 60
    assert (final_speed < [0.03, 0.03, 0.15]).all()
    assert np.abs(pose[-1] - log.channel("ref")[-1])[:, :2].max() < 0.02
    latency = log.channel("latency_hat")
    known = ~np.isnan(latency)
    assert known.any()
    assert (latency[known] >= 0).all()
    assert (latency[known] < 30).all()
