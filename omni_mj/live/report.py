"""What a live run tells of robots and of the link: while it goes on, and in the end."""

import warnings
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from omni_control.kinematics import Array
from omni_mj.live import answer
from omni_mj.live.drive import Live
from omni_mj.live.link import SAME_RATE
from omni_mj.scenarios.settings import FRAME_RATE_HZ


def found(live: Live) -> list[str]:
    """A line for each robot: latency and alpha as its controller has identified them so far."""
    lines = []
    for number, latency, alpha in zip(live.ids, live.team.latency_hat, live.team.alpha_hat, strict=True):
        if np.isfinite(latency).all():
            frames, ms = _row(latency, 2), _row(1e3 * latency / FRAME_RATE_HZ, 0)
            lines.append(f"robot {number}: latency {frames} frames ({ms} ms), alpha {_row(alpha, 2)}")
    return lines


def summary(live: Live) -> dict[str, Any]:
    """What link.json holds: of vision, of the ticks, of what went wrong, and how robots answer."""
    vision = live.link.vision
    half = slice(live.log.length // 2, None)  # when what was identified has settled
    robots = []
    for row, (number, overall) in enumerate(zip(live.ids, answer.run(live), strict=True)):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", RuntimeWarning)  # means of nothing
            latency, alpha = (
                np.nanmean(live.log.channel(name)[half, row], axis=0) for name in ("latency_hat", "alpha_hat")
            )
        identified = {"latency_frames": _plain(latency), "alpha": _plain(alpha)} if np.isfinite(latency).all() else None
        fitted = {"latency_frames": _plain(np.array(overall.latency)), "alpha": _plain(np.array(overall.gain))}
        robots.append({"id": number, "identified": identified, "fitted": fitted})
    cameras = {
        str(number): {
            "frames": camera.frames, "lost": camera.lost, "late": camera.late, "restarts": camera.clock.restarts,
            "stamped_hz": _plain(np.array(camera.stamped_hz)), "received_hz": _plain(np.array(camera.received_hz)),
            "mean_age_s": camera.age_s, "bias_m_m_rad": _plain(camera.bias),
        }
        for number, camera in sorted(vision.cameras.items())
    }  # fmt: skip
    link = live.link
    ticks = {
        "with_frames": link.with_frames, "camera": link.leader, "late": link.late, "missing": link.missing,
        "answered_after_s": dict(zip(("p50", "p95", "p99", "max"), _percentiles(link.answers), strict=True)),
    }  # fmt: skip
    source = None if vision.source is None else vision.source.name
    return {"source": source, "cameras": cameras, "ticks": ticks, "robots": robots, "notes": dict(live.notes.counts)}


def told(summary: Mapping[str, Any]) -> list[str]:
    """What is said in the end of ticks and of each robot."""
    late = summary["ticks"]["answered_after_s"]
    lines = []
    if late["p50"] is not None:
        times = ", ".join(f"{name} {1e3 * value:.1f}" for name, value in late.items())
        lines.append(f"commands left so many ms after each tick: {times}")
    ticks = summary["ticks"]
    hz = summary["cameras"][str(ticks["camera"])]["stamped_hz"] if ticks["with_frames"] else None
    if hz is not None and abs(hz / FRAME_RATE_HZ - 1) > SAME_RATE:
        lines.append(
            f"each frame of camera {ticks['camera']} was a tick, and it sent {hz:.1f} a second: all was driven "
            f"{hz / FRAME_RATE_HZ:.2f} times as fast; --rate {FRAME_RATE_HZ} goes by this computer's clock"
        )
    for robot in summary["robots"]:
        parts = []
        if robot["fitted"]["latency_frames"] is not None:
            frames = robot["fitted"]["latency_frames"]
            ms = 1e3 * frames / FRAME_RATE_HZ
            parts.append(f"answers {frames:.2f} frames ({ms:.0f} ms) later, with {robot['fitted']['alpha']:.2f} of it")
        if robot["identified"] is not None:
            latency, alpha = (np.array(robot["identified"][name], float) for name in ("latency_frames", "alpha"))
            parts.append(
                f"identified: latency {_row(latency, 2)} frames, alpha {_row(alpha, 2)} (forward, left, turning)"
            )
        lines.append(f"robot {robot['id']}: {'; '.join(parts) or 'did not move'}")
    return lines


def _percentiles(values: Sequence[float]) -> list[float | None]:
    if not values:
        return [None] * 4
    return [round(float(each), 6) for each in (*np.percentile(values, [50, 95, 99]), max(values))]


def _row(values: Array, digits: int) -> str:
    return " ".join(f"{each:.{digits}f}" for each in values)


def _plain(values: Array) -> Any:
    """Numbers as JSON has them: nothing is not a number."""
    if values.ndim:
        return [_plain(each) for each in values]
    return round(float(values), 6) if np.isfinite(values) else None
