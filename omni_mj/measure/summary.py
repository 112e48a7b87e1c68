"""summary.json: what was run and what came out, every figure of it recomputable from trajectory.parquet."""

import dataclasses
import json
import platform
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from omni_mj.measure import metrics, paper
from omni_mj.measure.events import Event
from omni_mj.scenarios.scenario import Scenario
from omni_mj.scenarios.settings import PERIOD_S
from omni_mj.simulate.log import Trajectory

DEFINITIONS = {
    "error_m": "absolute difference of x_m and ref_x_m over all frames of a seed; median, min, max over seeds",
    "alpha": (
        f"(x_m[k+n] - x_m[k]) / (T sum of applied_vx_m_s[k:k+n]) with n = {metrics.ALPHA_WINDOW_FRAMES}, T = 1/60 s;"
        " percentiles over all seeds and those k where the magnitude of applied_vx_m_s[k:k+n]'s mean is above"
        f" {metrics.ALPHA_MIN_SPEED_M_S} m/s"
    ),
    "peak": (
        "over all seeds the largest of voltage_peak_v and current_peak_a, which cover every physics step and motor, and"
        " of winding_1_c to winding_4_c"
    ),
    "events": "the first frame of each kind, controller and seed",
    "reduction_percent": "100 (1 - median of this controller / median of the first controller)",
}


def summarise(
    scenario: Scenario, trajectory: Trajectory, events: list[Event], wall_s: float, stopped: str | None
) -> dict[str, Any]:
    """The summary of a run; `stopped` says why it ended early, or is None."""
    return {
        "scenario": scenario.name,
        "description": scenario.description,
        "plant": scenario.plant,
        "controllers": list(scenario.labels),
        "seeds": scenario.seed_list,
        "complete": stopped is None,
        "stopped": stopped,
        "frames": trajectory.length,
        "simulated_s": trajectory.length * PERIOD_S,
        "wall_s": round(wall_s, 3),
        "results": _results(scenario, trajectory) if trajectory.length else {},
        "events": [dataclasses.asdict(event) for event in events],
        "paper": paper.TABLES.get(scenario.paper_table),
        "definitions": DEFINITIONS,
        "settings": scenario.settings.plain(),
        "versions": versions(),
    }


def _results(scenario: Scenario, trajectory: Trajectory) -> dict[str, Any]:
    statistics = metrics.error_statistics(trajectory)
    alpha = metrics.alpha_percentiles(trajectory) if trajectory.length > metrics.ALPHA_WINDOW_FRAMES else None
    results: dict[str, Any] = {}
    for i, controller in enumerate(scenario.labels):
        error: dict[str, Any] = {}
        reduction: dict[str, Any] = {}
        for j, axis in enumerate(metrics.AXES):
            error[axis] = {name: _spread(values[i, :, j]) for name, values in statistics.items()}
            base = {name: float(np.median(values[0, :, j])) for name, values in statistics.items()}
            reduction[axis] = {
                name: 100 * (1 - error[axis][name]["median"] / base[name]) if base[name] else None for name in base
            }
        results[controller] = {
            "error_m": error,
            "reduction_percent": reduction if i else None,
            "alpha": alpha[i] if alpha else None,
            "peak_voltage_v": _peak(trajectory.channel("voltage_peak")[:, i]),
            "peak_current_a": _peak(trajectory.channel("current_peak")[:, i]),
            "peak_winding_c": _peak(trajectory.channel("winding")[:, i]),
        }
    return results


def _spread(values: np.ndarray) -> dict[str, float]:
    return {"median": float(np.median(values)), "min": float(values.min()), "max": float(values.max())}


def _peak(values: np.ndarray) -> float | None:
    return None if np.isnan(values).all() else float(np.nanmax(values))


def versions() -> dict[str, str]:
    """Versions of Python and of the packages that decide the result."""
    packages = ("omni-mj", "mujoco", "numpy", "rerun-sdk", "pyarrow")
    return {"python": platform.python_version()} | {name: version(name) for name in packages}


def save(summary: dict[str, Any], path: Path) -> None:
    """Write the summary as strict JSON (no NaN)."""
    path.write_text(json.dumps(summary, indent=2, allow_nan=False) + "\n", encoding="utf-8")
