"""Recordings for the rerun viewer of runs, and of the robots of `omni-mj serve`, sent in blocks."""

import os
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import replace
from itertools import chain
from pathlib import Path

# rerun logs to stderr, where it would break the progress bar. Its errors arrive as exceptions.
os.environ.setdefault("RUST_LOG", "off")

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from omni_mj.config import FRAME_RATE_HZ
from omni_mj.config.settings import Settings
from omni_mj.results import events
from omni_mj.simulation.log import Log
from omni_mj.simulation.simulation import Simulation
from omni_mj.viz.displayed_robots import RecordedRobot, select_robots
from omni_mj.viz.recording import plots, robot_shapes, scene
from omni_mj.viz.recording.rerun_stream import TIME, Frames, RerunStream
from omni_mj.viz.recording.viewer_layout import create_layout

FILE_BLOCK_FRAMES = 5 * FRAME_RATE_HZ  # the most that a killed process loses
VIEWER_BLOCK_FRAMES = FRAME_RATE_HZ // 2
# Longer recordings get no index, which grows in memory by 0.25 kB per frame.
MAX_INDEXED_FRAMES = 600 * FRAME_RATE_HZ
VALUE_BYTES = 8  # of one number of the trajectory table
SERVED_PLOT_TITLES = {  # channel of the log -> title
    "command": "command: vx, vy, m/s; turn rate, rad/s",
    "wheel_speed": "wheel speed, rad/s",
    "current": "motor current, A",
    "winding": "winding temperature, °C",
    "battery": "battery voltage, V",
}
TEAM_COLORS = {"blue": (60, 110, 230), "yellow": (235, 200, 40)}
TABLE_BYTES = 20e6  # of disk space, reserved for the trajectory table
# Static shapes cannot be removed. Robots that left the field are moved under the carpet.
HIDDEN_HEIGHT_M = -10.0


class Recording(RerunStream):
    """A recording of the first world of each controller, in a file or in a viewer.

    The stream opens with the first block. A file ends early if the disk would not have enough room
    left for the trajectory table.

    Args:
        target: Path of the .rrd file, whose folder must exist, or address of the viewer.
        simulation: Simulation whose log is recorded.
    """

    def __init__(self, target: Path | str, simulation: Simulation) -> None:
        super().__init__(target)
        self._simulation = simulation
        self._log = simulation.log
        self._n_sent = 0  # frames
        self._open_series = set[str]()  # entities of plots that have values so far
        # Smallest and largest value of each plot so far, by path
        self._extremes = defaultdict[str, tuple[float, float]](lambda: (np.inf, -np.inf))
        self._channels: Sequence[str] = ()  # channels of the log for which the layout has plots
        self._robots = select_robots(self._log)
        references = [simulation.references[robot.row] for robot in self._robots]
        self._references = [reference.poses for reference in dict.fromkeys(references)]
        self._flag_heights = scene.choose_flag_heights(self._robots, self._references)
        # Kinds of events sent so far. All except faults happen once.
        self._event_kinds: list[set[str]] = [set() for _ in self._robots]

    def update(self) -> None:
        """Send the frames recorded since the last block if they fill a block."""
        is_file = isinstance(self._target, Path)
        block_frames = FILE_BLOCK_FRAMES if is_file else VIEWER_BLOCK_FRAMES
        if self._log.length - self._n_sent >= block_frames:
            self._try_sending(self._send_block)

    def write(self) -> None:
        """Send the last frames, and to a file the layout with readable axes."""
        if self._log.length:
            self._try_sending(self._send_block)
            if isinstance(self._target, Path):  # in a viewer, the user may have changed the layout
                self._try_sending(lambda: self._stream.send_blueprint(self._create_layout()))

    def _send_block(self) -> None:
        """Send the new frames of all robots."""
        n_rows = sum(reference.frames for reference in self._simulation.references)
        n_columns = sum(map(len, self._log.columns.values()))
        self._check_disk(VALUE_BYTES * n_rows * n_columns)
        if not self._channels:
            self._begin()
        elif self._channels != list(self._log.columns):  # a controller records a new channel
            self._stream.send_blueprint(self._create_layout())
        begin = self._n_sent
        new_frames = np.arange(begin, self._log.length)
        self._n_sent = self._log.length
        for i, robot in enumerate(self._robots):
            frames = new_frames[new_frames < robot.length]
            if frames.size:
                first_frame = max(int(frames[0]) - plots.HISTORY_FRAMES, 0)
                recent = replace(robot, first_frame=first_frame)
                scene.send_robot(self._stream, recent, frames, self._flag_heights[robot.layer])
                self._send_series(recent, frames)
            new_events = [
                event
                for event in events.row_events(
                    self._log, robot.row, self._simulation.failures, begin
                )
                if event.kind == events.FAULT or event.kind not in self._event_kinds[i]
            ]
            self._send_events(robot, new_events)
            self._event_kinds[i].update(event.kind for event in new_events)

    def _begin(self) -> None:
        """Open the stream and send everything that does not change."""
        n_frames = max(reference.frames for reference in self._simulation.references)
        self._open(self._create_layout(), has_index=n_frames <= MAX_INDEXED_FRAMES)
        scenario = self._simulation.scenario
        name = f"{scenario.name} on {scenario.plant}, seed {self._log.rows[0].seed}"
        self._stream.send_recording_name(name)
        scene.log_static(self._stream, self._robots)
        scene.log_references(self._stream, self._references)

    def _create_layout(self) -> rrb.Blueprint:
        """Return the viewer's layout for the channels recorded so far."""
        self._channels = list(self._log.columns)
        self._tabs = plots.create_tabs(self._log)
        names = [robot.name for robot in self._robots]
        is_live = isinstance(self._target, str)
        return create_layout(names, self._references, self._tabs, self._extremes, is_live)

    def _send_series(self, robot: RecordedRobot, frames: Frames) -> None:
        """Send a robot's plots, each from the block of its first value on; NaN is a gap."""
        for plot in chain(*self._tabs.values()):
            entity = f"plots/{plot.path}/{robot.name}"
            values = plot.compute(robot)[frames - robot.first_frame]
            low, high = self._extremes[plot.path]
            self._extremes[plot.path] = (
                np.fmin.reduce(values, axis=None, initial=low),
                np.fmax.reduce(values, axis=None, initial=high),
            )
            if entity not in self._open_series:
                if np.isnan(values).all():
                    continue
                self._open_series.add(entity)
                self._stream.log(entity, plot.line_style(robot), static=True)
            self._stream.send_frames(entity, frames, rr.Scalars.columns(scalars=values))

    def _send_events(self, robot: RecordedRobot, new_events: Sequence[events.Event]) -> None:
        """Send new events of a robot."""
        if new_events:
            columns = rr.TextLog.columns(
                text=[f"{event.time_s:.2f} s  {robot.name}: {event.text}" for event in new_events],
                color=[robot.color] * len(new_events),
            )
            frames = np.array([event.frame for event in new_events])
            self._stream.send_frames(f"events/{robot.name}", frames, columns)


class ServedRecording(RerunStream):
    """A recording of served robots in a file or in a viewer.

    Args:
        target: Path of the .rrd file, or address of the viewer.
        settings: Settings of the robots.
    """

    def __init__(self, target: Path | str, settings: Settings) -> None:
        super().__init__(target)
        self._settings = settings
        self._logged_robots = set[str]()  # names of robots whose shapes are logged
        self._present_robots = set[str]()  # names of robots of the last block
        self._try_sending(self._begin)

    def send(self, log: Log) -> None:
        """Send a block of frames, see `omni_mj.live.serve.recorder.Recorder`."""
        self._try_sending(self._send_block, log)

    def _begin(self) -> None:
        """Open the stream and log the field."""
        field = rrb.Spatial3DView(origin="world", name="field", line_grid=False)
        plot_views = [
            rrb.TimeSeriesView(origin=f"plots/{channel}", name=title)
            for channel, title in SERVED_PLOT_TITLES.items()
        ]
        time = rrb.TimePanel(timeline=TIME, play_state="following", state="collapsed")
        columns = rrb.Horizontal(field, rrb.Tabs(*plot_views), column_shares=[3, 2])
        self._open(rrb.Blueprint(columns, time, collapse_panels=True), has_index=False)
        scene.log_field(self._stream, self._settings.world)

    def _send_block(self, log: Log) -> None:
        """Send poses and plots of the robots, and hide those that are no longer present."""
        self._check_disk(TABLE_BYTES)
        names = [f"{row.controller} {row.slot}" for row in log.rows]
        frames = log.first_frame + np.arange(log.length)
        hidden = robot_shapes.pose_columns(np.zeros((1, 3)), HIDDEN_HEIGHT_M)
        for name in self._present_robots - set(names):
            self._stream.send_frames(f"world/{name}", frames[:1], hidden)
        self._present_robots = set(names)
        for i, name in enumerate(names):
            entity = f"world/{name}"
            if name not in self._logged_robots:
                self._logged_robots.add(name)
                color = TEAM_COLORS[log.rows[i].controller]
                robot_shapes.log_robot(self._stream, entity, color, self._settings)
            pose, angles = (log.channel_of_row(key, i) for key in ("pose", "wheel_angle"))
            robot_shapes.send_poses(self._stream, entity, frames, pose, angles, self._settings)
            for channel in SERVED_PLOT_TITLES:
                values = rr.Scalars.columns(scalars=log.channel_of_row(channel, i))
                self._stream.send_frames(f"plots/{channel}/{name}", frames, values)
