"""Logs of a robot on the planar plant that is told random velocities, with noise of 1.3 mm and 3 mrad."""

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
LATENCY_S, CREEP_STIFFNESS = 0.1, SETTINGS.drivetrain.creep_stiffness
Columns = dict[str, np.ndarray]


@cache
def _simulate(seconds: float, rate: int, speed: float, pull: float, changes: str) -> Columns:
    """The columns of a log; commands change with each line."""
    frames, hold = round(60 * seconds), 60 // rate
    rest = {
        "shape": "waypoints",
        "waypoints": [[0, 0], [0, 0]],
        "mode": "timed",
        "settle_s": seconds + 1,
    }
    usual = {
        "reference": rest,
        "world": {"start_poses": [[0, 0, 0]]},
        "wheels": {"model": "two-rollers"},
    }
    sim = om.Simulation(om.load_scenario("rect", **usual, **json.loads(changes)), ["p"])
    rng, command, goal = np.random.default_rng(1), np.zeros((frames, 3)), np.zeros(3)
    steepest = np.array([pull, pull, 15.0]) / rate
    for k in range(hold, frames):
        command[k] = command[k - 1]
        if k % (45 // hold * hold) == 0:
            goal = rng.uniform(-1, 1, 3) * [speed, speed, 3.0]
        if k % hold == 0:
            command[k] += np.clip(goal - command[k], -steepest, steepest)
    for twist in command:
        sim.step(twist[None])
    lines = slice(0, frames, hold)
    pose, angles = (sim.log.channel(name)[lines, 0] for name in ("pose", "wheel_angle"))
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
    pull: float = 2.0,
    *,
    wheels: bool = True,
    commands: bool = True,
    **sections: Any,
) -> Columns:
    """The columns of a log.

    Args:
        seconds: How long.
        rate: Lines per second, by which 60 can be divided.
        speed: Largest velocity per axis, m/s.
        pull: Largest acceleration, m/s^2.
        wheels: Whether the log has wheels.
        commands: Whether it has commands.
        sections: Settings of the robot.
    """
    left = (() if commands else COMMAND) + (() if wheels else WHEELS)
    columns = _simulate(seconds, rate, speed, pull, json.dumps(sections))
    return {name: values.copy() for name, values in columns.items() if name not in left}


def write_csv(path: Path, columns: Columns) -> Path:
    """A log as CSV; what is not a number is empty."""
    body = np.stack(list(columns.values()), 1)
    np.savetxt(path, body, fmt="%.9g", delimiter=",", header=",".join(columns), comments="")
    path.write_text(path.read_text().replace("nan", ""))
    return path
