"""What wheels tell of themselves where they do not creep: radius, arm, clocks; and wheels of another robot."""

from pathlib import Path

import numpy as np
import pytest

from omni_mj.scenarios.scenario import scenario
from omni_mj.studies.identify import identify

RATE, SMALL, SHORT, LATE, SLOW = 25, 0.96, 0.98, 0.07, 0.01


def log(path: Path, seconds: float = 40.0, wheels: int = 4) -> Path:
    """A slow robot whose wheels are 4 % small, its arm 2 % short; poses come later than encoders, and ever more so."""
    rng, dense = np.random.default_rng(0), np.arange(-1.0, seconds + 1.0, 1e-3)
    vx, vy, w = 0.2 * np.sin(1.1 * dense), 0.15 * np.sin(1.7 * dense + 1), 0.5 * np.sin(0.7 * dense)
    heading = np.cumsum(w) * 1e-3
    way = np.cumsum((vx + 1j * vy) * np.exp(1j * heading)) * 1e-3
    geometry = scenario("rect").settings.wheels.kinematics
    stretched = np.stack([vx / SMALL, vy / SMALL, w * SHORT / SMALL], 1)
    angles = np.cumsum(geometry.wheel_speeds(stretched), 0) * 1e-3
    t = np.arange(0.0, seconds, 1 / RATE)
    shown = t + LATE + SLOW * (t - seconds / 2)  # encoders of a line are of then
    columns = [t, *(np.interp(t, dense, c) for c in (way.real, way.imag, heading))]
    for i in range(1, 4):
        columns[i] = columns[i] + rng.normal(0, 0.0005, len(t))
    columns += [np.interp(shown, dense, a) for a in angles.T[:wheels]]
    head = ["time_s", "x_m", "y_m", "heading_rad", *(f"wheel_{i + 1}_rad" for i in range(wheels))]
    np.savetxt(path, np.column_stack(columns), delimiter=",", header=",".join(head), comments="")
    return path


def test_wheels_tell_radius_arm_and_clocks(tmp_path: Path) -> None:
    """Within half a percent, and 10 ms: 0.5 mm of noise, 0.2 m/s and 25 lines a second."""
    result = identify([log(tmp_path / "log.csv")])
    wheels = scenario("rect").settings.wheels
    assert result["wheels.radius_m"].value == pytest.approx(SMALL * wheels.radius_m, rel=0.005)
    assert result["wheels.arm_m"].value == pytest.approx(SHORT * wheels.arm_m, rel=0.01)
    assert result["wheels.gain_forward"].value == pytest.approx(SMALL, rel=0.005)
    assert result["wheels.clock_s"].value == pytest.approx(LATE, abs=0.01)
    assert result["wheels.drift"].value == pytest.approx(SLOW, abs=1e-3)
    assert not result["wheels.creep_stiffness"].told
    assert not result.misfits


def test_wheels_of_another_robot_are_a_line(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="3 wheels, but the robot's file has 4"):
        identify([log(tmp_path / "log.csv", 6.0, wheels=3)])
