"""A recording: what a run's first seed does, all controllers in it, sent in blocks while the run goes on."""

import uuid
from pathlib import Path
from types import TracebackType

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from omni_mj.measure import events
from omni_mj.scenarios.settings import FRAME_RATE_HZ
from omni_mj.show.recording import scene, series, texts
from omni_mj.show.recording.layout import blueprint
from omni_mj.show.recording.series import Track
from omni_mj.show.recording.timelines import indexes
from omni_mj.simulate.simulation import Simulation

APPLICATION = "omni-mj"


class Recording:
    """What files and viewers have in common; a context manager.

    Args:
        simulation: whose trajectory is recorded.
        block_frames: frames to send at a time; what a killed process loses at most.
        live: follow what is recorded, instead of waiting at its start.
    """

    def __init__(self, simulation: Simulation, block_frames: int, live: bool) -> None:
        rr.set_strict_mode(True)  # otherwise what rerun refuses is silently missing
        self._simulation, self._block_frames, self._live = simulation, block_frames, live
        self._sent = 0
        self._failure: str | None = None
        self._controllers = simulation.scenario.labels
        telemetry = vars(simulation.plant.telemetry())
        absent = {name for name, values in telemetry.items() if np.isnan(values).all()}  # a plant may have no wheels
        self._series = series.drawn(self._controllers, absent)
        self._stream = rr.RecordingStream(APPLICATION, recording_id=uuid.uuid4())
        self._stream.set_log_time_enabled(False)

    def __enter__(self) -> "Recording":
        self._stream.__enter__()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        try:
            self._stream.__exit__(kind, error, traceback)
        except RuntimeError as failure:
            self._fail(failure)

    def update(self) -> None:
        """Send what was recorded since the last time if it fills a block."""
        if self._simulation.trajectory.length - self._sent >= self._block_frames:
            self.write()

    def write(self) -> None:
        """Send what was recorded since the last time, so that whatever ends the run leaves it readable."""
        frames = np.arange(self._sent, self._simulation.trajectory.length)
        if frames.size and not self._failure:
            self._sent = int(frames[-1]) + 1
            self._send(frames)
            self._flush()

    def finish(self, summary: str) -> None:
        """Send the result, a Markdown text."""
        if not self._failure:
            texts.log(self._stream, "summary", summary)
            self._flush()

    def _begin(self) -> None:
        """Send what stays."""
        stream, chosen = self._stream, self._simulation.scenario
        stream.send_recording_name(f"{chosen.name} on {chosen.plant}, seed {chosen.seed}")
        scene.log_static(stream, self._controllers, self._simulation.reference.poses)
        for line in self._series:
            stream.log(line.entity, line.style(), static=True)
        texts.log(stream, "settings", texts.settings(chosen))
        texts.log(stream, "summary", "The run has not ended; its summary follows.")
        self._flush()

    def _send(self, frames: np.ndarray) -> None:
        stream, trajectory, time = self._stream, self._simulation.trajectory, indexes(frames)
        scene.send_target(stream, trajectory.channel("ref")[frames, 0, 0], frames)
        happened = events.find_all(trajectory, self._simulation.scenario.settings)
        tracks = [Track(trajectory, i) for i in range(len(self._controllers))]
        for i, name in enumerate(self._controllers):
            scene.send(stream, name, i, tracks[i], frames)
            own = [event for event in happened if event.controller == name and event.frame >= frames[0]]
            texts.send_events(stream, name, i, own)
        for line in self._series:
            stream.send_columns(line.entity, time, line.columns(tracks[line.controller], frames))

    def _flush(self) -> None:
        try:
            self._stream.flush()
        except RuntimeError as failure:
            self._fail(failure)

    def _fail(self, failure: RuntimeError) -> None:
        """Give up: what is sent does not arrive."""
        self._failure = self._failure or str(failure)

    def _blueprint(self) -> rrb.Blueprint:
        present = {line.plot for line in self._series}
        tabs = {tab: [plot for plot in plots if plot in present] for tab, plots in series.TABS.items()}
        return blueprint(self._controllers, self._simulation.reference.poses, tabs, self._live)


class FileRecording(Recording):
    """An .rrd file.

    Args:
        path: of the file; its folder must exist.
        simulation: whose trajectory is recorded.
    """

    def __init__(self, path: Path, simulation: Simulation) -> None:
        super().__init__(simulation, block_frames=5 * FRAME_RATE_HZ, live=False)
        self._path = path
        self._stream.save(path, default_blueprint=self._blueprint())
        self._begin()

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
