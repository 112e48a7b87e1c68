"""Recordings for the rerun viewer: what the first robots of each controller do, sent in blocks while a run goes on."""

import atexit
import ctypes
import os
import uuid
from collections.abc import Callable, Sequence
from pathlib import Path

# rerun's log would break into lines of our own; what matters in it comes back as an exception.
os.environ.setdefault("RUST_LOG", "off")

import click
import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from omni_control.errors import OmniError
from omni_mj.files import check_room
from omni_mj.measure import events
from omni_mj.scenarios.settings import FRAME_RATE_HZ
from omni_mj.show import listing
from omni_mj.show.recording import plots, scene
from omni_mj.show.recording.layout import blueprint
from omni_mj.show.recording.viewer import answers
from omni_mj.show.shown import Robot, shown_robots
from omni_mj.simulate.simulation import Simulation

BLOCK_FRAMES = 5 * FRAME_RATE_HZ  # to write at a time, and so the most that a killed process loses
LIVE_BLOCK_FRAMES = FRAME_RATE_HZ // 2
FLUSH_S = 30.0  # a block has a megabyte
NUMBER_B = 8  # of a table, before compression


class Recording:
    """A recording of a run in a file, or in a viewer while it goes on; a context manager.

    The stream begins with the first block. A failure ends the recording and never the run that it shows. If a viewer is
    not there, or goes away, that costs a line on stderr. A file ends if the disk has no more room than the numbers will
    need.

    Args:
        target: Path of the .rrd file, whose folder must exist, or address of the viewer.
        simulation: Simulation whose log is recorded.
    """

    def __init__(self, target: Path | str, simulation: Simulation) -> None:
        self._target, self._simulation, self._log = target, simulation, simulation.log
        self._stream: rr.RecordingStream | None = None
        self._sent, self._failure = 0, ""
        self._begun = set[str]()  # entities of series that have begun
        self._columns: Sequence[str] = ()  # channels of which the layout knows
        self._robots = shown_robots(self._log)
        references = [simulation.references[robot.row] for robot in self._robots]
        self._paths = [reference.poses for reference in dict.fromkeys(references)]
        self._n_events = [0] * len(self._robots)  # that were sent
        if isinstance(target, str) and not answers(target):
            self._fail("nobody answers")

    def __enter__(self) -> "Recording":
        return self

    def __exit__(self, *error: object) -> None:
        """End it.

        Raises:
            OSError: Not all of a file could be written.
        """
        if self._stream and not self._failure:  # flushed after all that was sent
            self._stream.disconnect()
        if self._failure and isinstance(self._target, Path):
            text = f"the recording could not be written to its end: {self._failure}"
            raise OSError(None, text, str(self._target))

    def update(self) -> None:
        """Send what was recorded since the last time if it fills a block."""
        block = BLOCK_FRAMES if isinstance(self._target, Path) else LIVE_BLOCK_FRAMES
        if self._log.length - self._sent >= block:
            self.write()

    def write(self) -> None:
        """Send what was recorded since the last time, so that it stays readable whatever ends the run."""
        if self._log.length:
            self._attempt(self._send)

    def finish(self, summary: str) -> None:
        """Send the result, a Markdown text."""
        self._attempt(self._log_text, "summary", summary)

    def _attempt(self, send: Callable[..., None], *arguments: object) -> None:
        """Call a function and flush, unless the recording has failed; an exception is its failure."""
        if self._failure:
            return
        try:
            send(*arguments)
            if self._stream:
                flush(self._stream)
        except Exception as error:  # rerun refused something, or something is wrong here
            self._fail(str(error) if isinstance(error, OmniError) else f"{type(error).__name__}: {error}")

    def _fail(self, failure: str) -> None:
        """Give up, as what is sent does not arrive."""
        self._failure = " ".join(failure.split())
        if isinstance(self._target, str):
            click.echo(f"warning: no viewer at {self._target}; the run goes on without it", err=True)

    def _begin(self) -> rr.RecordingStream:
        """Return a new stream, to which everything that does not change was sent."""
        # Sent when it is flushed and never by the clock, or equal runs would differ in the order of chunks.
        self._stream = stream = open_stream(rr.ChunkBatcherConfig.NEVER())
        if isinstance(self._target, Path):
            stream.save(self._target, default_blueprint=self._layout())
        else:
            stream.connect_grpc(self._target, default_blueprint=self._layout())
        chosen = self._simulation.scenario
        stream.send_recording_name(f"{chosen.name} on {chosen.plant}, seed {self._log.rows[0].seed}")
        scene.log_static(stream, self._robots, self._paths)
        self._log_text("settings", listing.scenario(chosen), rr.MediaType.TEXT)
        self._log_text("summary", "The run has not ended; its summary follows.")
        return stream

    def _layout(self) -> rrb.Blueprint:
        """Return the layout for the channels that there are now."""
        self._columns, self._tabs = list(self._log.columns), plots.tabs(self._log)
        names = [robot.name for robot in self._robots]
        return blueprint(names, self._paths, self._tabs, live=isinstance(self._target, str))

    def _send(self) -> None:
        log = self._log
        if isinstance(self._target, Path):
            numbers = sum(reference.frames for reference in self._simulation.references)
            check_room(self._target.parent, NUMBER_B * numbers * sum(map(len, log.columns.values())))
        stream = self._stream or self._begin()
        if self._columns != list(log.columns):  # a controller records something else from now on
            stream.send_blueprint(self._layout())
        frames = np.arange(self._sent, log.length)
        self._sent = log.length
        for i, robot in enumerate(self._robots):
            recorded = frames[frames < robot.length]
            if recorded.size:
                scene.send(stream, robot, recorded)
                self._send_series(stream, robot, recorded)
            happened = events.of_row(log, robot.row, self._simulation.failures)
            _send_events(stream, robot, happened[self._n_events[i] :])
            self._n_events[i] = len(happened)

    def _send_series(self, stream: rr.RecordingStream, robot: Robot, frames: scene.Frames) -> None:
        """Send a robot's series, each from the block of its first number on; NaN is a gap."""
        for plot in (plot for tab in self._tabs.values() for plot in tab):
            entity, values = f"plots/{plot.path}/{robot.name}", plot.block(robot, frames[0])
            if entity not in self._begun and not np.isnan(values).all():
                self._begun.add(entity)
                stream.log(entity, plot.look(robot), static=True)
            if entity in self._begun:
                columns = rr.Scalars.columns(scalars=values.ravel()).partition(np.full(len(values), values.shape[1]))
                stream.send_columns(entity, scene.indexes(frames), columns)

    def _log_text(self, entity: str, text: str, kind: rr.MediaType = rr.MediaType.MARKDOWN) -> None:
        """Show a text in place of one that was there before."""
        if self._stream:
            self._stream.log(entity, rr.TextDocument(text, media_type=kind), static=True)


def open_stream(batcher: rr.ChunkBatcherConfig | None = None) -> rr.RecordingStream:
    """Return a stream that leads nowhere yet; rerun's complaints become exceptions."""
    rr.set_strict_mode(True)  # otherwise rejected data is missing without a word
    stream = rr.RecordingStream("omni-mj", recording_id=uuid.uuid4(), batcher_config=batcher)
    stream.set_log_time_enabled(False)
    return stream


def flush(stream: rr.RecordingStream) -> None:
    """Wait until everything sent is written.

    If the writer dies of a full disk just as it is told to flush, rerun waits for it without end: there, when the
    stream is finalized, and when the program exits. The latter two are prevented here.

    Raises:
        RuntimeError: It was not written and will not be.
    """
    try:
        stream.flush(timeout_sec=FLUSH_S)
    except RuntimeError:
        atexit.unregister(rr.rerun_shutdown)
        ctypes.pythonapi.Py_IncRef(ctypes.py_object(stream))  # never finalized
        raise


def _send_events(stream: rr.RecordingStream, robot: Robot, happened: Sequence[events.Event]) -> None:
    """Send what happened to a robot."""
    if happened:
        columns = rr.TextLog.columns(
            text=[f"{event.time_s:.2f} s  {robot.name}: {event.text}" for event in happened],
            color=[robot.colour] * len(happened),
        )
        frames = np.array([event.frame for event in happened])
        stream.send_columns(f"events/{robot.name}", scene.indexes(frames), columns)
