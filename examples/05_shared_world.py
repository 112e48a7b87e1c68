"""Simulate three robots in one world. They have hulls and could collide."""

import numpy as np

import omni_mj as om

# [x, y, heading] in m and rad: displacement of each robot's route.
start_poses = [[0, 0, 0], [0, 2.0, 0], [2.5, 0.5, np.pi / 2]]
rect = om.load_scenario(
    "rect",
    reference={"waypoints": [[-1, -0.75], [0, -0.75]]},
    world={"start_poses": start_poses},
)
sim = om.Simulation(rect, ["comp-flc"])
log = sim.run()

error = np.linalg.norm((log.channel("pose") - log.channel("ref"))[..., :2], axis=-1)
for row, max_error in zip(sim.rows, error.max(0), strict=True):
    print(f"world {row.world_index}, slot {row.slot}: maximum error {100 * max_error:.2f} cm")
