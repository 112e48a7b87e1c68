"""A recording of robots that others drive: they come and go, and nobody knows how long it lasts."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path

import click
import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from omni_control.errors import OmniError
from omni_control.kinematics import Array
from omni_mj.files import check_room
from omni_mj.live.serve.log import Block
from omni_mj.scenarios.settings import Settings
from omni_mj.show import style
from omni_mj.show.recording import scene, stream
from omni_mj.show.recording.scene import TIME, indexes
from omni_mj.show.recording.viewer import answers
from omni_mj.simulate.log import Log

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
TABLE_BYTES = 20e6  # of disk, that a recording leaves to the table, which goes on
BELOW_M = 10.0  # the carpet: where robots are that are not there


class ServedRecording:
    """A file or a viewer that is fed. If it fails, that is said, and what is served goes on without it.

    Args:
        target: Path of the .rrd file, or address of the viewer.
        robots: Team -> settings of its robots.
        name: Of the recording.
    """

    def __init__(self, target: Path | str, robots: Mapping[str, Settings], name: str) -> None:
        self._target, self._robots, self._shown = target, robots, set[str]()
        self._before: Sequence[str] = ()
        self._has_failed, self._stream = False, stream.open_stream()
        with self._warning():
            if isinstance(target, Path):  # without a footer, which rerun would hold in memory until the end
                check_room(target.parent, TABLE_BYTES)
                self._stream.save(target, _blueprint(), write_footer=False)
            elif answers(target):
                self._stream.connect_grpc(target, default_blueprint=_blueprint())
            else:
                raise RuntimeError("no viewer answers")
            self._stream.send_recording_name(name)
            scene.log_field(self._stream)

    def send(self, block: Block) -> None:
        """Send a block of frames."""
        if not self._has_failed:
            with self._warning():
                if isinstance(self._target, Path):
                    check_room(self._target.parent, TABLE_BYTES)
                self._send(block.first, block.names, block.log, block.ball)

    def close(self) -> None:
        """End it."""
        with self._warning():
            stream.flush(self._stream)
            self._stream.disconnect()

    @contextmanager
    def _warning(self) -> Iterator[None]:
        """Say once what fails."""
        try:
            yield
        except (RuntimeError, OmniError) as failure:
            if not self._has_failed:
                reason = " ".join(str(failure).split())
                click.echo(f"warning: {self._target} is not fed any more: {reason}; the run goes on", err=True)
            self._has_failed = True

    def _send(self, first: int, names: Sequence[str], log: Log, ball: Array) -> None:
        frames = np.arange(first, first + log.length)
        time, stream = indexes(frames), self._stream
        for gone in sorted(set(self._before) - set(names)):
            out_of_sight = scene.transform(np.zeros((1, 3)), -BELOW_M)  # shapes are static, which nothing clears
            stream.send_columns(f"world/{_entity(gone)}/at", indexes(frames[:1]), out_of_sight)
        self._before = names
        points = np.column_stack([np.nan_to_num(ball), np.full(len(ball), BALL_RADIUS_M)])
        look = rr.Points3D.columns(positions=points, colors=[BALL] * len(points), radii=[BALL_RADIUS_M] * len(points))
        stream.send_columns("world/ball", time, look)
        for row, name in enumerate(names):
            values = {channel: log.channel(channel)[:, row] for channel in PLOTS}
            self._show(name, {channel: part.shape[1] for channel, part in values.items()})
            poses, angles = log.channel("pose")[:, row], log.channel("wheel_angle")[:, row]
            scene.send_pose(stream, f"world/{_entity(name)}/at", time, poses, angles, self._robots[name.split()[0]])
            for channel, part in values.items():
                columns = rr.Scalars.columns(scalars=part.ravel()).partition(np.full(len(part), part.shape[1]))
                stream.send_columns(f"plots/{channel}/{_entity(name)}", time, columns)

    def _show(self, name: str, lines: Mapping[str, int]) -> None:
        """Log a robot's shape once, and how its lines look, so many of each channel."""
        if name in self._shown:
            return
        self._shown.add(name)
        team, number = name.split()
        scene.log_robot(self._stream, f"world/{_entity(name)}/at", TEAMS[team], self._robots[team])
        colour = style.rgb(style.colour(SLOTS[team][int(number) % len(SLOTS[team])]))
        for channel, count in lines.items():
            look = rr.SeriesLines(
                names=[f"{name} {line}" for line in (AXES if channel == "command" else range(1, count + 1))],
                colors=[style.pale(colour, 0.7 * i / count) for i in range(count)],
            )
            self._stream.log(f"plots/{channel}/{_entity(name)}", look, static=True)


def _entity(name: str) -> str:
    return name.replace(" ", "_")


def _blueprint() -> rrb.Blueprint:
    eye = rrb.EyeControls3D(position=[0, -6, 6], look_target=[0, 0, 0], eye_up=[0, 0, 1])
    field = rrb.Spatial3DView(origin="world", name="field", eye_controls=eye, line_grid=False)
    plots = rrb.Tabs(
        *(rrb.TimeSeriesView(origin=f"plots/{channel}", name=f"{channel}, {unit}") for channel, unit in PLOTS.items())
    )
    time = rrb.TimePanel(timeline=TIME, play_state="following", state="collapsed")
    return rrb.Blueprint(rrb.Horizontal(field, plots, column_shares=[3, 2]), time, collapse_panels=True)
