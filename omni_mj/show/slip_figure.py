"""Figure of the slip study: per robot the body's speed over the wheels', and their ratio over acceleration."""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from omni_mj.scenarios.settings import PERIOD_S
from omni_mj.show import style
from omni_mj.show.figures import canvas
from omni_mj.studies.slip.fits import Law, follow

if TYPE_CHECKING:
    from omni_mj.studies.slip.figures import Robot

LOOKS = {"forward": (1, ".", "-"), "sideways": (0, "x", (0, (4, 1.5)))}  # slot, marker, line
TITLE = "Body against wheels in moves at 2 m/s²: samples, and the law that is fitted to them"
SHOWN_M_S = 0.2  # speed of the wheels above which the ratio is drawn


def save(robots: "Mapping[str, Robot]", path: Path) -> None:
    """Draw robots into a PNG: points are samples of moves, lines are the fitted law."""
    with canvas.drawing(path.with_suffix(""), TITLE, figsize=(10, 3.6 * len(robots))) as figure:
        grid = figure.subplots(len(robots), 2, squeeze=False)
        for (speeds, ratios), robot in zip(grid, robots.values(), strict=True):
            for kind, (slot, marker, dashes) in LOOKS.items():
                moves = [k for k, move in enumerate(robot.moves) if move.kind == kind]
                moves = [k for k in moves if not np.isnan(robot.fitted["gain"][k])]
                gain, time, colour = robot.measured[f"gain_{kind}"], robot.measured[f"time_{kind}"], style.colour(slot)
                if moves:  # the fastest shows the widest loop
                    fastest = max(moves, key=lambda k: robot.moves[k].speed)
                    u, v = robot.wheels[:, fastest], robot.body[:, fastest]
                    speeds.plot(u, v, marker, ms=3, color=colour, label=kind)
                    speeds.plot(u, follow(Law(gain, time), u, np.abs(u), PERIOD_S), lw=1, color="k",
                                label="the fitted law" if kind == "forward" else None)  # fmt: skip
                u, v = robot.wheels[:, moves], robot.body[:, moves]
                shown = u > SHOWN_M_S
                ratios.plot(np.gradient(v, PERIOD_S, axis=0)[shown], v[shown] / u[shown], marker, ms=3, color=colour)
                ends = np.array([-2.5, 2.5])
                label = f"{kind}: K = {gain:.3f}, T = {time:.3f} s²/m"
                ratios.plot(ends, gain - time * ends, ls=dashes, color=colour, label=label)
            speeds.axline((0, 0), slope=1, ls=":", lw=1, color="0.6", label="without slip")
            speeds.margins(x=0.03)
            speeds.set(title=robot.name, xlabel="speed of the wheels u in m/s", ylabel="speed of the body v in m/s")
            ratios.set(xlabel="acceleration of the body in m/s²", ylabel="v / u", xlim=(-3, 3), ylim=(0.5, 1.3))
            speeds.legend()
            ratios.legend()
