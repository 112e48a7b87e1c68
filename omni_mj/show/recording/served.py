"""A recording of robots that others drive: they come and go, and nobody knows how long it lasts."""

import uuid
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from omni_control.errors import OmniError
from omni_mj.live.serve.log import Block
from omni_mj.scenarios.settings import Settings
from omni_mj.show import style
from omni_mj.show.recording import robot_shape, scene, sink
from omni_mj.show.recording.sink import APPLICATION, TIME, indexes

PLOTS = {  # of each robot: channel -> its unit
    "command": "m/s, m/s, rad/s",
    "wheel_speed": "rad/s",
    "current": "A",
    "winding": "deg C",
    "battery": "V",
}
AXES = "x", "y", "turning"  # of commands, whether the field's or the robot's own
TEAMS = {"blue": (60, 110, 230), "yellow": (235, 200, 40)}
SLOTS = {"blue": (1, 5, 2, 11, 8, 10), "yellow": (4, 0, 7, 3, 6, 9)}  # of lines, in `style`: cold, and warm
BALL = (250, 130, 30)
BALL_RADIUS_M = 0.0215
BELOW_M = 10.0  # the carpet: where robots are that are not there

Connect = Callable[[rr.RecordingStream, rrb.Blueprint], None]


class ServedRecording:
    """A file, or a viewer that is fed.

    Args:
        connect: leads the stream there.
        robots: settings of each team's.
        name: of the recording.
        check: called before each block; what it raises ends the recording.
    """

    def __init__(
        self, connect: Connect, robots: Mapping[str, Settings], name: str, check: Callable[[], None] = lambda: None
    ) -> None:
        rr.set_strict_mode(True)
        self._robots, self._shown, self._check = robots, set[str](), check
        self._before: Sequence[str] = ()
        self._stream = rr.RecordingStream(APPLICATION, recording_id=uuid.uuid4())
        self._stream.set_log_time_enabled(False)
        self._failure = ""  # for what is served, which goes on, nothing depends on a recording
        try:
            check()
            connect(self._stream, _blueprint())
            self._stream.send_recording_name(name)
            scene.log_field(self._stream)
        except (RuntimeError, OmniError) as failure:
            self._failure = str(failure)

    def send(self, block: Block) -> None:
        """Send a block of frames."""
        first, names, log, ball = block.first, block.names, block.log, block.ball
        try:
            self._check()
        except OmniError as failure:
            self._failure = self._failure or str(failure)
        if self._failure:
            return
        frames = np.arange(first, first + log.length)
        time, stream = indexes(frames), self._stream
        for gone in sorted(set(self._before) - set(names)):
            out_of_sight = scene.transform(np.zeros((1, 3)), -BELOW_M)  # shapes are static, which nothing clears
            stream.send_columns(f"world/{_entity(gone)}/at", indexes(frames[:1]), out_of_sight)
        self._before = list(names)
        points = np.column_stack([np.nan_to_num(ball), np.full(len(ball), BALL_RADIUS_M)])
        look = rr.Points3D.columns(positions=points, colors=[BALL] * len(points), radii=[BALL_RADIUS_M] * len(points))
        stream.send_columns("world/ball", time, look)
        for row, name in enumerate(names):
            self._show(name, {channel: log.channel(channel).shape[2] for channel in PLOTS})
            pose = log.channel("pose")[:, row]
            entity = f"world/{_entity(name)}"
            stream.send_columns(f"{entity}/at", time, scene.transform(pose))
            for i, (mount, axis) in enumerate(robot_shape.wheel_mounts(self._robots[name.split()[0]])):
                angle = np.nan_to_num(log.channel("wheel_angle")[:, row, i])
                stream.send_columns(f"{entity}/at/wheel_{i + 1}", time, scene.turned(mount, angle, axis))
            for channel in PLOTS:
                values = log.channel(channel)[:, row]
                stream.send_columns(
                    f"plots/{channel}/{_entity(name)}",
                    time,
                    rr.Scalars.columns(scalars=values.ravel()).partition(np.full(len(values), values.shape[1])),
                )

    def close(self) -> str:
        """End it; say what did not arrive, if anything did not."""
        try:
            sink.flush(self._stream)
            self._stream.disconnect()
        except RuntimeError as failure:
            self._failure = self._failure or str(failure)
        return self._failure

    def _show(self, name: str, lines: Mapping[str, int]) -> None:
        """Log a robot's shape once, and how its lines look, so many of each channel."""
        if name in self._shown:
            return
        self._shown.add(name)
        team, number = name.split()
        robot_shape.log(self._stream, f"world/{_entity(name)}/at", TEAMS[team], self._robots[team])
        own = style.rgb(style.colour(SLOTS[team][int(number) % len(SLOTS[team])]))
        for channel, count in lines.items():
            each = AXES if channel == "command" else [f"wheel {i + 1}" for i in range(count)] if count > 1 else [""]
            look = rr.SeriesLines(
                names=[f"{name} {one}".rstrip() for one in each],
                colors=[sink.pale(own, 0.7 * i / count) for i in range(count)],
            )
            self._stream.log(f"plots/{channel}/{_entity(name)}", look, static=True)


def to_file(path: Path) -> Connect:
    """Leads to an .rrd file, without a list of its parts at its end, which rerun would keep in memory until then."""
    return lambda stream, blueprint: stream.save(path, blueprint, write_footer=False)


def to_viewer(url: str) -> Connect:
    """Leads to a viewer."""
    return lambda stream, blueprint: stream.connect_grpc(url, default_blueprint=blueprint)


def _entity(name: str) -> str:
    return name.replace(" ", "_")


def _blueprint() -> rrb.Blueprint:
    eye = rrb.EyeControls3D(position=[0, -6, 6], look_target=[0, 0, 0], eye_up=[0, 0, 1])
    field = rrb.Spatial3DView(
        origin="world", contents=["$origin/**", f"- {scene.ABOVE}/**"], name="field", eye_controls=eye, line_grid=False
    )
    plots = rrb.Tabs(
        *(rrb.TimeSeriesView(origin=f"plots/{channel}", name=f"{channel}, {unit}") for channel, unit in PLOTS.items())
    )
    time = rrb.TimePanel(timeline=TIME, play_state="following", state="collapsed")
    return rrb.Blueprint(rrb.Horizontal(field, plots, column_shares=[3, 2]), time, collapse_panels=True)
