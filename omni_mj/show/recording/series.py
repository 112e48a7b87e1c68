"""The time series of a recording: what is plotted, under which name and unit, and how it follows from a trajectory."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Literal

import numpy as np
import rerun as rr

from omni_control.kinematics import Array, Kinematics, world_to_body
from omni_mj.measure.metrics import ALPHA_WINDOW_FRAMES, alpha_windows
from omni_mj.scenarios.settings import FRAME_RATE_HZ, PERIOD_S
from omni_mj.show.recording import colours
from omni_mj.simulate.log import Trajectory
from omni_mj.worlds import build

WHEELS = ("front left", "rear left", "rear right", "front right")


@dataclass(frozen=True)
class Track:
    """What one controller did with a run's first seed, as far as it is recorded.

    Args:
        trajectory: of the run.
        controller: its index in there.
    """

    trajectory: Trajectory
    controller: int

    def __getitem__(self, channel: str) -> Array:
        """A channel's frames (frames, columns)."""
        return self.trajectory.channel(channel)[:, self.controller, 0]


Values = Callable[[Track, Array], Array]


@dataclass(frozen=True)
class Series:
    """Lines of a plot that share an entity.

    Args:
        values: maps a track and successive frames (n,) to values (n, lines); not a number where there are none.
        lines: their names; empty if there is nothing to tell apart.
        channel: of the trajectory; where it holds no numbers there is nothing to plot.
        entity: below that of the plot and controller, if these have several.
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
        entity: below plots/; the controllers are below it.
        title: what it shows.
        unit: of its values.
        series: of each controller.
        range: of the axis, or None to fit the data.
        legend: its corner.
    """

    entity: str
    title: str
    unit: str
    series: tuple[Series, ...]
    range: tuple[float, float] | None = None
    legend: Literal["RightTop", "RightBottom"] = "RightTop"


def _column(channel: str) -> Values:
    return lambda track, frames: track[channel][frames]


def _error(axis: int, scale: float) -> Values:
    return lambda track, frames: scale * (track["pose"][frames] - track["ref"][frames])[:, axis, None]


def _ahead(track: Track, frames: Array) -> Array:
    x, y = (track["predicted"][frames] - track["pose"][frames])[:, :2].T
    return 100 * np.hypot(x, y)[:, None]


def _velocity(axis: int) -> Values:
    """What was sent, what arrived at the robot, and what was achieved since the frame before."""

    def values(track: Track, frames: Array) -> Array:
        pose = track["pose"][:, axis]
        achieved = (pose[frames] - pose[np.maximum(frames - 1, 0)]) / PERIOD_S
        return np.stack([track["command"][frames, axis], track["applied"][frames, axis], achieved], axis=1)

    return values


def _true_alpha(axis: int) -> Values:
    """Alpha of the window that ends in a frame."""

    def values(track: Track, frames: Array) -> Array:
        seen = slice(max(frames[0] - ALPHA_WINDOW_FRAMES, 0), frames[-1] + 1)
        alpha = np.full((len(frames), 1), np.nan)
        if seen.stop - seen.start > ALPHA_WINDOW_FRAMES:
            windows = alpha_windows(track["pose"][seen, axis], track["applied"][seen, axis])
            alpha[-len(windows) :, 0] = windows
        return alpha

    return values


@lru_cache(maxsize=1)
def _kinematics() -> Kinematics:
    return build.world().kinematics


def _wheel_speed(track: Track, frames: Array) -> Array:
    """Speeds at which the wheels would roll without slip as the command asks that arrived, and their true ones."""
    twist = world_to_body(track["applied"][frames], track["pose"][frames, 2])
    return np.concatenate([_kinematics().wheel_speeds(twist), track["wheel_speed"][frames]], axis=1)


def _alphas(axis: int) -> tuple[Series, ...]:
    estimate = Series(lambda track, frames: track["alpha_hat"][frames, axis, None], ("estimated",), pale=(0.5,))
    return estimate, Series(_true_alpha(axis), ("true",), entity="true")


def _velocities(axis: int) -> tuple[Series, ...]:
    return (Series(_velocity(axis), ("sent", "arrived", "achieved"), pale=(0.75, 0.45)),)


def _measured(channel: str, lines: tuple[str, ...] = WHEELS) -> tuple[Series, ...]:
    return (Series(_column(channel), lines, channel),)


_WHEEL_SPEEDS = (*(f"{wheel} commanded" for wheel in WHEELS), *(f"{wheel} measured" for wheel in WHEELS))
_ALPHA_RANGE = 0.4, 1.3
# Tab -> its plots. Those of the wheels show one controller, all others show all controllers.
WHEEL_TAB = "wheels"
TABS: dict[str, tuple[Plot, ...]] = {
    "tracking": (
        Plot("error/x", "tracking error in x", "cm", (Series(_error(0, 100)),)),
        Plot("error/y", "tracking error in y", "cm", (Series(_error(1, 100)),)),
        Plot("error/heading", "tracking error in heading", "deg", (Series(_error(2, 180 / np.pi)),)),
        Plot("ahead", "from the robot to the pose that its controller acts on", "cm", (Series(_ahead),)),
    ),
    "velocity": (
        Plot("velocity/x", "velocity in x", "m/s", _velocities(0)),
        Plot("velocity/y", "velocity in y", "m/s", _velocities(1)),
        Plot("velocity/turn", "turn rate", "rad/s", _velocities(2)),
    ),
    "alpha": (
        Plot("alpha/x", "motor correction factor alpha in x", "", _alphas(0), _ALPHA_RANGE, "RightBottom"),
        Plot("alpha/y", "motor correction factor alpha in y", "", _alphas(1), _ALPHA_RANGE, "RightBottom"),
    ),
    WHEEL_TAB: (
        Plot(
            "wheel/speed",
            "wheel speed",
            "rad/s",
            (Series(_wheel_speed, _WHEEL_SPEEDS, "wheel_speed", pale=(0.6,) * 4),),
        ),
        Plot("wheel/voltage", "motor voltage", "V", _measured("voltage")),
        Plot("wheel/current", "motor current", "A", _measured("current")),
        Plot("wheel/slip", "slip of the contact points", "m/s", _measured("slip")),
    ),
    "heat": (
        Plot("winding", "winding temperature", "deg C", _measured("winding"), legend="RightBottom"),
        Plot("battery", "battery voltage under load", "V", _measured("battery", ("",))),
    ),
}


@dataclass(frozen=True)
class Drawn:
    """A series as it is drawn of one controller.

    Args:
        plot, series: what it shows.
        controller: index of the controller.
        name: of the controller.
        by_wheel: a colour per wheel, instead of the controller's.
    """

    plot: Plot
    series: Series
    controller: int
    name: str
    by_wheel: bool

    @property
    def entity(self) -> str:
        """Where it is in the recording."""
        return f"plots/{self.plot.entity}/{self.name}/{self.series.entity}".rstrip("/")

    def style(self) -> rr.SeriesLines:
        """Names with unit and rate, colours, widths."""
        lines, rate = self.series.lines, f"{FRAME_RATE_HZ} Hz"
        name = "" if self.by_wheel else self.name
        unit = f"({self.plot.unit}, {rate})" if self.plot.unit else f"({rate})"
        white = [*self.series.pale, *[0.0] * (len(lines) - len(self.series.pale))]
        hues = [colours.of(i % len(WHEELS) if self.by_wheel else self.controller) for i in range(len(lines))]
        return rr.SeriesLines(
            names=[" ".join(filter(None, (name, line, unit))) for line in lines],
            colors=[colours.pale(hue, share) for hue, share in zip(hues, white, strict=True)],
            widths=[0.8 if share else 1.5 for share in white],
        )

    def columns(self, track: Track, frames: Array) -> rr.ComponentColumnList:
        """Values in `frames`; where they are not numbers none, which leaves a gap (two NaN would not compare equal)."""
        values = self.series.values(track, frames)
        known = ~np.isnan(values).any(1)
        return rr.Scalars.columns(scalars=values[known].ravel()).partition(known * values.shape[1])


def drawn(controllers: tuple[str, ...], absent: set[str]) -> list[Drawn]:
    """All series of the `controllers`, but for those of channels that hold no numbers, which are `absent`."""
    return [
        Drawn(plot, series, i, name, tab == WHEEL_TAB)
        for tab, plots in TABS.items()
        for plot in plots
        for series in plot.series
        for i, name in enumerate(controllers)
        if series.channel not in absent
    ]
