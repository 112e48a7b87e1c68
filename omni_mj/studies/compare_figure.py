"""Figure of a comparison: a heat map, or a panel per statistic for a single scenario."""

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure

from omni_control.kinematics import Array
from omni_mj.results.paired_comparison import mean_position_error
from omni_mj.results.result_tables import Summary
from omni_mj.results.summary import Entry
from omni_mj.results.text_table import DASH
from omni_mj.viz import figure_helpers
from omni_mj.viz.seed_figure import draw_seed_statistics

BASELINE = "comp-flc"  # has the ratio 1; the first controller if this one was not run
MAX_RATIO = 10.0  # error over the baseline's error at the upper end of the color scale
TICKS = (0.1, 0.2, 0.5, 1, 2, 5, 10)  # ratios labeled on the color scale
DARK_RATIO = 4.0  # ratio beyond which a cell is so dark that its text is white
CELL_SIZE = (1.1, 0.24)  # width and height, inches


def save_comparison_figure(summary: Summary, stem: Path) -> None:
    """Draw a comparison into `stem`.png and `stem`.svg, if any of its scenarios has results."""
    entries = {name: entry for name, entry in summary["scenarios"].items() if entry["results"]}
    if not entries:
        return
    with figure_helpers.figure_file(stem, svg=True) as figure:
        if len(entries) == 1:
            ((name, entry),) = entries.items()
            draw_seed_statistics(name, entry, summary["privileged"], figure)
        else:
            draw_heat_map(entries, summary["privileged"], figure)


def draw_heat_map(entries: dict[str, Entry], privileged: list[str], figure: Figure) -> None:
    """Draw the errors of all controllers in all scenarios as a heat map.

    A cell shows the maximum position error in a run, in cm, averaged over the seeds. Its color
    shows the ratio to the error of `BASELINE` in the same scenario. The smallest error of
    each scenario is bold; privileged controllers do not count. Scenarios keep their order, with
    those of faults at the end.

    Args:
        entries: Mapping from scenario name to its entry in a summary, all with results.
        privileged: Names of the controllers that know the true state.
        figure: Empty figure.
    """
    scenarios = sorted(entries, key=lambda name: name.startswith("fault"))
    controllers = list(dict.fromkeys(name for e in entries.values() for name in e["results"]))
    baseline = BASELINE if BASELINE in controllers else controllers[0]
    # Errors in m: infinite if a seed failed, NaN if the controller was not run
    errors = np.full((len(scenarios), len(controllers)), np.nan)
    for i, scenario in enumerate(scenarios):
        for name, result in entries[scenario]["results"].items():
            errors[i, controllers.index(name)] = mean_position_error(result, "max")
    finite_errors = np.where(np.isfinite(errors), errors, np.nan)
    ratios = finite_errors / finite_errors[:, [controllers.index(baseline)]]
    width, height = CELL_SIZE
    figure.set_size_inches(3.2 + width * len(controllers), 1.7 + height * len(scenarios))
    axes = figure.subplots()
    image = axes.imshow(
        ratios,
        cmap="RdBu_r",
        norm=LogNorm(1 / MAX_RATIO, MAX_RATIO),
        aspect="auto",
    )
    is_privileged = np.array([name in privileged for name in controllers])
    _write_errors(axes, errors, ratios, is_privileged)
    labels = [f"{name}\n(privileged)" if name in privileged else name for name in controllers]
    axes.set_xticks(range(len(labels)), labels)
    axes.set_yticks(range(len(scenarios)), scenarios)
    axes.tick_params(length=0, labeltop=True, labelbottom=False)
    axes.grid(visible=False)
    label = f"error / error of {baseline}"
    figure.colorbar(image, ax=axes, label=label, ticks=TICKS, format="{x:g}").minorticks_off()
    n_seeds = max(len(entry["seeds"]) for entry in entries.values())
    figure.suptitle(
        f"Maximum position error in cm, mean over seeds (n = {n_seeds}); bold: smallest error"
    )


def _write_errors(axes: Axes, errors: Array, ratios: Array, is_privileged: np.ndarray) -> None:
    """Write each error into its cell, the smallest of a scenario in bold.

    Errors that look equal after rounding are bold together.

    Args:
        axes: Axes of the heat map.
        errors: Errors, infinite or NaN without one, (scenarios, controllers) m.
        ratios: Errors over the baseline's error, NaN where the cell has no color, same shape.
        is_privileged: Whether a controller knows the true state, (controllers,).
    """
    smallest_errors = np.where(is_privileged | np.isnan(errors), np.inf, errors).min(axis=1)
    for (i, j), error in np.ndenumerate(errors):
        label = _format_error(error)
        is_smallest = np.isfinite(error) and label == _format_error(smallest_errors[i])
        is_dark = abs(np.log(ratios[i, j])) > np.log(DARK_RATIO)
        axes.text(
            j,
            i,
            label,
            ha="center",
            va="center",
            color="white" if is_dark else "black",
            weight="bold" if is_smallest and not is_privileged[j] else "normal",
        )


def _format_error(error: float) -> str:
    """Return an error in m as text in cm."""
    if np.isnan(error):
        return DASH
    if np.isinf(error):
        return "failed"
    return f"{100 * error:.2f}" if error < 0.1 else f"{100 * error:.1f}"
