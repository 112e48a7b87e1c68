"""The figure of the slip study: a line of two pictures a robot, the body's speed over the wheels' and their ratio."""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from matplotlib import style as matplotlib_style
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from omni_mj.scenarios.settings import PERIOD_S
from omni_mj.show import style
from omni_mj.show.figures import canvas
from omni_mj.studies.slip.fits import Law, follow

if TYPE_CHECKING:
    from omni_mj.studies.slip.figures import Robot

LOOKS = {"forward": ("#0072B2", ".", "-"), "sideways": ("#D55E00", "x", (0, (4, 1.5)))}  # colour, marker, line
LAW = "the fitted law"
SHOWN_M_S = 0.2  # of the wheels, above which the ratio is drawn


def save(robots: "Mapping[str, Robot]", path: Path) -> None:
    """Draw robots into a PNG: points are samples of moves, lines are the fitted law."""
    with matplotlib_style.context(style.SHEET):
        figure = Figure(figsize=(10, 3.6 * len(robots)))
        for line, robot in zip(figure.subplots(len(robots), 2, squeeze=False), robots.values(), strict=True):
            _speeds(line[0], robot)
            _ratios(line[1], robot)
        canvas.title(figure, "Body against wheels in moves at 2 m/s²: samples, and the law that is fitted to them")
        canvas.save_png(figure, path)


def _speeds(axes: Axes, robot: "Robot") -> None:
    """Draw v over u of the fastest moves, whose loops are widest."""
    for kind, (colour, marker, _) in LOOKS.items():
        moves = _moves(robot, kind)
        fastest = max(moves, key=lambda i: robot.moves[i].speed, default=None)
        if fastest is None:
            continue
        u, v = robot.wheels[:, fastest], robot.body[:, fastest]
        law = Law(robot.measured[f"gain_{kind}"], robot.measured[f"time_{kind}"])
        axes.plot(u, v, marker, ms=3, color=colour, label=kind)
        axes.plot(
            u, follow(law, u, np.abs(u), PERIOD_S), "-", lw=1, color="k", label=LAW if kind == "forward" else None
        )
    axes.axline((0, 0), slope=1, ls=":", lw=1, color="0.6", label="without slip")
    axes.margins(x=0.03)
    axes.set(title=robot.name, xlabel="speed of the wheels u in m/s", ylabel="speed of the body v in m/s")
    axes.legend()


def _ratios(axes: Axes, robot: "Robot") -> None:
    """Draw v / u over the body's acceleration a, which by the law is K - T a."""
    for kind, (colour, marker, dashes) in LOOKS.items():
        moves = _moves(robot, kind)
        u, v = robot.wheels[:, moves], robot.body[:, moves]
        acceleration = np.gradient(v, PERIOD_S, axis=0)
        shown = u > SHOWN_M_S
        axes.plot(acceleration[shown], (v / np.where(shown, u, 1))[shown], marker, ms=3, color=colour)
        ends = np.array([-2.5, 2.5])
        gain, time = robot.measured[f"gain_{kind}"], robot.measured[f"time_{kind}"]
        label = f"{kind}: K = {gain:.3f}, T = {time:.3f} s²/m"
        axes.plot(ends, gain - time * ends, ls=dashes, lw=1.2, color=colour, label=label)
    axes.set(xlabel="acceleration of the body in m/s²", ylabel="v / u", xlim=(-3, 3), ylim=(0.5, 1.3))
    axes.legend()


def _moves(robot: "Robot", kind: str) -> list[int]:
    """Numbers of the moves to which the law was fitted."""
    return [i for i, move in enumerate(robot.moves) if move.kind == kind and not np.isnan(robot.fitted["gain"][i])]
