"""Figures for tests: outcomes made by hand, and the figures drawn from them."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from benches.logs import failure, fill_log, rows
from omni_mj.config import PERIOD_S, scenario
from omni_mj.results import metrics, summary
from omni_mj.results.result import Outcome
from omni_mj.studies import compare_figure
from omni_mj.viz import run_figures, style

FRAMES, SPEED, ALPHA = 240, 0.5, 0.8
NAMES = "path", "command", "error", "alpha", "seeds"  # of the figures of a run with all data
TURN = 0.02  # heading error per cm of position error, rad


def make_outcome(
    controllers: Sequence[str] = ("c0", "c1"),
    n_seeds: int = 3,
    frames: int = FRAMES,
    ends: dict[int, int] | None = None,
    controller_channels: dict[str, NDArray] | None = None,
    **channels: Any,
) -> Outcome:
    """Return an outcome of robots that drive along x, then y, and achieve `ALPHA` of the command.

    Controller i has an offset of i cm, its seed j of 0.1 j cm more. `ends` maps a row to the
    frame in which it fails; `channels` replace those of the log.
    """
    log_rows = rows(controllers, range(n_seeds))
    count = len(controllers)
    off = 0.01 * np.repeat(np.arange(count), n_seeds) + 0.001 * np.tile(np.arange(n_seeds), count)
    velocity = np.where(np.arange(frames)[:, None] < FRAMES / 2, (SPEED, 0.0), (0.0, SPEED))
    ref = np.zeros((frames, len(log_rows), 3))
    ref[1:, :, :2] = (np.cumsum(velocity, axis=0)[:-1] * PERIOD_S)[:, None]
    command = np.zeros((frames, len(log_rows), 3))
    command[..., :2] = velocity[:, None] / ALPHA
    warm = (25 + 0.1 * np.arange(frames))[:, None, None]
    values = {
        "ref": ref, "pose": ref + np.stack([off, off, 100 * TURN * off], axis=-1),
        "command": command,
        "applied": command, "alpha_hat": 0.9, "winding": warm, "housing": warm,
    }  # fmt: skip
    lengths = [(ends or {}).get(row, frames) for row in range(len(log_rows))]
    log = fill_log(log_rows, frames, lengths, controller_channels, **values | channels)
    failures = [failure(log, row) for row in ends or {}]
    chosen = scenario.load_with_overrides("rect", (), {"plant": "kinematic"})
    measured = metrics.row_metrics(log, failures)
    entry = summary.scenario_entry(chosen, log, failures, measured, 0.0, None, {})
    return Outcome(chosen, entry, log_rows, failures, measured, log)


def draw_figures(outcome: Outcome, *names: str) -> dict[str, Figure]:
    """Return figures of an outcome by name, all if none is named."""
    results = {}
    with rc_context(fname=style.STYLE_SHEET):
        functions = run_figures.choose_figures(outcome)
        for name in names or functions:
            functions[name](results.setdefault(name, Figure()))
    return results


def draw_comparison(entries: dict[str, Any], privileged: Sequence[str] = ()) -> Figure:
    """Return the heat map of entries of a summary."""
    with rc_context(fname=style.STYLE_SHEET):
        figure = Figure()
        compare_figure.draw_heat_map(entries, list(privileged), figure)
        figure.draw_without_rendering()
    return figure


def line_values(axes: Axes, label: str) -> list[NDArray]:
    """Return the y-values of the lines with a label."""
    return [
        np.asarray(line.get_ydata(), float)
        for line in axes.get_lines()
        if line.get_label() == label
    ]


def line_styles(controllers: Sequence[str]) -> list[dict[str, Any]]:
    """Return the line properties of the controllers of a run."""
    return [style.line_style(slot) for slot in style.style_indices(controllers).values()]
