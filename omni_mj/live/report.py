"""What a live run says of robots and of the link: while it goes on, and at the end."""

import json
import warnings
from collections.abc import Mapping
from typing import Any

import numpy as np
import pydantic_core

from omni_control.kinematics import Array
from omni_mj.live.drive import Live
from omni_mj.live.latency import measure_run
from omni_mj.scenarios.settings import FRAME_RATE_HZ

CAMERA_FIGURES = "frames", "lost", "late", "restarts", "stamped_hz", "received_hz", "mean_age_s", "bias_m_m_rad"


def describe_estimates(live: Live) -> list[str]:
    """Return a line for each robot: latency and alpha as its controller has identified them so far."""
    lines = []
    for number, latency, alpha in zip(live.ids, live.team.latency_hat, live.team.alpha_hat, strict=True):
        if np.isfinite(latency).all():
            ms = _join(1e3 * latency / FRAME_RATE_HZ, 0)
            lines.append(f"robot {number}: latency {_join(latency, 2)} frames ({ms} ms), alpha {_join(alpha, 2)}")
    return lines


def summarize(live: Live) -> dict[str, Any]:
    """Return the content of link.json: vision, ticks, what went wrong, and how robots respond."""
    link, log = live.link, live.log
    second_half = slice(log.length // 2, None)  # estimates have settled by then
    robots = []
    for row, (number, response) in enumerate(zip(live.ids, measure_run(live), strict=True)):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", RuntimeWarning)  # means of nothing
            latency, alpha = (log.channel(name)[second_half, row] for name in ("latency_hat", "alpha_hat"))
            estimates = {"latency_frames": np.nanmean(latency, 0), "alpha": np.nanmean(alpha, 0)}
        is_known = np.isfinite(estimates["latency_frames"]).all()
        fitted = {"latency_frames": response.latency, "alpha": response.gain}
        robots.append({"id": number, "identified": estimates if is_known else None, "fitted": fitted})
    cameras = {
        str(number): {figure: getattr(camera, figure) for figure in CAMERA_FIGURES}
        for number, camera in sorted(link.vision.cameras.items())
    }
    answers = np.percentile(link.answers, [50, 95, 99, 100]) if link.answers else np.full(4, np.nan)
    ticks = {
        "with_frames": link.follows_frames,
        "camera": link.leader,
        "late": link.late,
        "missing": link.missing,
        "answered_after_s": dict(zip(("p50", "p95", "p99", "max"), answers, strict=True)),
    }
    counts = dict(live.notes.counts)
    summary = {"cameras": cameras, "ticks": ticks, "robots": robots, "notes": counts}
    text = pydantic_core.to_json(summary, inf_nan_mode="null", fallback=np.ndarray.tolist)
    return dict(json.loads(text))


def describe(summary: Mapping[str, Any]) -> list[str]:
    """Return lines on ticks and on each robot at the end."""
    lines, ticks = [], summary["ticks"]
    if ticks["answered_after_s"]["p50"] is not None:
        times = ", ".join(f"{name} {1e3 * value:.1f}" for name, value in ticks["answered_after_s"].items())
        lines.append(f"commands left so many ms after each tick: {times}")
    for robot in summary["robots"]:
        parts, fitted, identified = [], robot["fitted"], robot["identified"]
        if (latency := fitted["latency_frames"]) is not None:
            ms = 1e3 * latency / FRAME_RATE_HZ
            parts.append(f"answers {latency:.2f} frames ({ms:.0f} ms) later, with {fitted['alpha']:.2f} of it")
        if identified is not None:
            latencies, alphas = (_join(np.array(identified[name], float), 2) for name in ("latency_frames", "alpha"))
            parts.append(f"identified: latency {latencies} frames, alpha {alphas} (forward, left, turning)")
        lines.append(f"robot {robot['id']}: {'; '.join(parts) or 'did not move'}")
    return lines


def _join(values: Array, digits: int) -> str:
    return " ".join(f"{value:.{digits}f}" for value in values)
