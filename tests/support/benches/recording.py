"""Recordings for tests: recorded runs, and .rrd files read back."""

import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray
from rerun.chunk import RrdReader

from omni_control.controllers.base import Controller
from omni_mj.config import scenario
from omni_mj.simulation.simulation import Simulation
from omni_mj.studies.run_scenario import run_simulation
from omni_mj.viz.recording import Recording, rerun_stream

set_flush_timeout = partial(
    setattr, rerun_stream, "FLUSH_TIMEOUT_S"
)  # seconds that a recording waits for its file
RERUN = Path(sys.executable).with_name("rerun")


class RecordingFile:
    """The chunks of an .rrd file."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.reader = RrdReader(path)
        self.chunks = self.reader.stream().to_chunks()

    def batches(self, entity: str, static: bool = False) -> list[pa.RecordBatch]:
        return [
            c.to_record_batch()
            for c in self.chunks
            if c.entity_path == entity and c.is_static == static
        ]

    def entities(self, static: bool = False) -> set[str]:
        return {c.entity_path for c in self.chunks if c.is_static == static}

    def frames(self, entity: str) -> list[int]:
        return [f for batch in self.batches(entity) for f in batch["frame"].to_pylist()]

    def column(self, entity: str, name: str) -> list[Any]:
        """Return a component's lists of instances, in the order of the frames."""
        rows = [row for batch in self.batches(entity) for row in batch[name].to_pylist()]
        return [rows[i] for i in np.argsort(self.frames(entity), kind="stable")]

    def static(self, entity: str, name: str) -> Any:
        (batch,) = self.batches(entity, static=True)
        return batch[name].to_pylist()[0]

    def layouts(self) -> list[set[str]]:
        """Return the names of views and containers in each layout that was sent."""
        return [self._names(store) for store in self.reader.blueprints()]

    def _names(self, store: Any) -> set[str]:
        names = set()
        for chunk in self.reader.stream(store=store).to_chunks():
            batch = chunk.to_record_batch()
            for kind in ("View", "Container"):
                column = f"{kind}Blueprint:display_name"
                if column in batch.schema.names:
                    names |= {row[0] for row in batch[column].to_pylist() if row}
        return names

    def axis_ranges(self) -> dict[str, list[float]]:
        """Return the limits that a layout gives to axes, by the origin of the plot."""
        columns: dict[str, dict[str, Any]] = {
            "ViewBlueprint:space_origin": {},
            "ScalarAxis:range": {},
        }
        for store in self.reader.blueprints():
            for chunk in self.reader.stream(store=store).to_chunks():
                batch = chunk.to_record_batch()
                for name in columns.keys() & set(batch.schema.names):
                    view = chunk.entity_path.removesuffix("/ScalarAxis")
                    (columns[name][view],) = batch[name].to_pylist()[0]
        origins, ranges = columns.values()
        return {origins[view]: limits for view, limits in ranges.items()}

    def values(self, entity: str) -> NDArray:
        """Return a time series (frames, lines); NaN where there are no values."""
        rows = self.column(entity, "Scalars:scalars")
        width = max(map(len, rows))
        return np.array([row if row else [np.nan] * width for row in rows])


class Listener:
    """A rerun process that listens at `url`."""

    def __init__(self, *options: str | Path, file: Path | None = None) -> None:
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            port = free.getsockname()[1]
        self.url = f"rerun+http://127.0.0.1:{port}/proxy"
        command = [RERUN, *options, "--bind", "127.0.0.1", "--port", str(port)]
        with open(file or os.devnull, "rb") as stdin:
            self.process = subprocess.Popen(
                command,
                stdin=stdin,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
                start_new_session=True,
            )
        deadline = time.monotonic() + 60
        while time.monotonic() < deadline:
            try:
                socket.create_connection(("127.0.0.1", port), 1).close()
                return
            except OSError:
                time.sleep(0.05)

    def end(self, number: int = signal.SIGTERM) -> None:
        if self.process.poll() is None:
            os.killpg(self.process.pid, number)
        self.process.wait()


def rows(table: pa.Table, controller: str, seed: int = 0, slot: int = 0) -> dict[str, NDArray]:
    """Return the columns of a run's table for one robot."""
    is_wanted = (
        (pc.field("controller") == controller)
        & (pc.field("seed") == seed)
        & (pc.field("slot") == slot)
    )
    robot = table.filter(is_wanted).sort_by("frame").drop_columns("controller")
    return {name: robot[name].to_numpy() for name in robot.column_names}


def run_and_record(
    simulation: Simulation,
    path: Path,
    url: str = "",
    after_frame: Callable[[int], None] | None = None,
) -> None:
    """Run a simulation to its end, recorded in a file and perhaps shown by a viewer."""
    with ExitStack() as stack:
        recordings = [stack.enter_context(Recording(path, simulation))]
        recordings += [stack.enter_context(Recording(url, simulation))] if url else []

        def update(frame: int) -> None:
            if after_frame:
                after_frame(frame)
            for recording in recordings:
                recording.update()

        run_simulation(simulation, update)
        for recording in recordings:
            recording.write()


def run_rrd_command(*arguments: str | Path) -> subprocess.CompletedProcess[str]:
    """`rerun rrd ...`"""
    return subprocess.run(
        [RERUN, "rrd", *arguments], capture_output=True, text=True, check=False, timeout=60
    )


@dataclass(frozen=True)
class RecordedRun:
    """The log of a run as a table, and its recording."""

    table: pa.Table
    recorded: RecordingFile


def record_run(
    path: Path, controllers: list[str | type[Controller]], *overrides: str, **head: object
) -> RecordedRun:
    simulation = create_simulation(controllers, *overrides, **head)
    run_and_record(simulation, path)
    return RecordedRun(simulation.log.to_arrow(), RecordingFile(path))


def create_simulation(
    controllers: list[str | type[Controller]], *overrides: str, **head: object
) -> Simulation:
    """Return a simulation of `rect` at its start. Default: on the kinematic plant."""
    return Simulation(
        scenario.load_with_overrides("rect", list(overrides), {"plant": "kinematic", **head}),
        controllers,
    )


def recorded_poses(recorded: RecordingFile, entity: str) -> NDArray:
    """Return transforms as poses, (frames, 3) m, m, rad."""
    position = np.array([row[0] for row in recorded.column(entity, "Transform3D:translation")])
    quaternion = np.array([row[0] for row in recorded.column(entity, "Transform3D:quaternion")])
    assert not quaternion[:, :2].any()  # about z
    return np.column_stack([position[:, :2], 2 * np.arctan2(quaternion[:, 2], quaternion[:, 3])])
