"""Figure of the slip study: per robot the body's speed over the wheels', and their ratio over acceleration."""

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from omni_mj.config.settings import PERIOD_S
from omni_mj.studies.slip.slip_fits import follow
from omni_mj.viz import style
from omni_mj.viz.figures import plotting

if TYPE_CHECKING:
    from omni_mj.studies.slip import SlipResult

LOOKS = {"forward": (1, ".", "-"), "sideways": (0, "x", (0, (4, 1.5)))}  # slot, marker, line
TITLE = "Body against wheels in moves at 2 m/s²: samples, and the law that is fitted to them"
SHOWN_M_S = 0.2  # speed of the wheels above which the ratio is drawn


def save_slip_figure(result: "SlipResult", stem: Path) -> None:
    """Draw robots into `stem`.png: points are samples of moves, lines are the fitted law."""
    robots = result.robots
    with plotting.figure_file(stem, TITLE, figsize=(10, 3.6 * len(robots))) as figure:
        grid = figure.subplots(len(robots), 2, squeeze=False)
        for (speeds, ratios), (name, robot) in zip(grid, robots.items(), strict=True):
            kinds = np.array([move.kind for move in robot.moves])
            for kind, (slot, marker, dashes) in LOOKS.items():
                drawn = (kinds == kind) & ~np.isnan(robot.fitted["gain"])
                gain, time, colour = (
                    robot.measured[f"gain_{kind}"],
                    robot.measured[f"time_{kind}"],
                    style.colour(slot),
                )
                u, v = robot.wheels[:, drawn], robot.body[:, drawn]
                if drawn.any():  # the fastest shows the widest loop
                    fastest = u.max(0).argmax()
                    speeds.plot(
                        u[:, fastest], v[:, fastest], marker, ms=3, color=colour, label=kind
                    )
                    fitted = follow(gain, time, u[:, fastest], np.abs(u[:, fastest]))
                    speeds.plot(u[:, fastest], fitted, lw=1, color="k", label=f"{kind}, fitted")
                shown, ends = u > SHOWN_M_S, np.array([-2.5, 2.5])
                ratios.plot(
                    np.gradient(v, PERIOD_S, axis=0)[shown],
                    v[shown] / u[shown],
                    marker,
                    ms=3,
                    color=colour,
                )
                label = f"{kind}: K = {gain:.3f}, T = {time:.3f} s²/m"
                ratios.plot(ends, gain - time * ends, ls=dashes, color=colour, label=label)
            speeds.axline((0, 0), slope=1, ls=":", lw=1, color="0.6", label="without slip")
            speeds.set(
                title=name,
                xlabel="speed of the wheels u in m/s",
                ylabel="speed of the body v in m/s",
            )
            ratios.set(
                xlabel="acceleration of the body in m/s²",
                ylabel="v / u",
                xlim=(-3, 3),
                ylim=(0.5, 1.3),
            )
            speeds.legend()
            ratios.legend()
