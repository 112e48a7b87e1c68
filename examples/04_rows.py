"""Settings of each row its own: eight dead times in one batch."""

import numpy as np

import omni_mj as om
from omni_mj.config.rows import Row

rect = om.load_scenario("rect", plant="kinematic")
settings = [rect.settings.replace(radio={"delay_frames": delay}) for delay in range(0, 16, 2)]
rows = [Row(i, 0, "flc", 0, own, rect.robot) for i, own in enumerate(settings)]

log = om.Simulation(rect, ["flc"], rows=rows).run()
error = np.linalg.norm((log.channel("pose") - log.channel("ref"))[..., :2], axis=-1)
for row, worst in zip(rows, error.max(0), strict=True):
    print(f"{row.settings.radio.delay_frames:3d} frames of dead time: {100 * worst:.2f} cm")
