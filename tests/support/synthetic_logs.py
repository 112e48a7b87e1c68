"""Logs of a robot on the planar plant under random commands, with noise of 1.3 mm and 3 mrad."""

import json
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

import omni_mj as om

POSE = ("x_m", "y_m", "heading_rad")
COMMAND = ("vx_cmd_world_m_s", "vy_cmd_world_m_s", "w_cmd_rad_s")
WHEELS = ("wheel_1_rad", "wheel_2_rad", "wheel_3_rad", "wheel_4_rad")
SETTINGS = om.load_scenario("rect").settings
DEAD_TIME_S, CREEP_STIFFNESS = 0.1, SETTINGS.drivetrain.creep_stiffness
Columns = dict[str, np.ndarray]


@cache
def _simulate(
    seconds: float, rate: int, speed: float, acceleration: float, noise: bool, changes: str
) -> Columns:
    """Return the columns of a log; commands change with each line."""
    frames, hold = round(60 * seconds), 60 // rate
    rest = {
        "shape": "waypoints",
        "waypoints": [[0, 0], [0, 0]],
        "mode": "timed",
        "settle_s": seconds + 1,
    }
    defaults = {
        "reference": rest,
        "world": {"start_poses": [[0, 0, 0]]},
        "wheels": {"model": "two-rollers"},
    }
    sim = om.Simulation(om.load_scenario("rect", **defaults, **json.loads(changes)), ["p"])
    rng, command, goal = np.random.default_rng(1), np.zeros((frames, 3)), np.zeros(3)
    max_step = np.array([acceleration, acceleration, 15.0]) / rate
    for k in range(hold, frames):
        command[k] = command[k - 1]
        if k % (45 // hold * hold) == 0:
            goal = rng.uniform(-1, 1, 3) * [speed, speed, 3.0]
        if k % hold == 0:
            command[k] += np.clip(goal - command[k], -max_step, max_step)
    for twist in command:
        sim.step(twist[None])
    lines = slice(0, frames, hold)
    pose, angles = (sim.log.channel(name)[lines, 0] for name in ("pose", "wheel_angle"))
    if noise:
        pose = pose + rng.normal(size=pose.shape) * [0.0013, 0.0013, 0.003]
    names = ("time_s", *POSE, *COMMAND, *WHEELS)
    return dict(
        zip(
            names,
            [np.arange(frames)[lines] / 60, *pose.T, *command[lines].T, *angles.T],
            strict=True,
        )
    )


def make_log(
    seconds: float = 6.5,
    rate: int = 60,
    speed: float = 2.2,
    acceleration: float = 2.0,
    *,
    wheels: bool = True,
    commands: bool = True,
    noise: bool = True,
    **sections: Any,
) -> Columns:
    """Return the columns of a log.

    Args:
        seconds: Duration.
        rate: Lines per second, a divisor of 60.
        speed: Largest velocity per axis, m/s.
        acceleration: Largest acceleration, m/s^2.
        wheels: Whether the log has wheel angles.
        commands: Whether the log has commands.
        noise: Whether poses have noise.
        sections: Settings of the robot.
    """
    omitted = (() if commands else COMMAND) + (() if wheels else WHEELS)
    columns = _simulate(seconds, rate, speed, acceleration, noise, json.dumps(sections))
    return {name: values.copy() for name, values in columns.items() if name not in omitted}


def write_csv(path: Path, columns: Columns) -> Path:
    """Write a log as CSV with empty fields for NaN."""
    body = np.stack(list(columns.values()), 1)
    np.savetxt(path, body, fmt="%.9g", delimiter=",", header=",".join(columns), comments="")
    path.write_text(path.read_text().replace("nan", ""))
    return path
