"""A recording of the robots of `omni-mj serve`, which appear, disappear, and run without end."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import rerun.blueprint as rrb

from omni_mj.config.settings import Settings
from omni_mj.files import check_disk_space
from omni_mj.simulation.log import Log
from omni_mj.viz.recording import robot_shapes, scene
from omni_mj.viz.recording.rerun_stream import TIME, RerunStream, scalar_columns, time_columns

PLOT_TITLES = {  # channel of the log -> title
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

    def send(self, names: Sequence[str], log: Log) -> None:
        """Send a block of frames.

        Args:
            names: Names of the robots, team and number, in the order of the log's rows.
            log: Log of the block.
        """
        self._try_sending(self._send_block, names, log)

    def _begin(self) -> None:
        """Open the stream and log the field."""
        field = rrb.Spatial3DView(origin="world", name="field", line_grid=False)
        plots = rrb.Tabs(
            *(
                rrb.TimeSeriesView(origin=f"plots/{channel}", name=title)
                for channel, title in PLOT_TITLES.items()
            )
        )
        time = rrb.TimePanel(timeline=TIME, play_state="following", state="collapsed")
        columns = rrb.Horizontal(field, plots, column_shares=[3, 2])
        self._open(rrb.Blueprint(columns, time, collapse_panels=True), footer=False)
        scene.log_field(self._stream)

    def _send_block(self, names: Sequence[str], log: Log) -> None:
        """Send poses and plots of the robots, and hide those that are no longer present."""
        if isinstance(self._target, Path):
            check_disk_space(self._target.parent, TABLE_BYTES)
        frames = log.first_frame + np.arange(log.length)
        hidden = robot_shapes.pose_columns(np.zeros((1, 3)), HIDDEN_HEIGHT_M)
        for name in self._present_robots - set(names):
            self._stream.send_columns(f"world/{name}", time_columns(frames[:1]), hidden)
        self._present_robots = set(names)
        for row, name in enumerate(names):
            entity = f"world/{name}"
            if name not in self._logged_robots:
                self._logged_robots.add(name)
                color = TEAM_COLORS[name.split()[0]]
                robot_shapes.log_robot(self._stream, entity, color, self._settings)
            pose, angles = log.channel("pose")[:, row], log.channel("wheel_angle")[:, row]
            robot_shapes.send_poses(self._stream, entity, frames, pose, angles, self._settings)
            for channel in PLOT_TITLES:
                values = scalar_columns(log.channel(channel)[:, row])
                self._stream.send_columns(f"plots/{channel}/{name}", time_columns(frames), values)
