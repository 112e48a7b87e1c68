"""The figure of the alpha study: maps over friction and winding temperature, per battery charge and phase."""

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure

if TYPE_CHECKING:
    from omni_mj.studies.alpha import Study


def save(study: "Study", path: Path) -> None:
    """Draw the study into a PNG: rows are phases, columns charges, for the middle value of lint; below, the trends."""
    figure = Figure(figsize=(10, 9), layout="constrained")
    maps = figure.subplots(3, 3)
    friction, winding, charge, lint = study.conditions.values()
    low, high = 0.6, 1.02
    for row, phase in zip(maps, ("accelerating", "cruising"), strict=False):
        mean = study.phase(phase).mean((-2, -1))[..., len(lint) // 2]
        for j, axes in enumerate(row):
            image = axes.imshow(mean[:, :, j].T, origin="lower", cmap="viridis", vmin=low, vmax=high, aspect="auto")
            for (x, y), value in np.ndenumerate(mean[:, :, j]):
                axes.text(x, y, f"{value:.2f}", ha="center", va="center", fontsize=8, color="w" if value < 0.9 else "k")
            axes.set_xticks(range(len(friction)), [f"{f:g}" for f in friction])
            axes.set_yticks(range(len(winding)), [f"{t:g}" for t in winding])
            axes.set_title(f"{phase}, battery {100 * charge[j]:.0f} %", fontsize=9)
            axes.set_xlabel("carpet friction")
        row[0].set_ylabel("winding in deg C")
        figure.colorbar(image, ax=row, label="alpha")
    names = {"friction": "carpet friction", "winding_c": "winding in deg C", "lint": "lint (share of the load)"}
    for axes, (name, label) in zip(maps[2], names.items(), strict=True):
        axes.plot(study.conditions[name], study.trend(name), "o-", color="#0072B2")
        axes.set_xlabel(label)
        axes.grid(alpha=0.3)
    maps[2, 0].set_ylabel("mean alpha over all else")
    figure.suptitle("alpha: displacement achieved / commanded; ramp of 3 m/s² to 1.5 m/s, mean of x, y and diagonal")
    figure.savefig(path, dpi=130)
