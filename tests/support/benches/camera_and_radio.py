"""Bench of the camera and the radio between robots and team."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from omni_mj.config.network_settings import RadioSettings
from omni_mj.config.resolve import resolve_settings
from omni_mj.network.camera import Cameras
from omni_mj.network.radio import Radio

FRAME_S = 1 / 60
# Vision without noise
SHARP = {"position_noise_m": 0.0, "heading_noise_rad": 0.0, "miss_probability": 0.0}
Fault = dict[str, Any]


def make_fault(kind: str, start: int = 0, duration: int = 0, **values: Any) -> Fault:
    """Return a fault that begins in a frame and lasts for some frames; 0: until the end."""
    return {"kind": kind, "start_s": start * FRAME_S, "duration_s": duration * FRAME_S, **values}


def measure_poses(
    poses: NDArray,
    faults: Sequence[Sequence[Fault]] = (),
    seeds: Sequence[int] | None = None,
    visions: Sequence[dict[str, Any]] | None = None,
    world: dict[str, Any] | None = None,
    **vision: Any,
) -> tuple[NDArray, NDArray]:
    """Return measured poses (frames, n, 3) and ages (frames, n), s, of true poses.

    Args:
        poses: True poses.
        faults: Faults of each robot.
        seeds: Seed of each robot. Default: 0.
        visions: Settings of each robot. Default: the same.
        world: Size of the field. Default: that of division B.
        vision: Settings of all robots.
    """
    n = poses.shape[1]
    if visions is None:
        settings = [resolve_settings({"vision": vision, "world": world or {}})] * n
    else:
        settings = [resolve_settings({"vision": {**vision, **row}}) for row in visions]
    row_faults = _resolve_faults(faults or [[]] * n)
    cameras = Cameras(settings, [(seed,) for seed in seeds or [0] * n], row_faults)
    poses_by_frame, ages = [], []
    for pose in poses:
        measured, age = cameras(pose)
        poses_by_frame.append(measured)
        ages.append(age)
    return np.array(poses_by_frame), np.array(ages)


def _resolve_faults(faults: Sequence[Sequence[Fault]]) -> list[Any]:
    """Return the settings of the faults of each robot. Those of equal faults are shared."""
    settings = {str(faults_i): faults_i for faults_i in faults}
    resolved = {key: resolve_settings({"fault": value}).fault for key, value in settings.items()}
    return [resolved[str(faults_i)] for faults_i in faults]


def make_radio(
    settings: Sequence[dict[str, Any]],
    faults: Sequence[Sequence[Fault]] = (),
    seeds: Sequence[int] | None = None,
    **options: Any,
) -> Radio:
    """Return a radio to robots with these settings."""
    n = len(settings)
    row_faults = _resolve_faults(faults or [[]] * n)
    radio_settings = [RadioSettings(**settings_i) for settings_i in settings]
    return Radio(radio_settings, [(seed,) for seed in seeds or [0] * n], row_faults, **options)


def receive_packets(
    faults: Sequence[Sequence[Fault]],
    frames: int,
    delay: int = 2,
    ticks: int = 1,
    seeds: Sequence[int] | None = None,
    **settings: Any,
) -> NDArray:
    """Return the tick of the packet that each robot holds, (frames * ticks, n); -1 for none."""
    row_settings = [{"delay_frames": delay, **settings}] * len(faults)
    link = make_radio(row_settings, faults, seeds, ticks_per_frame=ticks, initial_packet=(-1.0,))
    packets = []
    for tick in range(frames * ticks):
        link.send(np.full((len(faults), 1), float(tick)))
        packet, _, age = link.deliver()
        np.testing.assert_array_equal(packet[:, 0], np.where(packet[:, 0] < 0, -1, tick - age))
        packets.append(packet[:, 0])
    return np.array(packets, int)
