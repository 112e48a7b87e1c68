"""The lines of a recording's plots: what they show, where they are, how they look."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np
import rerun as rr

from omni_control.kinematics import Array
from omni_mj.scenarios.settings import FRAME_RATE_HZ
from omni_mj.show.recording import colours
from omni_mj.show.recording.robots import Robot, Track
from omni_mj.show.recording.timelines import Frames

Values = Callable[[Track, Frames], Array]


@dataclass(frozen=True)
class Series:
    """Lines of a plot that share an entity.

    Args:
        values: maps a track and successive frames (n,) to values (n, lines); not a number where there are none.
        lines: their names; empty if there is nothing to tell apart.
        channel: of the log; where it holds no numbers there is nothing to plot.
        entity: below that of the plot and robot, if these have several.
        pale: share of white in the colours of the first lines, with which the others are compared.
    """

    values: Values
    lines: tuple[str, ...] = ("",)
    channel: str = "pose"
    entity: str = ""
    pale: tuple[float, ...] = ()


@dataclass(frozen=True)
class Plot:
    """What is plotted together.

    Args:
        entity: below plots/; the robots are below it.
        title: what it shows.
        unit: of its values.
        series: of each robot.
        range: of the axis, or None to fit the data.
        legend: its corner.
        by_wheel: whether the lines are of wheels, each in a colour of its own; else they have the robot's.
    """

    entity: str
    title: str
    unit: str
    series: tuple[Series, ...]
    range: tuple[float, float] | None = None
    legend: Literal["RightTop", "RightBottom"] = "RightTop"
    by_wheel: bool = False


@dataclass(frozen=True)
class Drawn:
    """A series as it is drawn of one robot.

    Args:
        plot, series: what it shows.
        robot: whose it is.
        by_wheel: a colour per wheel, instead of the robot's; so many wheels.
    """

    plot: Plot
    series: Series
    robot: Robot
    by_wheel: int = 0

    @property
    def entity(self) -> str:
        """Where it is in the recording."""
        return f"plots/{self.plot.entity}/{self.robot.name}/{self.series.entity}".rstrip("/")

    def style(self) -> rr.SeriesLines:
        """Names with unit and rate, colours, widths."""
        lines, rate = self.series.lines, f"{FRAME_RATE_HZ} Hz"
        name = "" if self.by_wheel else self.robot.name
        unit = f"({self.plot.unit}, {rate})" if self.plot.unit else f"({rate})"
        white = [*self.series.pale, *[0.0] * (len(lines) - len(self.series.pale))]
        hues = [colours.of(i % self.by_wheel) if self.by_wheel else self.robot.colour for i in range(len(lines))]
        return rr.SeriesLines(
            names=[" ".join(filter(None, (name, line, unit))) for line in lines],
            colors=[colours.pale(hue, share) for hue, share in zip(hues, white, strict=True)],
            widths=[0.8 if share else 1.5 for share in white],
        )

    def columns(self, track: Track, frames: Frames) -> rr.ComponentColumnList:
        """Values in `frames`; where they are not numbers none, which leaves a gap (two NaN would not compare equal)."""
        values = self.series.values(track, frames)
        known = ~np.isnan(values).any(1)
        return rr.Scalars.columns(scalars=values[known].ravel()).partition(known * values.shape[1])
