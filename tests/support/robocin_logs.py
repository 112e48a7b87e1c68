"""Logs of a robot of RobôCIn, see tests/data/robocin: odometry stands for what the wheels did."""

from pathlib import Path

import numpy as np

from omni_control.kinematics import Kinematics, world_to_body

FOLDER = Path(__file__).parents[1] / "data" / "robocin"
LOG_NAMES = ("sqr_02", "igs_03")
PERIOD_S = 0.04383  # from frame to frame


def write_robocin_log(
    name: str, folder: Path, geometry: Kinematics, n_lines: int | None = None
) -> Path:
    """Write a log with the wheel angles that would give the odometry; return its path.

    Args:
        name: Name of the log, one of `LOG_NAMES`.
        folder: Folder of the new file.
        geometry: Wheels of the robot.
        n_lines: Number of lines. Default: all.
    """
    data = np.loadtxt(FOLDER / f"{name}.csv", delimiter=",", skiprows=1, max_rows=n_lines)
    pose, odometry = data[:, 1:4], data[:, 4:7]
    pose[:, 2] = np.radians(pose[:, 2])
    odometry[:, 2] = np.unwrap(np.radians(odometry[:, 2]))
    step = np.diff(odometry, axis=0)
    body_step = world_to_body(step, odometry[:-1, 2] + step[:, 2] / 2)
    angles = np.cumsum(geometry.wheel_speeds(body_step), axis=0)
    angles = np.concatenate([np.zeros_like(angles[:1]), angles])
    names = ["time_s", "x_m", "y_m", "heading_rad"]
    names += [f"wheel_{i}_rad" for i in range(1, angles.shape[1] + 1)]
    columns = np.column_stack([data[:, 0] * PERIOD_S, pose, angles])
    path = folder / f"{name}.csv"
    np.savetxt(path, columns, fmt="%.9g", delimiter=",", header=",".join(names), comments="")
    return path
