"""The tabs of a recording: which series stand together, and how they follow from the log."""

from collections.abc import Iterable, Mapping

import numpy as np
import rerun as rr

from omni_control.kinematics import Array, Kinematics, world_to_body, wrap_angle
from omni_mj.measure import causes
from omni_mj.measure.metrics import ALPHA_START_FRAMES, ALPHA_WINDOW_FRAMES, driven_alpha
from omni_mj.scenarios.settings import PERIOD_S
from omni_mj.show.recording.robots import Robot, Track
from omni_mj.show.recording.series import Drawn, Plot, Series, Values
from omni_mj.show.recording.timelines import Frames
from omni_mj.show.style import wheel_names as names_of
from omni_mj.simulate.log import OWN

OWN_TAB = "own"
EACH = ("alpha", "wheels", "heat")  # tabs that show one robot each, all others show all robots
SIGMA = OWN + "alpha_sigma"  # a controller's own, in its estimate
_ALPHA_RANGE, _SHARE = (0.4, 1.3), (0.0, 1.05)


def tabs(geometry: Kinematics, absent: set[str]) -> dict[str, list[Plot]]:
    """The plots under each tab, but for those of channels that hold no numbers, which are `absent`.

    Args:
        geometry: of the robots' wheels.
        absent: channels of the log.
    """
    return {
        tab: [plot for plot in plots if not {series.channel for series in plot.series} <= absent]
        for tab, plots in _all(geometry).items()
    }


def own(columns: Mapping[str, tuple[str, ...]]) -> list[Plot]:
    """The plots of the channels that controllers record of their own, a plot each.

    Args:
        columns: of the log, by channel.
    """
    plots = []
    for channel, titles in columns.items():
        if channel.startswith(OWN):
            name, count = channel.removeprefix(OWN), len(titles)
            lines = tuple(str(i + 1) for i in range(count)) if count > 1 else ("",)
            pale = tuple(0.6 * (1 - i / (count - 1)) for i in range(count - 1))
            series = Series(_column(channel), lines, channel, pale=pale)
            plots.append(Plot(f"{OWN_TAB}/{rr.escape_entity_path_part(name)}", name, "", (series,)))
    return plots


def drawn(tabs: Mapping[str, Iterable[Plot]], robots: Iterable[Robot], wheels: int) -> list[Drawn]:
    """All series of the robots, each with as many wheels."""
    return [
        Drawn(plot, series, robot, wheels if plot.by_wheel else 0)
        for plots in tabs.values()
        for plot in plots
        for series in plot.series
        for robot in robots
    ]


def _all(geometry: Kinematics) -> dict[str, tuple[Plot, ...]]:
    wheels = names_of(geometry.azimuths)
    speeds = *(f"{wheel} commanded" for wheel in wheels), *(f"{wheel} measured" for wheel in wheels)
    return {
        "tracking": (
            Plot("error/x", "tracking error in x", "cm", (Series(_error(0)),)),
            Plot("error/y", "tracking error in y", "cm", (Series(_error(1)),)),
            Plot("error/distance", "distance to the reference in the plane", "cm", (Series(_distance),)),
            Plot("error/heading", "tracking error in heading", "deg", (Series(_heading_error),)),
            Plot("ahead", "from the robot to the pose that its controller acts on", "cm", (Series(_ahead),)),
        ),
        "velocity": (
            Plot("velocity/x", "velocity in x", "m/s", _velocities(0)),
            Plot("velocity/y", "velocity in y", "m/s", _velocities(1)),
            Plot("velocity/turn", "turn rate", "rad/s", _velocities(2)),
        ),
        "why": (
            Plot("why/sliding", "slip beyond creep of the wheel that slides most", "m/s", _one(_sliding, "slip")),
            Plot("why/duty", "greatest duty of the motors", "", _measured("duty_peak", ("",)), _SHARE),
            Plot("why/limited", "share of time at a driver's limit", "", _one(_limited, "current_limited"), _SHARE),
            Plot(
                "why/held",
                "share of the last 0.25 s in which the command is held back by a limit",
                "",
                _one(_held_back, "command"),
                _SHARE,
            ),
        ),
        "alpha": (
            Plot("alpha/x", "motor correction factor alpha in x", "", _alphas(0), _ALPHA_RANGE, "RightBottom"),
            Plot("alpha/y", "motor correction factor alpha in y", "", _alphas(1), _ALPHA_RANGE, "RightBottom"),
        ),
        "wheels": (
            Plot(
                "wheel/speed",
                "wheel speed",
                "rad/s",
                (Series(_wheel_speed(geometry), speeds, "wheel_speed", pale=(0.6,) * len(wheels)),),
                by_wheel=True,
            ),
            Plot("wheel/voltage", "motor voltage", "V", _measured("voltage", wheels), by_wheel=True),
            Plot("wheel/current", "motor current", "A", _measured("current", wheels), by_wheel=True),
            Plot("wheel/slip", "slip of the contact points", "m/s", _measured("slip", wheels), by_wheel=True),
        ),
        "heat": (
            Plot("winding", "winding temperature", "deg C", _measured("winding", wheels), None, "RightBottom", True),
            Plot("battery", "battery voltage under load", "V", _measured("battery", ("",))),
        ),
    }


def _column(channel: str) -> Values:
    return lambda track, frames: track[channel][frames]


def _error(axis: int) -> Values:
    return lambda track, frames: 100 * (track["pose"][frames] - track["ref"][frames])[:, axis, None]


def _heading_error(track: Track, frames: Frames) -> Array:
    return np.rad2deg(wrap_angle(track["pose"][frames, 2] - track["ref"][frames, 2]))[:, None]


def _distance(track: Track, frames: Frames) -> Array:
    x, y = (track["pose"][frames] - track["ref"][frames])[:, :2].T
    return 100 * np.hypot(x, y)[:, None]


def _ahead(track: Track, frames: Frames) -> Array:
    x, y = (track["predicted"][frames] - track["pose"][frames])[:, :2].T
    return 100 * np.hypot(x, y)[:, None]


def _velocity(axis: int) -> Values:
    """What was sent, what arrived at the robot, and what was achieved since the frame before."""

    def values(track: Track, frames: Frames) -> Array:
        pose = track["pose"][:, axis]
        achieved = (pose[frames] - pose[np.maximum(frames - 1, 0)]) / PERIOD_S
        return np.stack([track["command"][frames, axis], track["applied"][frames, axis], achieved], axis=1)

    return values


def _ratio(axis: int) -> Values:
    """Displacement achieved over commanded, of the window that ends in a frame, where the robot is driven."""

    def values(track: Track, frames: Frames) -> Array:
        seen = slice(max(frames[0] - ALPHA_WINDOW_FRAMES - ALPHA_START_FRAMES, 0), frames[-1] + 1)
        alpha = np.full((len(frames), 1), np.nan)
        if seen.stop - seen.start > ALPHA_WINDOW_FRAMES:
            windows = driven_alpha(track["pose"][seen, axis], track["applied"][seen, axis])[-len(frames) :]
            alpha[-len(windows) :, 0] = windows
        return alpha

    return values


def _estimate(axis: int) -> Values:
    """What a controller believes; one that says exactly 1 estimates nothing, or nothing yet."""

    def values(track: Track, frames: Frames) -> Array:
        estimate = track["alpha_hat"][frames, axis, None]
        return np.where(estimate == 1, np.nan, estimate)

    return values


def _deviations(axis: int) -> Values:
    """The estimate less and more two of its standard deviations, where it says them."""

    def values(track: Track, frames: Frames) -> Array:
        if SIGMA not in track.log.columns:
            return np.full((len(frames), 2), np.nan)
        estimate, sigma = track["alpha_hat"][frames, axis], track[SIGMA][frames, axis]
        return np.stack([estimate - 2 * sigma, estimate + 2 * sigma], axis=1)

    return values


def _sliding(track: Track, frames: Frames) -> Array:
    """By how much the wheel that slides most does, m/s; zero where none does."""
    seen = slice(max(frames[0] - 1, 0), frames[-1] + 1)
    beyond = causes.slip_beyond(track["pose"][seen], track["slip"][seen], track.log.rows[track.row].settings)
    fastest = np.maximum(beyond.max(-1), 0.0)
    return np.concatenate([np.zeros(len(frames) - len(fastest)), fastest])[:, None]


def _limited(track: Track, frames: Frames) -> Array:
    greatest: Array = track["current_limited"][frames].max(-1, keepdims=True)
    return greatest


def _held_back(track: Track, frames: Frames) -> Array:
    """Share of the last quarter of a second in which the command was at a limit."""
    first = max(frames[0] - ALPHA_WINDOW_FRAMES + 1, 0)
    before = track["command"][first - 1] if first else np.zeros(3)
    control = track.log.rows[track.row].settings.control
    met = causes.at_limits(track["command"][first : frames[-1] + 1], before, control)
    held = np.any([each for _, each in met.values()], axis=0)
    lacking = np.zeros(ALPHA_WINDOW_FRAMES - 1 - int(frames[0]) + first)
    windows = np.lib.stride_tricks.sliding_window_view(np.concatenate([lacking, held]), ALPHA_WINDOW_FRAMES)
    share: Array = windows.mean(-1)[:, None]
    return share


def _wheel_speed(kinematics: Kinematics) -> Values:
    """Speeds at which the wheels would roll without slip as the command asks that arrived, and their true ones."""

    def values(track: Track, frames: Frames) -> Array:
        twist = world_to_body(track["applied"][frames], track["pose"][frames, 2])
        return np.concatenate([kinematics.wheel_speeds(twist), track["wheel_speed"][frames]], axis=1)

    return values


def _alphas(axis: int) -> tuple[Series, ...]:
    return (
        Series(_estimate(axis), ("estimate",)),
        Series(_deviations(axis), ("less 2 sigma", "plus 2 sigma"), entity="sigma", pale=(0.6, 0.6)),
        Series(_ratio(axis), ("ratio",), entity="ratio", pale=(0.8,)),
    )


def _velocities(axis: int) -> tuple[Series, ...]:
    return (Series(_velocity(axis), ("sent", "arrived", "achieved"), pale=(0.75, 0.45)),)


def _one(values: Values, channel: str) -> tuple[Series, ...]:
    return (Series(values, channel=channel),)


def _measured(channel: str, lines: tuple[str, ...]) -> tuple[Series, ...]:
    return (Series(_column(channel), lines, channel),)
