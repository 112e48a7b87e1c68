"""A recording of robots that others drive: they come and go, and nobody knows how long it lasts."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import rerun.blueprint as rrb

from omni_mj.config.settings import Settings
from omni_mj.files import check_room
from omni_mj.simulation.log import Log
from omni_mj.viz.recording import scene
from omni_mj.viz.recording.rerun_stream import RerunStream

PLOTS = (
    "command",
    "wheel_speed",
    "current",
    "winding",
    "battery",
)  # channels of each robot that are plotted
TEAMS = {"blue": (60, 110, 230), "yellow": (235, 200, 40)}
TABLE_BYTES = 20e6  # of disk, that a recording leaves to the table, which goes on
BELOW_M = 10.0  # the carpet: where robots are that are not there


class ServedRecording(RerunStream):
    """A recording of served robots in a file, or in a viewer.

    Args:
        target: Path of the .rrd file, or address of the viewer.
        settings: Of the robots.
    """

    def __init__(self, target: Path | str, settings: Settings) -> None:
        super().__init__(target)
        self._settings = settings
        self._shown, self._present = set[str](), set[str]()
        self._attempt(self._begin)

    def send(self, names: Sequence[str], log: Log) -> None:
        """Send a block of frames.

        Args:
            names: Of the robots: team and number.
            log: Of their rows.
        """
        self._attempt(self._send, names, log)

    def _begin(self) -> None:
        field = rrb.Spatial3DView(origin="world", name="field", line_grid=False)
        plots = rrb.Tabs(
            *(rrb.TimeSeriesView(origin=f"plots/{channel}", name=channel) for channel in PLOTS)
        )
        time = rrb.TimePanel(timeline=scene.TIME, play_state="following", state="collapsed")
        layout = rrb.Blueprint(
            rrb.Horizontal(field, plots, column_shares=[3, 2]), time, collapse_panels=True
        )
        self._open(layout, footer=False)
        scene.log_field(self._stream)

    def _send(self, names: Sequence[str], log: Log) -> None:
        if isinstance(self._target, Path):
            check_room(self._target.parent, TABLE_BYTES)
        frames = log.first_frame + np.arange(log.length)
        time = scene.indexes(frames)
        out_of_sight = scene.transform(
            np.zeros((1, 3)), -BELOW_M
        )  # shapes are static, which nothing clears
        for name in self._present - set(names):
            self._stream.send_columns(f"world/{name}", scene.indexes(frames[:1]), out_of_sight)
        self._present = set(names)
        for row, name in enumerate(names):
            entity = f"world/{name}"
            if name not in self._shown:
                self._shown.add(name)
                scene.log_robot(self._stream, entity, TEAMS[name.split()[0]], self._settings)
            pose, angles = (log.channel(channel)[:, row] for channel in ("pose", "wheel_angle"))
            scene.send_pose(self._stream, entity, time, pose, angles, self._settings)
            for channel in PLOTS:
                values = scene.scalars(log.channel(channel)[:, row])
                self._stream.send_columns(f"plots/{channel}/{name}", time, values)
