"""What the tests of recordings share: reading an .rrd back, and the rows of the table beside it."""

import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray
from rerun.chunk import RrdReader

from omni_mj.cli import console
from omni_mj.measure import events, summary
from omni_mj.show.recording import FileRecording
from omni_mj.simulate.simulation import Simulation

RERUN = Path(sys.executable).with_name("rerun")


class Recorded:
    """The chunks of an .rrd file."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.reader = RrdReader(path)
        self.chunks = self.reader.stream().to_chunks()

    def batches(self, entity: str, static: bool = False) -> list[pa.RecordBatch]:
        return [c.to_record_batch() for c in self.chunks if c.entity_path == entity and c.is_static == static]

    def entities(self, static: bool = False) -> set[str]:
        return {c.entity_path for c in self.chunks if c.is_static == static}

    def frames(self, entity: str) -> list[int]:
        return [f for batch in self.batches(entity) for f in batch["frame"].to_pylist()]

    def column(self, entity: str, name: str) -> list[Any]:
        """A component's lists of instances, in the order of the frames."""
        rows = [row for batch in self.batches(entity) for row in batch[name].to_pylist()]
        return [rows[i] for i in np.argsort(self.frames(entity), kind="stable")]

    def static(self, entity: str, name: str) -> Any:
        (batch,) = self.batches(entity, static=True)
        return batch[name].to_pylist()[0]

    def values(self, entity: str) -> NDArray:
        """A time series (frames, lines); not a number where there are no values."""
        rows = self.column(entity, "Scalars:scalars")
        width = max(map(len, rows))
        return np.array([row if row else [np.nan] * width for row in rows])


def rows(folder: Path, controller: str, seed: int = 0) -> dict[str, NDArray]:
    """The columns of a run's table for one robot."""
    table = pq.read_table(folder / "trajectory.parquet")
    chosen = pa.compute.equal(table["controller"].cast(pa.string()), controller)
    table = table.filter(pa.compute.and_(chosen, pa.compute.equal(table["seed"], seed))).sort_by("frame")
    return {name: table[name].to_numpy() for name in table.column_names if name != "controller"}


def record(simulation: Simulation, path: Path) -> None:
    """Run a simulation to its end and record it, as the command does."""
    with FileRecording(path, simulation) as recording:
        simulation.run(lambda frame: recording.update())
        recording.write()
        happened = events.find(simulation.trajectory, simulation.scenario.settings)
        result = summary.summarise(simulation.scenario, simulation.trajectory, happened, 0.0, None)
        recording.finish(console.markdown_result(result))


def rrd(*arguments: str | Path) -> subprocess.CompletedProcess[str]:
    """`rerun rrd ...`"""
    return subprocess.run([RERUN, "rrd", *arguments], capture_output=True, text=True, check=False, timeout=60)
