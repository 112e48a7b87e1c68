"""Bench of the camera and the radio between robots and team."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from omni_mj.config.network_settings import RadioSettings, VisionSettings
from omni_mj.config.resolve import resolve_settings
from omni_mj.network.camera import Cameras
from omni_mj.network.radio import Radio

FRAME_S = 1 / 60
Fault = dict[str, Any]


def fault(kind: str, start: int = 0, lasts: int = 0, **values: Any) -> Fault:
    """Return a fault that begins in a frame and lasts for some frames; 0: until the end."""
    return {"kind": kind, "start_s": start * FRAME_S, "duration_s": lasts * FRAME_S, **values}


def watch(
    poses: NDArray,
    faults: Sequence[Sequence[Fault]] = (),
    seeds: Sequence[int] | None = None,
    visions: Sequence[dict[str, Any]] | None = None,
    **vision: Any,
) -> tuple[NDArray, NDArray]:
    """Return what arrives of true poses (frames, n, 3) in each frame, and its age (frames, n), s.

    Args:
        poses: True.
        faults: Of each robot.
        seeds: Of each robot. [0]
        visions: Settings of each robot. [the same]
        vision: Settings of all.
    """
    n = poses.shape[1]
    settings = [VisionSettings(**{**vision, **own}) for own in visions or [{}] * n]
    own_faults = [resolve_settings({"fault": own}).fault for own in faults or [[]] * n]
    cameras = Cameras(settings, [(seed,) for seed in seeds or [0] * n], own_faults)
    seen, ages = [], []
    for pose in poses:
        measured, valid = cameras(pose)
        np.testing.assert_array_equal(valid, ~np.isnan(measured[:, 0]))
        seen.append(measured)
        ages.append(np.zeros(n) if cameras.measurement_age is None else cameras.measurement_age)
    return np.array(seen), np.array(ages)


def radio(
    settings: Sequence[dict[str, Any]],
    faults: Sequence[Sequence[Fault]] = (),
    seeds: Sequence[int] | None = None,
    **more: Any,
) -> Radio:
    """Return a radio to robots with these settings."""
    n = len(settings)
    own_faults = [resolve_settings({"fault": own}).fault for own in faults or [[]] * n]
    chosen = [RadioSettings(**own) for own in settings]
    return Radio(chosen, [(seed,) for seed in seeds or [0] * n], own_faults, **more)


def hold(
    faults: Sequence[Sequence[Fault]],
    frames: int,
    delay: int = 2,
    ticks: int = 1,
    seeds: Sequence[int] | None = None,
    **settings: Any,
) -> NDArray:
    """Return the tick of the packet that each robot holds, (frames * ticks, n); -1 for none."""
    own = [{"delay_frames": delay, **settings}] * len(faults)
    link = radio(own, faults, seeds, ticks_per_frame=ticks, initial_packet=(-1.0,))
    held = []
    for wait_for_frame in range(frames * ticks):
        link.send(np.full((len(faults), 1), float(wait_for_frame)))
        packet, _, age = link.deliver()
        np.testing.assert_array_equal(
            packet[:, 0], np.where(packet[:, 0] < 0, -1, wait_for_frame - age)
        )
        held.append(packet[:, 0])
    return np.array(held, int)
