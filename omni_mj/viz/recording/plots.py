"""Time series of a recording: the plots of each tab, and how their lines follow from the log."""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import rerun as rr

from omni_control.kinematics import Array, world_to_body
from omni_mj.config.settings import PERIOD_S
from omni_mj.results import saturation
from omni_mj.results.metrics import ALPHA_START_FRAMES, ALPHA_WINDOW_FRAMES
from omni_mj.simulation.log import CHANNEL_PREFIX, Log
from omni_mj.viz import style
from omni_mj.viz.recorded_robots import ALPHA_RANGE, RecordedRobot

# Before a block, on which its values depend
HISTORY_FRAMES = ALPHA_WINDOW_FRAMES + ALPHA_START_FRAMES
SINGLE = ("alpha", "wheels", "heat")  # tabs that show one robot at a time
SHARE = (0.0, 1.05)  # range of axes


class Plot(NamedTuple):
    """A plot, which has the same lines for each robot.

    Args:
        path: Path below plots/; the robots are below it.
        title: Quantity and unit that it shows.
        values: Maps a robot to values (frames, lines), NaN where there are none.
        lines: Names of the lines; empty if there is nothing to tell apart.
        channel: Channel of the log; if it holds no numbers there is no plot.
        white: Share of white in the colours of the first lines, with which the others are compared.
        range: Limits of the axis. [those of the data]
        wheels: Number of wheels if each has a colour of its own; 0 if lines have the robot's.
    """

    path: str
    title: str
    values: Callable[[RecordedRobot], Array]
    lines: tuple[str, ...] = ("",)
    channel: str = "pose"
    white: tuple[float, ...] = ()
    range: tuple[float, float] | None = None
    wheels: int = 0

    def look(self, robot: RecordedRobot) -> rr.SeriesLines:
        """Return names, colours and widths of a robot's lines."""
        white = [*self.white, *[0.0] * (len(self.lines) - len(self.white))]
        hues = [
            style.rgb(style.colour(i % self.wheels)) if self.wheels else robot.colour
            for i in range(len(white))
        ]
        return rr.SeriesLines(
            names=[line if self.wheels else f"{robot.name} {line}".strip() for line in self.lines],
            colors=[
                style.mix_with_white(hue, share) for hue, share in zip(hues, white, strict=True)
            ],
            widths=[0.8 if share else 1.5 for share in white],
        )


def tabs(log: Log) -> dict[str, list[Plot]]:
    """Return the plots of each tab whose channels hold numbers so far."""
    geometry = log.rows[0].settings.wheels.kinematics
    wheels = tuple(
        f"{i} at {azimuth:.0f}°" for i, azimuth in enumerate(np.rad2deg(geometry.azimuths), start=1)
    )
    white = (0.6,) * len(wheels)

    def wheel_speeds(robot: RecordedRobot) -> Array:
        """Return the speeds of wheels that roll without slip as the command asks, and the true ones."""
        twist = world_to_body(robot["applied"], robot["pose"][:, 2])
        return np.hstack([geometry.wheel_speeds(twist), robot["wheel_speed"]])

    def per_wheel(channel: str, title: str) -> Plot:
        return _channel(channel, f"wheel/{channel}", title, wheels, wheels=len(wheels))

    speeds = tuple(f"{wheel} {kind}" for kind in ("commanded", "measured") for wheel in wheels)
    speed = per_wheel("wheel_speed", "wheel speed, rad/s")._replace(
        values=wheel_speeds, lines=speeds, white=white
    )
    tabs = {
        "tracking": [
            Plot("error/x", "tracking error in x, cm", lambda robot: robot.error()[:, :1]),
            Plot("error/y", "tracking error in y, cm", lambda robot: robot.error()[:, 1:2]),
            Plot("error/distance", "distance to the reference in the plane, cm", _distance),
            Plot(
                "error/heading",
                "tracking error in heading, deg",
                lambda robot: robot.error()[:, 2:],
            ),
        ],
        "velocity": [
            _velocity("velocity/x", "velocity in x, m/s", 0),
            _velocity("velocity/y", "velocity in y, m/s", 1),
            _velocity("velocity/turn", "turn rate, rad/s", 2),
        ],
        "why": [
            Plot(
                "why/sliding",
                "slip beyond creep of the wheel that slides most, m/s",
                _sliding,
                channel="slip",
            ),
            _channel("duty_peak", "why/duty", "greatest duty of the motors", range=SHARE),
            Plot(
                "why/limited",
                "share of time at a driver's limit",
                _limited,
                channel="current_limited",
                range=SHARE,
            ),
            Plot("why/held", "command held back by a limit (1: yes)", _held_back, range=SHARE),
        ],
        "alpha": [_alpha("x", 0), _alpha("y", 1)],
        "wheels": [
            speed,
            per_wheel("voltage", "motor voltage, V"),
            per_wheel("current", "motor current, A"),
            per_wheel("slip", "slip of the contact points, m/s"),
        ],
        "heat": [
            per_wheel("winding", "winding temperature, deg C"),
            _channel("battery", "battery", "battery voltage under load, V"),
        ],
        "channels": [
            _own(channel, len(names))
            for channel, names in log.columns.items()
            if channel.startswith(CHANNEL_PREFIX)
        ],
    }
    known = {name for name in log.columns if not np.isnan(log.channel(name)).all()}
    return {tab: [plot for plot in part if plot.channel in known] for tab, part in tabs.items()}


def _channel(
    channel: str, path: str, title: str, lines: tuple[str, ...] = ("",), **look: Any
) -> Plot:
    """Return the plot of a channel as it is."""
    return Plot(path, title, lambda robot: robot[channel], lines, channel, **look)


def _own(channel: str, count: int) -> Plot:
    """Return the plot of a channel of a controller's own."""
    name, lines = (
        channel.removeprefix(CHANNEL_PREFIX),
        tuple(map(str, range(1, count + 1))) if count > 1 else ("",),
    )
    path = f"channels/{rr.escape_entity_path_part(name)}"
    return _channel(channel, path, name, lines, white=tuple(np.linspace(0.6, 0, count)))


def _limited(robot: RecordedRobot) -> Array:
    """Return the largest share of all drivers."""
    return robot["current_limited"].max(-1, keepdims=True)


def _distance(robot: RecordedRobot) -> Array:
    return np.linalg.norm(robot.error()[:, :2], axis=1, keepdims=True)


def _velocity(plot: str, title: str, axis: int) -> Plot:
    """Return what was sent, what arrived at the robot, and what was achieved since the frame before."""

    def values(robot: RecordedRobot) -> Array:
        pose = robot["pose"][:, axis]
        achieved = np.diff(pose, prepend=pose[0]) / PERIOD_S
        return np.stack([robot["command"][:, axis], robot["applied"][:, axis], achieved], axis=1)

    return Plot(plot, title, values, ("sent", "arrived", "achieved"), white=(0.75, 0.45))


def _alpha(name: str, axis: int) -> Plot:
    lines, white = ("ratio", "less 2 sigma", "plus 2 sigma", "estimate"), (0.8, 0.6, 0.6)
    title = f"motor correction factor alpha in {name}"
    return Plot(
        f"alpha/{name}",
        title,
        lambda robot: robot.alpha(axis),
        lines,
        white=white,
        range=ALPHA_RANGE,
    )


def _sliding(robot: RecordedRobot) -> Array:
    """Return by how much the wheel that slides most does, m/s; zero if none does."""
    beyond = saturation.slip_beyond(robot["pose"], robot["slip"], robot.settings)
    return np.concatenate([[0.0], np.maximum(beyond.max(-1), 0.0)])[:, None]


def _held_back(robot: RecordedRobot) -> Array:
    """Return 1 in the frames in which the command is at a limit, else 0."""
    return saturation.held_back(robot["command"], robot.settings.control)[:, None].astype(float)
