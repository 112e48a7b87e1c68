"""The scenario in which everything happens at once: robots err, but stay within the field and come to rest."""

import numpy as np

import omni_mj as om

HALF_FIELD_M = (4.5, 3.0)  # division B
# A second of calm at the end, of three.
STORM = om.load_scenario(
    "storm", plant="planar", physics={"backend": "numpy"}, reference={"settle_s": 1.0}
)


def test_robots_come_out_of_the_storm_on_the_field_and_at_rest() -> None:
    """Whatever their controller believed meanwhile; its estimates are within what it allows."""
    simulation = om.Simulation(STORM, ["comp-flc", "adaptive-comp-flc"], seeds=[5])
    log = simulation.run()
    assert not simulation.failures
    pose = log.channel("pose")
    assert (np.abs(pose[..., :2]).max((0, 1)) < HALF_FIELD_M).all()
    assert np.abs(pose[..., :2] - log.channel("ref")[..., :2]).max() > 0.1, "it is a storm"
    moved = np.abs(np.diff(pose[-15:], axis=0)).max((0, 1)) * 60
    assert (moved < [0.03, 0.03, 0.15]).all()
    assert np.abs(pose[-1] - log.channel("ref")[-1])[:, :2].max() < 0.02
    latency = log.channel("latency_hat")
    known = ~np.isnan(latency)
    assert known.any()
    assert (latency[known] >= 0).all()
    assert (latency[known] < 30).all()
