"""Run rows with different settings in one batch: eight dead times."""

import numpy as np

import omni_mj as om
from omni_mj.config.rows import Row

rect = om.load_scenario("rect", plant="kinematic")
settings = [rect.settings.replace(radio={"delay_frames": delay}) for delay in range(0, 16, 2)]
rows = [Row(i, 0, "flc", 0, settings_i, rect.robot) for i, settings_i in enumerate(settings)]

log = om.Simulation(rect, ["flc"], rows=rows).run()
error = np.linalg.norm((log.channel("pose") - log.channel("ref"))[..., :2], axis=-1)
for row, max_error in zip(rows, error.max(0), strict=True):
    delay = row.settings.radio.delay_frames
    print(f"{delay:3d} frames of dead time: maximum error {100 * max_error:.2f} cm")
