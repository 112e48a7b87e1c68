"""Box plots of the errors over the seeds."""

import numpy as np
from matplotlib.figure import Figure

from omni_mj.measure import metrics
from omni_mj.show import style
from omni_mj.show.figures import canvas
from omni_mj.simulate.log import Trajectory

FEWEST = 3  # seeds that make a box
MOST_DOTS = 60  # seeds beyond which single ones are not shown
STATISTICS = {"max": "maximum", "mean": "mean"}


def seeds(trajectory: Trajectory, paper: dict[str, dict[str, dict[str, float]]] | None) -> Figure:
    """Maximum and mean error of each controller and axis: a box from quartile to quartile, whiskers to the ends."""
    statistics = metrics.error_statistics(trajectory)
    names = trajectory.controllers
    figure = Figure(figsize=(8, 1.6 + 2 * 0.36 * (len(names) + 1)))
    grid = figure.subplots(2, 2, sharey=True)
    rows = np.arange(len(names))[::-1]
    spread = 0.16 * np.linspace(-1, 1, len(trajectory.seeds))  # one seed keeps its height in all boxes
    for (key, label), line in zip(STATISTICS.items(), grid, strict=True):
        for j, axes in enumerate(line):
            values = 100 * statistics[key][:, :, j]
            boxes = axes.boxplot(
                list(values), positions=rows, orientation="horizontal", widths=0.55, whis=(0, 100), showfliers=False,
                patch_artist=True, medianprops={"color": "black", "linewidth": 1.6}, zorder=2,
            )  # fmt: skip
            for i, box in enumerate(boxes["boxes"]):
                box.set(facecolor=style.controller(i) + "55", edgecolor=style.controller(i))
                if len(trajectory.seeds) <= MOST_DOTS:
                    axes.plot(values[i], rows[i] + spread, "o", ms=3, mew=0, color="#333333", zorder=3,
                              label="a seed" if i == 0 else None)  # fmt: skip
                if paper and names[i] in paper:
                    axes.plot(100 * paper[names[i]][metrics.AXES[j]][key], rows[i], "D", ms=6, mec="black", mfc="white",
                              zorder=4, label="the paper" if i == 0 else None)  # fmt: skip
            axes.set_yticks(rows, names)
            axes.margins(x=0.05)
            axes.set_xlim(left=0)
            axes.grid(axis="y", visible=False)
            axes.set_xlabel(f"{label} |error| in ${metrics.AXES[j]}$ in cm")
    canvas.legend(figure, grid[0, 0])
    figure.suptitle(f"Errors over {len(trajectory.seeds)} seeds")
    return figure
