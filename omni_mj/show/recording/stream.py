"""A recording: what the first robot of each controller does, sent in blocks while the run goes on."""

import uuid
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import TracebackType

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from omni_control.errors import OmniError
from omni_control.kinematics import Array
from omni_mj.files import check_room
from omni_mj.measure.events import Watch
from omni_mj.scenarios.settings import FRAME_RATE_HZ
from omni_mj.show.recording import patience, robots, scene, tabs, texts
from omni_mj.show.recording.layout import blueprint
from omni_mj.show.recording.robots import Robot, Track
from omni_mj.show.recording.timelines import Frames, indexes
from omni_mj.simulate.simulation import Simulation
from omni_mj.worlds.build import kinematics

APPLICATION = "omni-mj"
NUMBER_B = 8  # of a table, before it is packed


class Recording:
    """What files and viewers have in common; a context manager.

    What cannot be recorded costs the recording, which ends there, and never the run that it shows.

    It begins with the first frame, when it is known which channels controllers record of their own; and anew when the
    simulation was reset, without what was recorded before.

    Args:
        simulation: whose log is recorded.
        block_frames: frames to send at a time; what a killed process loses at most.
        live: follow what is recorded, instead of waiting at its start.
    """

    def __init__(self, simulation: Simulation, block_frames: int, live: bool) -> None:
        rr.set_strict_mode(True)  # otherwise what rerun refuses is silently missing
        self._simulation, self._block_frames, self._live = simulation, block_frames, live
        self._stream: rr.RecordingStream | None = None
        self._log, self._sent = simulation.log, 0
        self._failure: str | None = None

    def __enter__(self) -> "Recording":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        with self._costs_the_run_nothing():
            if stream := self._begun():
                self._flush(stream, last=True)

    def update(self) -> None:
        """Send what was recorded since the last time if it fills a block."""
        with self._costs_the_run_nothing():
            if self._current() and self._log.length - self._sent >= self._block_frames:
                self._write()

    def write(self) -> None:
        """Send what was recorded since the last time, so that whatever ends the run leaves it readable."""
        with self._costs_the_run_nothing():
            self._write()

    def finish(self, summary: str) -> None:
        """Send the result, a Markdown text."""
        with self._costs_the_run_nothing():
            if stream := self._begun():
                texts.log(stream, "summary", summary)
                self._flush(stream)

    def _write(self) -> None:
        stream = self._current()
        if stream and self._log.length > self._sent:
            frames = np.arange(self._sent, self._log.length)
            self._sent = self._log.length
            self._send(stream, frames)
            self._flush(stream)

    @contextmanager
    def _costs_the_run_nothing(self) -> Iterator[None]:
        try:
            yield
        except Exception as error:  # whatever rerun refuses, and whatever is wrong here
            self._fail(error)

    def _connect(self, stream: rr.RecordingStream) -> None:
        """Say where the stream leads."""
        raise NotImplementedError

    def _current(self) -> rr.RecordingStream | None:
        """The stream of the simulation's present log, begun anew where that is another; see `_begun`."""
        if self._stream and self._log is not self._simulation.log and self._simulation.log.length:
            self._flush(self._stream, last=True)
            self._stream = None
        return self._begun()

    def _begun(self) -> rr.RecordingStream | None:
        """The stream, begun if it is not; None if what is sent does not arrive."""
        if not self._failure and self._stream is None:
            self._begin()
        return None if self._failure else self._stream

    def _begin(self) -> None:
        """Make a stream and send what stays."""
        simulation = self._simulation
        chosen, log = simulation.scenario, simulation.log
        self._log, self._sent = log, 0
        self._robots = robots.shown(log.rows)
        followed = [simulation.references[robot.row] for robot in self._robots]
        self._paths: list[Array] = [each.poses for each in {id(each): each for each in followed}.values()]
        self._watches = [Watch(log, robot.row) for robot in self._robots]
        telemetry = simulation.plant.telemetry().named()
        absent = {name for name, values in telemetry.items() if np.isnan(values).all()}  # a plant may have no wheels
        wheels = kinematics(log.rows[0].settings.wheels)
        self._tabs = tabs.tabs(wheels, absent)
        self._unshown = [(robot, *shape) for robot in self._robots for shape in scene.shapes(robot)]
        self._lines = tabs.drawn(self._tabs, self._robots, len(wheels.azimuths))
        self._tabs[tabs.OWN_TAB] = tabs.own(log.columns)

        # Sent when it is flushed, and never by the clock, which would have equal runs differ in the order of chunks.
        batches = rr.ChunkBatcherConfig.NEVER()
        stream = rr.RecordingStream(APPLICATION, recording_id=uuid.uuid4(), batcher_config=batches)
        stream.set_log_time_enabled(False)
        self._stream = stream
        self._connect(stream)
        seed = log.rows[0].seed
        stream.send_recording_name(f"{chosen.name} on {chosen.plant}, seed {seed}")
        scene.log_static(stream, self._robots, log.rows[0].settings, self._paths)
        for line in self._lines:
            stream.log(line.entity, line.style(), static=True)
        texts.log(stream, "settings", texts.settings(chosen, log.controllers, seed))
        texts.log(stream, "summary", "The run has not ended; its summary follows.")
        self._flush(stream)

    def _send(self, stream: rr.RecordingStream, frames: Frames) -> None:
        scene.send_targets(stream, self._paths, frames)
        self._add_own(stream, frames)
        for robot, watch in zip(self._robots, self._watches, strict=True):
            track = Track(self._log, robot.row)
            texts.send_events(stream, robot, watch.new(self._simulation.failures))
            recorded = frames[frames < track.length]
            if recorded.size:
                scene.send(stream, robot, self._log.rows[robot.row].settings, track, recorded)
                self._show_beliefs(stream, robot, track, recorded)
                for line in self._lines:
                    if line.robot is robot:
                        stream.send_columns(line.entity, indexes(recorded), line.columns(track, recorded))

    def _show_beliefs(self, stream: rr.RecordingStream, robot: Robot, track: Track, frames: Frames) -> None:
        """Show what is believed of a robot from the first frame on in which something is."""
        for waiting in [each for each in self._unshown if each[0] is robot]:
            _, channel, entity, shape = waiting
            known = frames[~np.isnan(track[channel][frames, 0])]
            if known.size:
                stream.send_columns(entity, indexes(known[:1]), shape)
                self._unshown.remove(waiting)

    def _add_own(self, stream: rr.RecordingStream, frames: Frames) -> None:
        """Begin the lines of controllers' own channels that have come to hold numbers."""
        plots = self._tabs[tabs.OWN_TAB]
        more = [plot for plot in tabs.own(self._log.columns) if plot.entity not in {each.entity for each in plots}]
        if more:
            plots += more
            stream.send_blueprint(self._blueprint())
        begun = {line.entity for line in self._lines}
        for line in tabs.drawn({tabs.OWN_TAB: plots}, self._robots, 0):
            values = self._log.channel(line.series.channel)[frames, line.robot.row]
            if line.entity not in begun and not np.isnan(values).all():
                stream.log(line.entity, line.style(), static=True)
                self._lines.append(line)

    def _flush(self, stream: rr.RecordingStream, last: bool = False) -> None:
        try:
            patience.flush(stream)
            if last:
                stream.disconnect()
        except RuntimeError as failure:
            self._fail(failure)

    def _fail(self, failure: Exception) -> None:
        """Give up: what is sent does not arrive."""
        said = str(failure) if isinstance(failure, OmniError) else f"{type(failure).__name__}: {failure}"
        self._failure = self._failure or " ".join(said.split())

    def _blueprint(self) -> rrb.Blueprint:
        return blueprint([robot.name for robot in self._robots], self._paths, self._tabs, self._live)


class FileRecording(Recording):
    """An .rrd file, which ends where the disk has no more room than the numbers will need.

    Args:
        path: of the file; its folder must exist.
        simulation: whose log is recorded.
    """

    def __init__(self, path: Path, simulation: Simulation) -> None:
        super().__init__(simulation, block_frames=5 * FRAME_RATE_HZ, live=False)
        self._path = path

    def _connect(self, stream: rr.RecordingStream) -> None:
        self._check_room()
        stream.save(self._path, default_blueprint=self._blueprint())

    def _send(self, stream: rr.RecordingStream, frames: Frames) -> None:
        self._check_room()
        super()._send(stream, frames)

    def _check_room(self) -> None:
        followed = sum(reference.frames for reference in self._simulation.references)
        check_room(self._path.parent, NUMBER_B * followed * sum(map(len, self._log.columns.values())))

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        """End the file.

        Raises:
            OSError: not all of it could be written.
        """
        super().__exit__(kind, error, traceback)
        if self._failure:
            raise OSError(None, f"the recording could not be written to its end: {self._failure}", str(self._path))
