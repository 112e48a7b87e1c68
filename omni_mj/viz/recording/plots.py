"""Time series of a recording: the plots of each tab, and how their lines follow from the log."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import rerun as rr

from omni_control.kinematics import Array, world_to_body
from omni_mj.config import PERIOD_S
from omni_mj.results import saturation
from omni_mj.results.alpha_windows import ALPHA_START_FRAMES, ALPHA_WINDOW_FRAMES
from omni_mj.simulation.log import CHANNEL_PREFIX, Log
from omni_mj.viz import style
from omni_mj.viz.displayed_robots import ALPHA_RANGE, RecordedRobot

# Frames before a block on which the block's values depend.
HISTORY_FRAMES = ALPHA_WINDOW_FRAMES + ALPHA_START_FRAMES
ONE_ROBOT_TABS = ("alpha", "wheels", "temperature and battery")  # with a tab for each robot inside
FRACTION_RANGE = (0.0, 1.05)  # of axes that show a fraction


class Plot(NamedTuple):
    """A plot with the same lines for each robot.

    Attributes:
        path: Path below plots/; the robots are below it.
        title: Quantity and unit.
        values: Function of a robot that returns values (frames, lines), NaN where there are none.
            Default: the values of the channel.
        channel: Channel of the log that must contain numbers, otherwise the plot is left out.
        lines: Names of the lines; one empty name if there is only one line.
        white: Fractions of white in the colors of the first lines, which are drawn thinner.
        range: Limits of the axis. Default: those of the data.
        n_wheels: Number of wheels if each has its own color; 0 if lines have the robot's color.
    """

    path: str
    title: str
    values: Callable[[RecordedRobot], Array] | None = None
    channel: str = "pose"
    lines: tuple[str, ...] = ("",)
    white: tuple[float, ...] = ()
    range: tuple[float, float] | None = None
    n_wheels: int = 0

    def compute(self, robot: RecordedRobot) -> Array:
        """Return the values of a robot's lines, (frames, lines)."""
        return self.values(robot) if self.values else robot[self.channel]

    def line_style(self, robot: RecordedRobot) -> rr.SeriesLines:
        """Return names, colors and widths of a robot's lines."""
        count = len(self.lines)
        white = [*self.white, *[0.0] * (count - len(self.white))]
        names = [f"{robot.name} {line}".strip() for line in self.lines]
        colors = [robot.color] * count
        if self.n_wheels:
            names = list(self.lines)
            colors = [style.rgb(style.color(i % self.n_wheels)) for i in range(count)]
        return rr.SeriesLines(
            names=names,
            colors=[style.mix_with_white(*pair) for pair in zip(colors, white, strict=True)],
            widths=[0.8 if fraction else 1.5 for fraction in white],
        )


def create_tabs(log: Log) -> dict[str, list[Plot]]:
    """Return the plots of each tab whose channels contain numbers so far."""
    tabs = {
        "tracking": _tracking_plots(),
        "velocity": [
            _velocity_plot("velocity/x", "velocity in x, m/s", 0),
            _velocity_plot("velocity/y", "velocity in y, m/s", 1),
            _velocity_plot("velocity/turn", "turn rate, rad/s", 2),
        ],
        "saturation": _saturation_plots(),
        "alpha": [_alpha_plot(0), _alpha_plot(1)],
        **_wheel_tabs(log),
        "channels": [
            _controller_plot(channel, len(columns))
            for channel, columns in log.columns.items()
            if channel.startswith(CHANNEL_PREFIX)
        ],
    }
    known = {name for name in log.columns if not np.isnan(log.channel(name)).all()}
    return {tab: [plot for plot in plots if plot.channel in known] for tab, plots in tabs.items()}


def _tracking_plots() -> list[Plot]:
    """Return the plots of pose errors; the first one shows which controller is best."""
    return [
        Plot(
            "error/distance",
            "position error (distance to the reference), cm",
            lambda robot: robot.position_error()[:, None],
        ),
        Plot("error/x", "position error in x, cm", lambda robot: robot.pose_error()[:, :1]),
        Plot("error/y", "position error in y, cm", lambda robot: robot.pose_error()[:, 1:2]),
        Plot("error/heading", "heading error, °", lambda robot: robot.pose_error()[:, 2:]),
    ]


def _velocity_plot(path: str, title: str, axis: int) -> Plot:
    """Return the plot of one velocity: sent, received by the robot and achieved."""

    def values(robot: RecordedRobot) -> Array:
        pose = robot["pose"][:, axis]
        achieved = np.diff(pose, prepend=pose[0]) / PERIOD_S
        return np.column_stack([robot["command"][:, axis], robot["applied"][:, axis], achieved])

    lines = ("sent", "received", "achieved")
    return Plot(path, title, values, lines=lines, white=(0.75, 0.45))


def _saturation_plots() -> list[Plot]:
    """Return the plots of sliding wheels and of limits that are reached."""
    return [
        Plot(
            "saturation/sliding",
            "sliding speed of the wheel that slides most (slip beyond creep), m/s",
            _sliding_speed,
            "slip",
        ),
        Plot(
            "saturation/duty",
            "largest duty cycle of the motors",
            channel="duty_peak",
            range=FRACTION_RANGE,
        ),
        Plot(
            "saturation/current",
            "fraction of time at the current limit, largest of the motors",
            lambda robot: robot["current_limited"].max(-1, keepdims=True),
            "current_limited",
            range=FRACTION_RANGE,
        ),
        Plot(
            "saturation/command",
            "command at a limit of speed or acceleration (1: yes)",
            _is_command_limited,
            range=FRACTION_RANGE,
        ),
    ]


def _alpha_plot(axis: int) -> Plot:
    """Return the plot of the measured motor correction factor along an axis and its estimate."""
    axis_name = "xy"[axis]
    return Plot(
        f"alpha/{axis_name}",
        f"motor correction factor alpha in {axis_name}",
        lambda robot: robot.alpha(axis),
        lines=("measured", "estimate - 2 sigma", "estimate + 2 sigma", "estimate"),
        white=(0.8, 0.6, 0.6),
        range=ALPHA_RANGE,
    )


def _wheel_tabs(log: Log) -> dict[str, list[Plot]]:
    """Return the tabs of wheels and motors."""
    geometry = log.rows[0].settings.wheels.kinematics
    azimuths = np.rad2deg(geometry.azimuths)
    wheels = tuple(f"{i} at {azimuth:.0f}°" for i, azimuth in enumerate(azimuths, start=1))

    def wheel_speeds(robot: RecordedRobot) -> Array:
        """Return the speeds at which wheels would roll without slip, and the true ones."""
        twist = world_to_body(robot["applied"], robot["pose"][:, 2])
        return np.hstack([geometry.wheel_speeds(twist), robot["wheel_speed"]])

    n_wheels = len(wheels)
    speed_plot = Plot(
        "wheel/wheel_speed",
        "wheel speed, rad/s",
        wheel_speeds,
        "wheel_speed",
        lines=tuple(f"{wheel} {kind}" for kind in ("commanded", "measured") for wheel in wheels),
        white=(0.6,) * n_wheels,
        n_wheels=n_wheels,
    )

    def wheel_plot(channel: str, title: str) -> Plot:
        return Plot(f"wheel/{channel}", title, None, channel, wheels, n_wheels=n_wheels)

    return {
        "wheels": [
            speed_plot,
            wheel_plot("voltage", "motor voltage, V"),
            wheel_plot("current", "motor current, A"),
            wheel_plot("slip", "slip of the contact points, m/s"),
        ],
        "temperature and battery": [
            wheel_plot("winding", "winding temperature, °C"),
            Plot("battery", "battery voltage under load, V", channel="battery"),
        ],
    }


def _controller_plot(channel: str, count: int) -> Plot:
    """Return the plot of a channel that a controller records, with `count` columns."""
    name = channel.removeprefix(CHANNEL_PREFIX)
    lines = tuple(str(i + 1) for i in range(count)) if count > 1 else ("",)
    path = f"channels/{rr.escape_entity_path_part(name)}"
    return Plot(path, name, None, channel, lines, white=tuple(np.linspace(0.6, 0, count)))


def _sliding_speed(robot: RecordedRobot) -> Array:
    """Return the slip beyond creep of the wheel that slides most, (frames, 1) m/s; at least 0."""
    slip_beyond_creep = saturation.excess_slip(robot["pose"], robot["slip"], robot.settings)
    speed = np.maximum(slip_beyond_creep.max(-1), 0.0)
    return np.concatenate([[0.0], speed])[:, None]


def _is_command_limited(robot: RecordedRobot) -> Array:
    """Return 1 in the frames in which the command is at a limit, else 0, (frames, 1)."""
    is_limited = saturation.is_command_limited(robot["command"], robot.settings.control)
    return is_limited[:, None].astype(float)
