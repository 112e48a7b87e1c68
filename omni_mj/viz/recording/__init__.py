"""Recordings for the rerun viewer: what the first robots of each controller do, sent in blocks while a run goes on."""

import os
from collections.abc import Sequence
from dataclasses import replace
from itertools import chain
from pathlib import Path

# rerun's log would break into lines of our own; what matters in it comes back as an exception.
os.environ.setdefault("RUST_LOG", "off")

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from omni_mj.config.settings import FRAME_RATE_HZ
from omni_mj.files import check_room
from omni_mj.results import events
from omni_mj.simulation.simulation import Simulation
from omni_mj.viz.recorded_robots import RecordedRobot, select_robots
from omni_mj.viz.recording import plots, scene
from omni_mj.viz.recording.layout import blueprint
from omni_mj.viz.recording.rerun_stream import RerunStream

BLOCK_FRAMES = 5 * FRAME_RATE_HZ  # to write at a time, and so the most that a killed process loses
LIVE_BLOCK_FRAMES = FRAME_RATE_HZ // 2
NUMBER_B = 8  # of a table, before compression


class Recording(RerunStream):
    """A recording of a run in a file, or in a viewer while it goes on.

    It begins with the first block. A file ends if the disk has no more room than the numbers will
    need.

    Args:
        target: Path of the .rrd file, whose folder must exist, or address of the viewer.
        simulation: Simulation whose log is recorded.
    """

    def __init__(self, target: Path | str, simulation: Simulation) -> None:
        super().__init__(target)
        self._simulation, self._log, self._sent = simulation, simulation.log, 0
        self._begun = set[str]()  # entities of series that have begun
        self._columns: Sequence[str] = ()  # channels of which the layout knows
        self._robots = select_robots(self._log)
        references = [simulation.references[robot.row] for robot in self._robots]
        self._paths = [reference.poses for reference in dict.fromkeys(references)]
        self._n_events = [0] * len(self._robots)  # that were sent

    def update(self) -> None:
        """Send what was recorded since the last time if it fills a block."""
        block = BLOCK_FRAMES if isinstance(self._target, Path) else LIVE_BLOCK_FRAMES
        if self._log.length - self._sent >= block:
            self.write()

    def write(self) -> None:
        """Send what was recorded since the last time, so that it stays readable whatever ends the run."""
        if self._log.length:
            self._attempt(self._send)

    def _begin(self) -> None:
        """Open the stream and send everything that does not change."""
        self._open(self._layout())
        chosen = self._simulation.scenario
        self._stream.send_recording_name(
            f"{chosen.name} on {chosen.plant}, seed {self._log.rows[0].seed}"
        )
        scene.log_static(self._stream, self._robots, self._paths)

    def _layout(self) -> rrb.Blueprint:
        """Return the layout for the channels that there are now."""
        self._columns, self._tabs = list(self._log.columns), plots.tabs(self._log)
        names = [robot.name for robot in self._robots]
        return blueprint(names, self._paths, self._tabs, live=isinstance(self._target, str))

    def _send(self) -> None:
        log = self._log
        if isinstance(self._target, Path):
            numbers = sum(reference.frames for reference in self._simulation.references)
            check_room(
                self._target.parent, NUMBER_B * numbers * sum(map(len, log.columns.values()))
            )
        if not self._columns:
            self._begin()
        elif self._columns != list(log.columns):  # a controller records something else from now on
            self._stream.send_blueprint(self._layout())
        frames = np.arange(self._sent, log.length)
        self._sent = log.length
        for i, robot in enumerate(self._robots):
            recorded = frames[frames < robot.length]
            if recorded.size:
                scene.send(self._stream, robot, recorded)
                self._send_series(robot, recorded)
            happened = events.of_row(log, robot.row, self._simulation.failures)
            self._send_events(robot, happened[self._n_events[i] :])
            self._n_events[i] = len(happened)

    def _send_series(self, robot: RecordedRobot, frames: scene.Frames) -> None:
        """Send a robot's series, each from the block of its first number on; NaN is a gap."""
        begin = max(int(frames[0]) - plots.HISTORY_FRAMES, 0)
        part = replace(robot, first=begin)
        for plot in chain(*self._tabs.values()):
            entity, values = f"plots/{plot.path}/{robot.name}", plot.values(part)[frames - begin]
            if entity not in self._begun and not np.isnan(values).all():
                self._begun.add(entity)
                self._stream.log(entity, plot.look(robot), static=True)
            if entity in self._begun:
                self._stream.send_columns(entity, scene.indexes(frames), scene.scalars(values))

    def _send_events(self, robot: RecordedRobot, happened: Sequence[events.Event]) -> None:
        """Send what happened to a robot."""
        if happened:
            columns = rr.TextLog.columns(
                text=[f"{event.time_s:.2f} s  {robot.name}: {event.text}" for event in happened],
                color=[robot.colour] * len(happened),
            )
            frames = np.array([event.frame for event in happened])
            self._stream.send_columns(f"events/{robot.name}", scene.indexes(frames), columns)
