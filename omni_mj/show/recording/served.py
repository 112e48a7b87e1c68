"""A recording of robots that others drive: they come and go, and nobody knows how long it lasts."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import click
import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from omni_control.errors import OmniError
from omni_mj.files import check_room
from omni_mj.scenarios.settings import Settings
from omni_mj.show.recording import flush, open_stream, scene
from omni_mj.show.recording.scene import TIME, indexes
from omni_mj.show.recording.viewer import answers
from omni_mj.simulate.log import Log

PLOTS = "command", "wheel_speed", "current", "winding", "battery"  # channels of each robot that are plotted
TEAMS = {"blue": (60, 110, 230), "yellow": (235, 200, 40)}
TABLE_BYTES = 20e6  # of disk, that a recording leaves to the table, which goes on
BELOW_M = 10.0  # the carpet: where robots are that are not there


class ServedRecording:
    """A file or a viewer that is fed. If it fails, that is said, and what is served goes on without it.

    Args:
        target: Path of the .rrd file, or address of the viewer.
        settings: Of the robots.
    """

    def __init__(self, target: Path | str, settings: Settings) -> None:
        self._target, self._settings = target, settings
        self._shown, self._present = set[str](), set[str]()
        self._has_failed, self._stream = False, open_stream()
        with self._warning():
            if isinstance(target, Path):  # without a footer, which rerun would hold in memory until the end
                self._stream.save(target, _blueprint(), write_footer=False)
            elif answers(target):
                self._stream.connect_grpc(target, default_blueprint=_blueprint())
            else:
                raise RuntimeError("no viewer answers")
            scene.log_field(self._stream)

    def send(self, names: Sequence[str], log: Log) -> None:
        """Send a block of frames.

        Args:
            names: Of the robots: team and number.
            log: Of their rows.
        """
        with self._warning():
            if self._has_failed:
                return
            if isinstance(self._target, Path):
                check_room(self._target.parent, TABLE_BYTES)
            frames = log.first_frame + np.arange(log.length)
            out_of_sight = scene.transform(np.zeros((1, 3)), -BELOW_M)  # shapes are static, which nothing clears
            for name in self._present - set(names):
                self._stream.send_columns(f"world/{name}", indexes(frames[:1]), out_of_sight)
            self._present = set(names)
            for row, name in enumerate(names):
                self._send(name, indexes(frames), {channel: log.channel(channel)[:, row] for channel in log.columns})

    def close(self) -> None:
        """End it."""
        with self._warning():
            flush(self._stream)
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

    def _send(self, name: str, time: list[rr.TimeColumn], channels: dict[str, np.ndarray]) -> None:
        if name not in self._shown:
            self._shown.add(name)
            scene.log_robot(self._stream, f"world/{name}", TEAMS[name.split()[0]], self._settings)
        scene.send_pose(self._stream, f"world/{name}", time, channels["pose"], channels["wheel_angle"], self._settings)
        for channel in PLOTS:
            values = channels[channel]
            columns = rr.Scalars.columns(scalars=values.ravel()).partition(np.full(len(values), values.shape[1]))
            self._stream.send_columns(f"plots/{channel}/{name}", time, columns)


def _blueprint() -> rrb.Blueprint:
    field = rrb.Spatial3DView(origin="world", name="field", line_grid=False)
    plots = rrb.Tabs(*(rrb.TimeSeriesView(origin=f"plots/{channel}", name=channel) for channel in PLOTS))
    time = rrb.TimePanel(timeline=TIME, play_state="following", state="collapsed")
    return rrb.Blueprint(rrb.Horizontal(field, plots, column_shares=[3, 2]), time, collapse_panels=True)
