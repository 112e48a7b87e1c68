"""Step a simulation frame by frame (1/60 s): observe, then command."""

import numpy as np

import omni_mj as om

sim = om.Simulation(om.load_scenario("rect", radio={"delay_frames": 6}), ["comp-flc"])
sim.reset(seed=0)
target = np.array([[0.0, 0.0, 0.0]])  # the field's center
for _ in range(120):
    observation = sim.observe()
    sim.step(np.clip(2.0 * (target - observation.pose), -1.0, 1.0))

x, y, heading = sim.plant.pose()[0]
distance_cm = 100 * np.hypot(x, y)
print(f"after {sim.frame / 60:g} s the robot is {distance_cm:.1f} cm from the center")
