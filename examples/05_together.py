"""Three robots in one world, which have hulls and could meet."""

import numpy as np

import omni_mj as om

places = [
    [0, 0, 0],
    [0, 2.0, 0],
    [2.5, 0.5, np.pi / 2],
]  # x, y, heading by which each one's route is displaced
rect = om.load_scenario(
    "rect", reference={"waypoints": [[-1, -0.75], [0, -0.75]]}, world={"start_poses": places}
)
sim = om.Simulation(rect, ["comp-flc"])
log = sim.run()

error = np.linalg.norm((log.channel("pose") - log.channel("ref"))[..., :2], axis=-1)
for row, worst in zip(sim.rows, error.max(0), strict=True):
    print(f"world {row.world}, slot {row.slot}: at most {100 * worst:.2f} cm off")
