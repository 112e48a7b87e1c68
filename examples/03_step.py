"""Drive robots oneself, a frame of 1/60 s at a time: what is seen comes out, commands go in."""

import numpy as np

import omni_mj as om

sim = om.Simulation(om.load_scenario("rect", radio={"delay_frames": 6}), ["comp-flc"])
sim.reset(seed=0)
for _ in range(120):
    seen = sim.observe()
    towards = np.array([[0.0, 0.0, 0.0]]) - seen.pose  # the field's centre
    sim.step(np.clip(2.0 * towards, -1.0, 1.0))

x, y, heading = sim.plant.pose()[0]
print(f"after {sim.frame / 60:g} s the robot is {100 * np.hypot(x, y):.1f} cm from the centre")
