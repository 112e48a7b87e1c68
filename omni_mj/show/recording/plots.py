"""Time series of a recording: which lines each plot shows, and how they follow from the log."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import rerun as rr

from omni_control.kinematics import Array, Kinematics, world_to_body, wrap_angle
from omni_mj.measure import causes
from omni_mj.measure.metrics import ALPHA_START_FRAMES, ALPHA_WINDOW_FRAMES, driven_alpha
from omni_mj.scenarios.rows import Row
from omni_mj.scenarios.settings import FRAME_RATE_HZ, PERIOD_S
from omni_mj.show import style
from omni_mj.show.recording.sink import Frames, Rgb, pale
from omni_mj.simulate.log import OWN, Log

OWN_TAB = "own"
SINGLE = ("alpha", "wheels", "heat")  # tabs that show one robot at a time
SIGMA = OWN + "alpha_sigma"
_ALPHA_RANGE, _SHARE = (0.4, 1.3), (0.0, 1.05)
_PALER, _PALEST = 0.35, 0.7  # share of white per robot of one controller, and at most


@dataclass(frozen=True)
class Robot:
    """A robot that is shown, and what was recorded of it.

    Args:
        log: Log of the run.
        row: Its row in the log.
        order: Its number among the robots shown.
        name: Its controller's, and its place if that drives several robots in a world.
        colour: Its controller's, paler from place to place.
    """

    log: Log
    row: int
    order: int
    name: str
    colour: Rgb

    @property
    def table_row(self) -> Row:
        """Its row of the table of rows, which has its settings."""
        return self.log.rows[self.row]

    @property
    def length(self) -> int:
        """Number of frames recorded."""
        return int(self.log.lengths[self.row])

    def __getitem__(self, channel: str) -> Array:
        """Return a channel, (frames, columns)."""
        return self.log.channel(channel)[: self.length, self.row]


def shown_robots(log: Log) -> list[Robot]:
    """Return the robots of each controller's first world, controller by controller."""
    robots: list[Robot] = []
    for controller, slot in style.slots(row.controller for row in log.rows).items():
        driven = [i for i, row in enumerate(log.rows) if row.controller == controller]
        together = [i for i in driven if log.rows[i].world == log.rows[driven[0]].world]
        for k, row in enumerate(together):
            name = controller if len(together) == 1 else f"{controller}/{log.rows[row].place}"
            colour = pale(style.rgb(style.colour(slot)), min(k * _PALER, _PALEST))
            robots.append(Robot(log, row, len(robots), name, colour))
    return robots


@dataclass(frozen=True)
class Series:
    """Lines of a plot that share an entity.

    Args:
        values: Maps a robot and successive frames (n,) to values (n, lines), NaN where there are none.
        lines: Names of the lines; empty if there is nothing to tell apart.
        entity: Path below the plot and robot, if these have several series.
        pale: Share of white in the colours of the first lines, with which the others are compared.
    """

    values: Callable[[Robot, Frames], Array]
    lines: tuple[str, ...] = ("",)
    entity: str = ""
    pale: tuple[float, ...] = ()

    def path(self, plot: "Plot", robot: Robot) -> str:
        """Return its entity in the recording."""
        return f"plots/{plot.entity}/{robot.name}/{self.entity}".rstrip("/")

    def look(self, plot: "Plot", robot: Robot) -> rr.SeriesLines:
        """Return names with unit and rate, colours and widths of the lines."""
        name, rate = "" if plot.wheels else robot.name, f"{FRAME_RATE_HZ} Hz"
        unit = f"({plot.unit}, {rate})" if plot.unit else f"({rate})"
        white = [*self.pale, *[0.0] * (len(self.lines) - len(self.pale))]
        slots = [i % plot.wheels for i in range(len(self.lines))] if plot.wheels else []
        hues = [style.rgb(style.colour(slot)) for slot in slots] or [robot.colour] * len(self.lines)
        return rr.SeriesLines(
            names=[" ".join(filter(None, (name, line, unit))) for line in self.lines],
            colors=[pale(hue, share) for hue, share in zip(hues, white, strict=True)],
            widths=[0.8 if share else 1.5 for share in white],
        )


@dataclass(frozen=True)
class Plot:
    """What is plotted together.

    Args:
        entity: Path below plots/; the robots are below it.
        title: What it shows.
        unit: Unit of its values.
        series: Series of each robot.
        channel: Channel of the log; if it holds no numbers there is no plot.
        range: Limits of the axis. [those of the data]
        wheels: Number of wheels if each line is a wheel in a colour of its own; 0 if lines have the robot's.
    """

    entity: str
    title: str
    unit: str
    series: tuple[Series, ...]
    channel: str = "pose"
    range: tuple[float, float] | None = None
    wheels: int = 0


def tabs(geometry: Kinematics, log: Log) -> dict[str, list[Plot]]:
    """Return the plots of each tab whose channels hold numbers so far."""
    wheels = style.wheel_names(geometry.azimuths)
    count = len(wheels)
    names = [f"{wheel} {kind}" for kind in ("commanded", "measured") for wheel in wheels]
    speeds = (Series(_wheel_speeds(geometry), tuple(names), pale=(0.6,) * count),)
    held = "share of the last 0.25 s in which the command is held back by a limit"
    acted = "from the robot to the pose that its controller acts on"
    alpha = "motor correction factor alpha in"
    plots = {
        "tracking": [
            Plot("error/x", "tracking error in x", "cm", _gap("pose", "ref", lambda gap: 100 * gap[:, 0])),
            Plot("error/y", "tracking error in y", "cm", _gap("pose", "ref", lambda gap: 100 * gap[:, 1])),
            Plot("error/distance", "distance to the reference in the plane", "cm", _gap("pose", "ref", _distance_cm)),
            Plot("error/heading", "tracking error in heading", "deg", _gap("pose", "ref", _heading_deg)),
            Plot("ahead", acted, "cm", _gap("predicted", "pose", _distance_cm)),
        ],
        "velocity": [
            Plot("velocity/x", "velocity in x", "m/s", _velocity(0)),
            Plot("velocity/y", "velocity in y", "m/s", _velocity(1)),
            Plot("velocity/turn", "turn rate", "rad/s", _velocity(2)),
        ],
        "why": [
            Plot("why/sliding", "slip beyond creep of the wheel that slides most", "m/s", (Series(_sliding),), "slip"),
            Plot("why/duty", "greatest duty of the motors", "", _columns("duty_peak"), "duty_peak", _SHARE),
            Plot(
                "why/limited", "share of time at a driver's limit", "", (Series(_limited),), "current_limited", _SHARE
            ),
            Plot("why/held", held, "", (Series(_held_back),), "command", _SHARE),
        ],
        "alpha": [Plot(f"alpha/{'xy'[i]}", f"{alpha} {'xy'[i]}", "", _alpha(i), range=_ALPHA_RANGE) for i in range(2)],
        "wheels": [
            Plot("wheel/speed", "wheel speed", "rad/s", speeds, "wheel_speed", wheels=count),
            Plot("wheel/voltage", "motor voltage", "V", _columns("voltage", wheels), "voltage", wheels=count),
            Plot("wheel/current", "motor current", "A", _columns("current", wheels), "current", wheels=count),
            Plot("wheel/slip", "slip of the contact points", "m/s", _columns("slip", wheels), "slip", wheels=count),
        ],
        "heat": [
            Plot("winding", "winding temperature", "deg C", _columns("winding", wheels), "winding", wheels=count),
            Plot("battery", "battery voltage under load", "V", _columns("battery"), "battery"),
        ],
        OWN_TAB: own_plots(log.columns),
    }
    known = {name for name in log.columns if not np.isnan(log.channel(name)).all()}
    return {tab: [plot for plot in part if plot.channel in known] for tab, part in plots.items()}


def own_plots(columns: Mapping[str, Sequence[str]]) -> list[Plot]:
    """Return a plot for each channel that controllers record of their own."""
    plots = []
    for channel in columns:
        if channel.startswith(OWN):
            name, count = channel.removeprefix(OWN), len(columns[channel])
            lines = [str(i + 1) for i in range(count)] if count > 1 else [""]
            white = tuple(0.6 * (1 - i / (count - 1)) for i in range(count - 1))
            entity = f"{OWN_TAB}/{rr.escape_entity_path_part(name)}"
            plots.append(Plot(entity, name, "", _columns(channel, lines, white), channel))
    return plots


def _columns(channel: str, lines: Iterable[str] = ("",), white: tuple[float, ...] = ()) -> tuple[Series, ...]:
    return (Series(lambda robot, frames: robot[channel][frames], tuple(lines), pale=white),)


def _gap(end: str, start: str, measure: Callable[[Array], Array]) -> tuple[Series, ...]:
    """Return a measure of the difference of two poses."""
    return (Series(lambda robot, frames: measure(robot[end][frames] - robot[start][frames])[:, None]),)


def _distance_cm(gap: Array) -> Array:
    return 100 * np.hypot(gap[:, 0], gap[:, 1])


def _heading_deg(gap: Array) -> Array:
    return np.rad2deg(wrap_angle(gap[:, 2]))


def _velocity(axis: int) -> tuple[Series, ...]:
    """Return what was sent, what arrived at the robot, and what was achieved since the frame before."""

    def values(robot: Robot, frames: Frames) -> Array:
        pose = robot["pose"][:, axis]
        achieved = (pose[frames] - pose[np.maximum(frames - 1, 0)]) / PERIOD_S
        return np.stack([robot["command"][frames, axis], robot["applied"][frames, axis], achieved], axis=1)

    return (Series(values, ("sent", "arrived", "achieved"), pale=(0.75, 0.45)),)


def _alpha(axis: int) -> tuple[Series, ...]:
    """Return estimate and its band, and the ratio of displacements of the window that ends in each frame."""

    def estimate(robot: Robot, frames: Frames) -> Array:
        alpha = robot["alpha_hat"][frames, axis, None]
        return np.where(alpha == 1, np.nan, alpha)  # exactly 1: nothing is estimated, or nothing yet

    def band(robot: Robot, frames: Frames) -> Array:
        if SIGMA not in robot.log.columns:
            return np.full((len(frames), 2), np.nan)
        return robot["alpha_hat"][frames, axis, None] + 2 * robot[SIGMA][frames, axis, None] * np.array([-1, 1])

    def ratio(robot: Robot, frames: Frames) -> Array:
        part = _since(frames, ALPHA_WINDOW_FRAMES + ALPHA_START_FRAMES)
        alpha = np.full(len(frames), np.nan)
        if part.stop - part.start > ALPHA_WINDOW_FRAMES:
            windows = driven_alpha(robot["pose"][part, axis], robot["applied"][part, axis])[-len(frames) :]
            alpha[-len(windows) :] = windows
        return alpha[:, None]

    return (
        Series(estimate, ("estimate",)),
        Series(band, ("less 2 sigma", "plus 2 sigma"), entity="sigma", pale=(0.6, 0.6)),
        Series(ratio, ("ratio",), entity="ratio", pale=(0.8,)),
    )


def _sliding(robot: Robot, frames: Frames) -> Array:
    """Return by how much the wheel that slides most does, m/s; zero if none does."""
    part = _since(frames, 1)
    beyond = causes.slip_beyond(robot["pose"][part], robot["slip"][part], robot.table_row.settings)
    most = np.maximum(beyond.max(-1), 0.0)
    return np.concatenate([np.zeros(len(frames) - len(most)), most])[:, None]


def _limited(robot: Robot, frames: Frames) -> Array:
    return robot["current_limited"][frames].max(-1, keepdims=True)


def _held_back(robot: Robot, frames: Frames) -> Array:
    """Return the share of the last quarter of a second in which the command was at a limit."""
    part = _since(frames, ALPHA_WINDOW_FRAMES - 1)
    before = robot["command"][part.start - 1] if part.start else np.zeros(3)
    limits: dict[str, Any] = causes.at_limits(robot["command"][part], before, robot.table_row.settings.control)
    held = np.any([met for _, met in limits.values()], axis=0)
    missing = len(frames) + ALPHA_WINDOW_FRAMES - 1 - len(held)
    padded = np.concatenate([np.zeros(missing), held])
    return np.lib.stride_tricks.sliding_window_view(padded, ALPHA_WINDOW_FRAMES).mean(-1)[:, None]


def _wheel_speeds(geometry: Kinematics) -> Callable[[Robot, Frames], Array]:
    """Return the speeds of wheels that roll without slip as the command asks, and the true ones."""

    def values(robot: Robot, frames: Frames) -> Array:
        twist = world_to_body(robot["applied"][frames], robot["pose"][frames, 2])
        return np.concatenate([geometry.wheel_speeds(twist), robot["wheel_speed"][frames]], axis=1)

    return values


def _since(frames: Frames, before: int) -> slice:
    """Return the slice of successive frames and at most so many before them."""
    return slice(max(int(frames[0]) - before, 0), int(frames[-1]) + 1)
