"""A recording: what the first robots of each controller do, sent in blocks while the run goes on."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from omni_control.errors import OmniError
from omni_mj.files import check_room
from omni_mj.measure import events
from omni_mj.scenarios.settings import FRAME_RATE_HZ
from omni_mj.show import full
from omni_mj.show.recording import plots, scene
from omni_mj.show.recording.layout import blueprint
from omni_mj.show.recording.plots import Robot
from omni_mj.show.recording.sink import Frames, flush, indexes, open_stream
from omni_mj.simulate.simulation import Simulation

NUMBER_B = 8  # of a table, before compression
ERRORS = (events.STOPPED, events.TEMPERATURE, events.BATTERY)
NOTES = (events.VISION, events.WAY_POINT)


class Recording:
    """Common part of recordings to files and to viewers; a context manager.

    A failure ends the recording and never the run that it shows. The stream begins with the first block.

    Args:
        simulation: Simulation whose log is recorded.
        block_frames: Frames to send at a time, and so the most that a killed process loses.
        live: Follow what is recorded instead of waiting at its start.
    """

    def __init__(self, simulation: Simulation, block_frames: int, live: bool) -> None:
        self._simulation, self._block_frames, self._live = simulation, block_frames, live
        self._log, self._sent = simulation.log, 0
        self._stream: rr.RecordingStream | None = None
        self._failure = ""
        self._known: set[str] = set()  # entities whose shape or look was logged

    def __enter__(self) -> "Recording":
        return self

    def __exit__(self, *error: object) -> None:
        with self._guarded():
            if self._stream and not self._failure:
                flush(self._stream)
                self._stream.disconnect()

    def update(self) -> None:
        """Send what was recorded since the last time if it fills a block."""
        if self._log.length - self._sent >= self._block_frames:
            self.write()

    def write(self) -> None:
        """Send what was recorded since the last time, so that it stays readable whatever ends the run."""
        with self._guarded():
            if self._failure or not self._log.length:
                return
            stream = self._stream or self._begin()
            frames = np.arange(self._sent, self._log.length)
            self._sent = self._log.length
            if frames.size:
                self._send(stream, frames)
            for robot, watch in zip(self._robots, self._watches, strict=True):
                _send_events(stream, robot, watch.new(self._simulation.failures))
            flush(stream)

    def finish(self, summary: str) -> None:
        """Send the result, a Markdown text."""
        with self._guarded():
            if self._stream and not self._failure:
                _log_text(self._stream, "summary", summary)
                flush(self._stream)

    @contextmanager
    def _guarded(self) -> Iterator[None]:
        """Turn any exception into the recording's failure."""
        try:
            yield
        except Exception as error:  # rerun refused something, or something is wrong here
            self._fail(error)

    def _connect(self, stream: rr.RecordingStream) -> None:
        """Lead the stream to its file or viewer."""
        raise NotImplementedError

    def _begin(self) -> rr.RecordingStream:
        """Return a new stream, to which everything that does not change was sent."""
        simulation, log = self._simulation, self._log
        self._robots = plots.shown_robots(log)
        references = [simulation.references[robot.row] for robot in self._robots]
        self._paths = [reference.poses for reference in {id(r): r for r in references}.values()]
        self._watches = [events.Watch(log, robot.row) for robot in self._robots]
        self._tabs = plots.tabs(log.rows[0].settings.wheels.kinematics, log)
        # Sent when it is flushed and never by the clock, or equal runs would differ in the order of chunks.
        stream = open_stream(rr.ChunkBatcherConfig.NEVER())
        self._connect(stream)
        self._stream = stream
        chosen, seed = simulation.scenario, log.rows[0].seed
        stream.send_recording_name(f"{chosen.name} on {chosen.plant}, seed {seed}")
        scene.log_static(stream, self._robots, log.rows[0].settings, self._paths)
        _log_text(stream, "settings", full.scenario(chosen), rr.MediaType.TEXT)
        _log_text(stream, "summary", "The run has not ended; its summary follows.")
        return stream

    def _send(self, stream: rr.RecordingStream, frames: Frames) -> None:
        scene.send_targets(stream, self._paths, frames)
        own = plots.own_plots(self._log.columns)
        if len(own) > len(self._tabs[plots.OWN_TAB]):
            self._tabs[plots.OWN_TAB] = own
            stream.send_blueprint(self._blueprint())
        for robot in self._robots:
            recorded = frames[frames < robot.length]
            if recorded.size:
                scene.send(stream, robot, recorded, self._known)
                self._send_series(stream, robot, recorded)

    def _send_series(self, stream: rr.RecordingStream, robot: Robot, frames: Frames) -> None:
        """Send a robot's series from their first number on; NaN leaves a gap."""
        for plot in (plot for tab in self._tabs.values() for plot in tab):
            for series in plot.series:
                entity, values = series.path(plot, robot), series.values(robot, frames)
                known = np.asarray(~np.isnan(values).any(1))
                begin = 0
                if entity not in self._known and known.any():
                    self._known.add(entity)
                    stream.log(entity, series.look(plot, robot), static=True)
                    begin = int(known.argmax())
                if entity in self._known:
                    known, values = known[begin:], values[begin:]
                    columns = rr.Scalars.columns(scalars=values[known].ravel()).partition(known * values.shape[1])
                    stream.send_columns(entity, indexes(frames[begin:]), columns)

    def _fail(self, failure: Exception) -> None:
        """Give up, as what is sent does not arrive."""
        text = str(failure) if isinstance(failure, OmniError) else f"{type(failure).__name__}: {failure}"
        self._failure = self._failure or " ".join(text.split())

    def _blueprint(self) -> rrb.Blueprint:
        return blueprint([robot.name for robot in self._robots], self._paths, self._tabs, self._live)


class FileRecording(Recording):
    """An .rrd file, which ends if the disk has no more room than the numbers will need.

    Args:
        path: Path of the file; its folder must exist.
        simulation: Simulation whose log is recorded.
    """

    def __init__(self, path: Path, simulation: Simulation) -> None:
        super().__init__(simulation, block_frames=5 * FRAME_RATE_HZ, live=False)
        self._path = path

    def _connect(self, stream: rr.RecordingStream) -> None:
        stream.save(self._path, default_blueprint=self._blueprint())

    def _send(self, stream: rr.RecordingStream, frames: Frames) -> None:
        numbers = sum(reference.frames for reference in self._simulation.references)
        check_room(self._path.parent, NUMBER_B * numbers * sum(map(len, self._log.columns.values())))
        super()._send(stream, frames)

    def __exit__(self, *error: object) -> None:
        """End the file.

        Raises:
            OSError: Not all of it could be written.
        """
        super().__exit__(*error)
        if self._failure:
            raise OSError(None, f"the recording could not be written to its end: {self._failure}", str(self._path))


def _log_text(stream: rr.RecordingStream, entity: str, text: str, kind: rr.MediaType = rr.MediaType.MARKDOWN) -> None:
    """Show a text in place of one that was there before."""
    stream.log(entity, rr.TextDocument(text, media_type=kind), static=True)


def _send_events(stream: rr.RecordingStream, robot: Robot, happened: Sequence[events.Event]) -> None:
    """Send what happened to a robot."""
    if happened:
        kinds = [event.kind for event in happened]
        columns = rr.TextLog.columns(
            text=[f"{event.time_s:.2f} s  {robot.name}: {event.text}" for event in happened],
            level=["ERROR" if kind in ERRORS else "INFO" if kind in NOTES else "WARN" for kind in kinds],
            color=[robot.colour] * len(happened),
        )
        stream.send_columns(f"events/{robot.name}", indexes(np.array([event.frame for event in happened])), columns)
