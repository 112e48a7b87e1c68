"""The recording of a run for the rerun viewer, written in blocks while the run goes on."""

from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from omni_mj import robot_shape, style
from omni_mj.events import Event
from omni_mj.metrics import AXES
from omni_mj.scenario import Scenario
from omni_mj.settings import FRAME_RATE_HZ
from omni_mj.trajectory import CHANNELS, Trajectory

_WHEEL_NAMES = ["front left", "rear left", "rear right", "front right"]
# Time series under each controller: entity -> (trajectory channel, names of its lines with their unit).
_SERIES = {
    "command": ("command", ["vx m/s", "vy m/s", "w rad/s"]),
    "applied": ("applied", ["vx m/s", "vy m/s", "w rad/s"]),
    "alpha_hat": ("alpha_hat", ["x", "y"]),
    "wheel_speed": ("wheel_speed", [f"{name} rad/s" for name in _WHEEL_NAMES]),
    "voltage": ("voltage", [f"{name} V" for name in _WHEEL_NAMES]),
    "current": ("current", [f"{name} A" for name in _WHEEL_NAMES]),
    "winding": ("winding", [f"{name} deg C" for name in _WHEEL_NAMES]),
    "battery": ("battery", ["V"]),
    "slip": ("slip", [f"{name} m/s" for name in _WHEEL_NAMES]),
}

# Tabs of the viewer: tab -> entity below plots -> title.
_VIEWS = {
    "tracking": {
        "error_x": "absolute error in x, cm",
        "error_y": "absolute error in y, cm",
        "command": "commanded velocity, world frame",
        "alpha_hat": "estimated alpha",
    },
    "wheels": {
        "wheel_speed": "wheel speed",
        "voltage": "motor voltage",
        "current": "motor current",
        "applied": "command arrived at the robot",
    },
    "losses": {
        "winding": "winding temperature",
        "battery": "battery voltage",
        "slip": "slip of the contact points",
    },
}
TIMELINES = ("frame", "time")


class Recording:
    """An .rrd file of a run's first seed, all controllers in it; a context manager.

    Args:
        path: of the file; its folder must exist.
        scenario: what is run.
        reference: the timed reference's poses (frames, 3).
    """

    def __init__(self, path: Path, scenario: Scenario, reference: np.ndarray) -> None:
        rr.set_strict_mode(True)  # otherwise what rerun refuses is silently missing from the file
        self._path, self._controllers, self._seed = path, scenario.controllers, scenario.seed
        self._recorded = 0
        self._stream = rr.RecordingStream("omni-mj")
        self._stream.save(path, default_blueprint=_blueprint(scenario.controllers, reference))
        self._stream.set_log_time_enabled(False)
        self._stream.send_recording_name(f"{scenario.name} on {scenario.plant}, seed {scenario.seed}")
        self._log_static(reference)

    def __enter__(self) -> "Recording":
        self._stream.__enter__()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        try:
            self._stream.__exit__(kind, error, traceback)
        except RuntimeError as failure:  # rerun's writer gives up when it cannot write, and says so only here
            raise OSError(None, f"the recording could not be written to its end: {failure}", str(self._path)) from None

    def write(self, trajectory: Trajectory) -> None:
        """Send the frames recorded since the last call, so that whatever ends the run leaves them readable."""
        start, stop = self._recorded, trajectory.length
        if start == stop:
            return
        self._recorded = stop
        time = [
            rr.TimeColumn(TIMELINES[0], sequence=np.arange(start, stop)),
            rr.TimeColumn(TIMELINES[1], duration=np.arange(start, stop) / FRAME_RATE_HZ),
        ]

        reference = trajectory.channel("ref")[start:stop, 0, 0]
        self._stream.send_columns("world/target", time, rr.Transform3D.columns(translation=_at(reference, 0.0)))
        for i, name in enumerate(self._controllers):
            first_seed = {channel: trajectory.channel(channel)[:, i, 0] for channel in CHANNELS}
            self._send_scene(f"world/{name}", time, first_seed, start, stop)
            self._send_series(name, time, {channel: data[start:stop] for channel, data in first_seed.items()})

    def _send_scene(self, entity: str, time: list[rr.TimeColumn], data: dict[str, Any], start: int, stop: int) -> None:
        """Send what the 3-D view shows of one robot in the frames from `start` to `stop`."""
        send = self._stream.send_columns
        pose = data["pose"][start:stop]
        send(f"{entity}/robot", time, _transform(_at(pose, 0.0), pose[:, 2], np.array([0, 0, 1])))
        angles = np.nan_to_num(data["wheel_angle"][start:stop])  # the kinematic plant's wheels do not turn
        for wheel, (position, axis) in enumerate(robot_shape.wheel_mounts()):
            mount = np.tile(position, (stop - start, 1))
            send(f"{entity}/robot/wheel_{wheel + 1}", time, _transform(mount, angles[:, wheel], axis))
        # A segment per frame, from the frame before: the viewer shows those up to its time cursor.
        before = data["pose"][np.maximum(np.arange(start, stop) - 1, 0)]
        segments = np.stack([_at(before, 0.004), _at(pose, 0.004)], axis=1)
        send(f"{entity}/path", time, rr.LineStrips3D.columns(strips=list(segments)))
        predicted = _at(data["predicted"][start:stop], 0.16)
        send(f"{entity}/predicted", time, rr.Points3D.columns(positions=predicted))

    def _send_series(self, name: str, time: list[rr.TimeColumn], data: dict[str, Any]) -> None:
        """Send the time series of one controller."""
        errors = 100 * np.abs(data["pose"] - data["ref"])
        for j, axis in enumerate(AXES):
            self._stream.send_columns(f"plots/error_{axis}/{name}", time, rr.Scalars.columns(scalars=errors[:, j]))
        for entity, (source, names) in _SERIES.items():
            if not np.isnan(data[source]).all():
                columns = rr.Scalars.columns(scalars=data[source]).partition([len(names)] * len(errors))
                self._stream.send_columns(f"plots/{entity}/{name}", time, columns)

    def log_summary(self, markdown: str, events: list[Event]) -> None:
        """Put the run's result, a Markdown text, and the first seed's events into the recording."""
        for event in (e for e in events if e.seed == self._seed):
            self._stream.set_time(TIMELINES[0], sequence=event.frame)
            self._stream.set_time(TIMELINES[1], duration=event.time_s)
            self._stream.log("events", rr.TextLog(f"{event.controller}: {event.text}", level=rr.TextLogLevel.WARN))
        self._stream.log("summary", rr.TextDocument(markdown, media_type=rr.MediaType.MARKDOWN), static=True)

    def _log_static(self, reference: np.ndarray) -> None:
        log = self._stream.log
        log("world", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
        grey = style.rgb(style.REFERENCE)
        path = rr.LineStrips3D([_at(reference, 0.002)], colors=[grey], radii=0.006)
        log("world/reference", path, static=True)
        target = rr.Ellipsoids3D(half_sizes=[[0.03, 0.03, 0.002]], colors=[grey], fill_mode="solid")
        log("world/target", target, static=True)
        for i, name in enumerate(self._controllers):
            colour = style.rgb(style.controller(i))
            robot_shape.log(self._stream, f"world/{name}/robot", colour)
            log(f"world/{name}/path", rr.LineStrips3D.from_fields(colors=[colour], radii=0.005), static=True)
            log(f"world/{name}/predicted", rr.Points3D.from_fields(colors=[colour], radii=0.015), static=True)
            shades = [style.rgb(c) for c in style.AXES]
            for axis in AXES:
                log(f"plots/error_{axis}/{name}", _lines([name], [colour]), static=True)
            for entity, (_, names) in _SERIES.items():
                log(f"plots/{entity}/{name}", _lines([f"{name} {n}" for n in names], shades), static=True)


def _lines(names: list[str], colours: list[tuple[int, int, int]]) -> rr.SeriesLines:
    return rr.SeriesLines(names=names, colors=colours[: len(names)])


def _at(pose: np.ndarray, z: float) -> np.ndarray:
    """Points (n, 3) above the poses (n, 3)."""
    return np.column_stack([pose[:, :2], np.full(len(pose), z)])


def _transform(position: np.ndarray, angle: np.ndarray, axis: np.ndarray) -> rr.ComponentColumnList:
    """Columns of transforms at `position` (n, 3), turned by `angle` (n,) about `axis`."""
    half = angle[:, None] / 2
    quaternion = np.concatenate([np.sin(half) * axis, np.cos(half)], axis=1)
    return rr.Transform3D.columns(translation=position, quaternion=quaternion)


def _blueprint(controllers: tuple[str, ...], reference: np.ndarray) -> rrb.Blueprint:
    """3-D view beside time series; the travelled path grows with the time cursor."""
    start, now = rrb.TimeRangeBoundary.infinite(), rrb.TimeRangeBoundary.cursor_relative()
    so_far = rrb.VisibleTimeRanges([rrb.VisibleTimeRange(timeline, start=start, end=now) for timeline in TIMELINES])
    low, high = reference[:, :2].min(0), reference[:, :2].max(0)
    centre, reach = (low + high) / 2, max(float(np.hypot(*(high - low))), 1.0)
    eye = rrb.EyeControls3D(
        position=[centre[0], centre[1] - 0.75 * reach, 0.75 * reach], look_target=[*centre, 0.0], eye_up=[0, 0, 1]
    )
    overrides: dict[rr.EntityPathLike, Any] = {f"world/{name}/path": so_far for name in controllers}
    scene = rrb.Spatial3DView(origin="world", name="field", overrides=overrides, eye_controls=eye)
    texts = rrb.Tabs(
        rrb.TextDocumentView(origin="summary", name="summary"), rrb.TextLogView(origin="events", name="events")
    )
    left = rrb.Vertical(scene, texts, row_shares=[3, 1])
    right = rrb.Tabs(*(_plots(name, views) for name, views in _VIEWS.items()))
    return rrb.Blueprint(
        rrb.Horizontal(left, right), rrb.TimePanel(timeline="time", play_state="paused"), collapse_panels=True
    )


def _plots(name: str, views: dict[str, str]) -> rrb.Vertical:
    return rrb.Vertical(*(rrb.TimeSeriesView(origin=f"plots/{o}", name=title) for o, title in views.items()), name=name)
