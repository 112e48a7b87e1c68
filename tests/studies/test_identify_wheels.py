"""What wheels tell of themselves, on motion by the law of slip, solved here by small steps.

The law is K u - v = T |v| v' / K: rubber slips by its travel over the ground. TIGERs write |u| for |v| / K; at 3 m/s^2
that changes K by 2 %.
"""

from pathlib import Path

import numpy as np
import pytest

from omni_mj.scenarios.scenario import scenario
from omni_mj.studies.identify import identify

GAIN, CREEP = 0.96, np.array([0.05, 0.09])
RATE, FINE = 60, 16


def log(path: Path, seconds: float = 12.0) -> Path:
    """A robot whose wheels turn for it to go in waves, never slower than 0.6 m/s, and whose wheels are 4 % small."""
    rng, dt = np.random.default_rng(0), 1 / (RATE * FINE)
    t = np.arange(round(seconds / dt)) * dt
    u = np.stack([0.9 + 0.8 * np.sin(4.1 * t), 1.0 + 0.7 * np.sin(5.3 * t)], 1)
    v, moved = GAIN * u[0], np.zeros_like(u)
    for i in range(1, len(t)):
        v = v + dt * (GAIN * u[i - 1] - v) / (CREEP / GAIN * np.hypot(*v))
        moved[i] = moved[i - 1] + dt * v
    wheels = scenario("rect").settings.wheels.kinematics.wheel_speeds(np.column_stack([u, np.zeros(len(t))]))
    angles = np.cumsum(wheels, 0)[::FINE] * dt
    pose = np.column_stack([moved[::FINE], np.zeros(len(angles))]) + rng.normal(0, 0.001, (len(angles), 3))
    head = ["time_s", "x_m", "y_m", "heading_rad", *(f"wheel_{i}_rad" for i in range(1, 5))]
    np.savetxt(path, np.column_stack([t[::FINE], pose, angles]), delimiter=",", header=",".join(head), comments="")
    return path


def test_wheels_tell_scale_creep_and_radius(tmp_path: Path) -> None:
    """Within 1 % of the scale and 5 % of creep: of noise of 1 mm, and the 1 ms that the fit has beside creep."""
    found = {e.name: e for e in identify([log(tmp_path / "log.csv")]).estimates}
    wheels = scenario("rect").settings.wheels
    for axis, name in enumerate(("forward", "sideways")):
        assert found[f"gain_{name}"].value == pytest.approx(GAIN, rel=0.01)
        assert found[f"creep_{name}_s2_m"].told
        assert found[f"creep_{name}_s2_m"].value == pytest.approx(CREEP[axis], rel=0.05)
    assert found["radius_m"].value == pytest.approx(GAIN * wheels.radius_m, rel=0.01)
    forward = 4 * GAIN**2 / (9.81 * CREEP[0] * 2.5)  # wheels at 60, 135, 225 and 300 degrees: sum d^2 = 2.5
    sideways = 4 * GAIN**2 / (9.81 * CREEP[1] * 1.5)
    assert min(forward, sideways) * 0.9 < found["creep_stiffness"].value < max(forward, sideways) * 1.1
    assert "arm_m" not in found  # nothing turns


def test_wheels_of_another_robot_are_a_line(tmp_path: Path) -> None:
    path = log(tmp_path / "log.csv", 2.0)
    path.write_text("\n".join(line.rsplit(",", 1)[0] for line in path.read_text().splitlines()))
    with pytest.raises(ValueError, match="3 wheels, but the robot's file has 4"):
        identify([path])
