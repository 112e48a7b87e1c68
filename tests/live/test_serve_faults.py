"""Faults of a scenario that is served: they are those of `run`, of the robots whose numbers they name."""

from pathlib import Path

import numpy as np
import pytest
from served import FAST, QUIET, drive, local, pitch_of

SCENARIO = """
[[fault]]
kind = "firmware-timeout"
at = 0.2
robots = [3]

[[fault]]
kind = "vision-bias"
at = 0.0
robots = [1]
x_m = 0.25

[[fault]]
kind = "vision-clock"
at = 0.0
ms_per_s = 50.0

[[fault]]
kind = "vision-delay"
at = 0.0
to = 0.1
"""


def test_robots_meet_what_names_their_numbers_and_cameras_what_concerns_them_all(tmp_path: Path) -> None:
    """Blue 1 and 3: one is seen elsewhere, the other stands; stamps are behind by the rate times time."""
    file = tmp_path / "served.toml"
    file.write_text(SCENARIO, encoding="utf-8")
    pitch = pitch_of(*QUIET, FAST, "radio.delay_frames=0", blue="1,3", scenario=str(file))
    assert [[fault.kind for fault in row.faults] for row in pitch.rows] == [
        ["vision-bias", "vision-clock", "vision-delay"],
        ["firmware-timeout", "vision-clock", "vision-delay"],
    ]
    seen = []
    while pitch.time_s < 0.6:
        for image in pitch.look():
            said = pitch.detection(image, 100.0)
            time = image.cycle / 960
            assert said.t_capture == pytest.approx(100 + time - 0.05 * time, abs=1e-6)
            assert image.sent == pytest.approx(time + 0.1)
            seen.append(image.poses[0, 0] - pitch.plant.pose()[0, 0])
        drive(pitch, 1, local(1, 0.5), local(3, 0.5))
    np.testing.assert_allclose(seen, 0.25, atol=1e-9)
    speeds = np.hypot(*pitch.plant.twist()[:, :2].T)
    assert speeds[0] > 0.3
    assert speeds[1] < 0.02
