"""Figure of a comparison: a heat map, or a panel per statistic for a single scenario."""

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure

from omni_control.kinematics import Array
from omni_mj.results.paired_comparison import mean_position_error
from omni_mj.results.text_table import DASH
from omni_mj.viz import plotting
from omni_mj.viz.seed_figure import draw_seed_statistics

Summary = dict[str, Any]
BASELINES = ("comp-flc", "flc")  # whose error is 1 in the color scale, if it was compared
MAX_RATIO = 10.0  # of errors, at the ends of the color scale
TICKS = (0.1, 0.2, 0.5, 1, 2, 5, 10)  # of the color scale
DARK_RATIO = 4.0  # beyond, cells are so dark that their text is white
CELL_IN = (1.1, 0.24)  # width and height of a cell


def save_comparison_figure(summary: Summary, stem: Path) -> None:
    """Draw a comparison into `stem`.png and `stem`.svg, if any of its scenarios has results."""
    entries = {name: entry for name, entry in summary["scenarios"].items() if entry["results"]}
    if not entries:
        return
    with plotting.figure_file(stem, svg=True) as figure:
        if len(entries) == 1:
            ((name, entry),) = entries.items()
            draw_seed_statistics(name, entry, summary["privileged"], figure)
        else:
            draw_heat_map(entries, summary["privileged"], figure)


def draw_heat_map(entries: dict[str, Summary], privileged: list[str], figure: Figure) -> None:
    """Draw the maximum position error of each controller in each scenario.

    The number in a cell is the error in cm, mean over the seeds. The color is its ratio to the
    error of a baseline controller in the same scenario. The least error of a scenario, privileged
    controllers aside, is bold.

    Args:
        entries: Entries of a summary, all with results, by scenario.
        privileged: Controllers that know the true state.
        figure: Empty figure.
    """
    controllers = list(dict.fromkeys(name for e in entries.values() for name in e["results"]))
    baseline = next(name for name in (*BASELINES, *controllers) if name in controllers)
    errors = _maximum_errors(entries, controllers)
    with np.errstate(invalid="ignore"):  # infinite over infinite, where both failed
        ratios = errors / errors[:, [controllers.index(baseline)]]
    width, height = CELL_IN
    figure.set_size_inches(3.2 + width * len(controllers), 1.7 + height * len(entries))
    axes = figure.subplots()
    image = axes.imshow(
        np.ma.masked_invalid(ratios),
        cmap="RdBu_r",
        norm=LogNorm(1 / MAX_RATIO, MAX_RATIO),
        aspect="auto",
    )
    is_privileged = np.array([name in privileged for name in controllers])
    _write_errors(axes, errors, ratios, is_privileged)
    labels = [name + "\n(privileged)" * (name in privileged) for name in controllers]
    axes.set_xticks(range(len(labels)), labels)
    axes.set_yticks(range(len(entries)), list(entries))
    axes.tick_params(length=0, labeltop=True, labelbottom=False)
    axes.grid(visible=False)
    label = f"error / error of {baseline}"
    figure.colorbar(image, ax=axes, label=label, ticks=TICKS, format="{x:g}").minorticks_off()
    n_seeds = max(len(entry["seeds"]) for entry in entries.values())
    figure.suptitle(
        f"Maximum position error in cm, mean over seeds (n = {n_seeds}); bold: least error"
    )


def _maximum_errors(entries: dict[str, Summary], controllers: list[str]) -> Array:
    """Return maximum position errors, (scenarios, controllers) m.

    An error is infinite if a seed failed, and NaN if the controller was not run.
    """
    errors = np.full((len(entries), len(controllers)), np.nan)
    for i, entry in enumerate(entries.values()):
        for name, result in entry["results"].items():
            errors[i, controllers.index(name)] = mean_position_error(result, "max")
    return errors


def _write_errors(axes: Axes, errors: Array, ratios: Array, is_privileged: np.ndarray) -> None:
    """Write each error in cm into its cell, the least of a scenario in bold."""
    lowest_errors = np.where(is_privileged | np.isnan(errors), np.inf, errors).min(axis=1)
    for (i, j), error in np.ndenumerate(errors):
        if np.isfinite(error):
            label = f"{100 * error:.2f}" if error < 0.1 else f"{100 * error:.1f}"
        else:
            label = DASH if np.isnan(error) else "failed"
        is_dark = abs(np.log(ratios[i, j])) > np.log(DARK_RATIO)
        is_best = error == lowest_errors[i] and not is_privileged[j]
        axes.text(
            j,
            i,
            label,
            ha="center",
            va="center",
            color="white" if is_dark else "black",
            weight="bold" if is_best else "normal",
        )
