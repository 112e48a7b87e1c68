"""What the tests of recordings share: making an .rrd, reading it back, and the rows of the table beside it."""

import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray
from rerun.chunk import RrdReader

from omni_control.controllers.base import Controller
from omni_mj.scenarios import scenario
from omni_mj.show import markdown
from omni_mj.show.recording import FileRecording
from omni_mj.simulate.simulation import Simulation
from omni_mj.studies import run
from omni_mj.studies.outcome import drive

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

    def layouts(self) -> list[set[str]]:
        """What views and containers are called, in each layout that was sent."""
        return [self._names(store) for store in self.reader.blueprints()]

    def _names(self, store: Any) -> set[str]:
        found = set()
        for chunk in self.reader.stream(store=store).to_chunks():
            batch = chunk.to_record_batch()
            for kind in ("View", "Container"):
                name = f"{kind}Blueprint:display_name"
                if name in batch.schema.names:
                    found |= {row[0] for row in batch[name].to_pylist() if row}
        return found

    def values(self, entity: str) -> NDArray:
        """A time series (frames, lines); not a number where there are no values."""
        rows = self.column(entity, "Scalars:scalars")
        width = max(map(len, rows))
        return np.array([row if row else [np.nan] * width for row in rows])


def rows(table: pa.Table, controller: str, seed: int = 0, place: int = 0) -> dict[str, NDArray]:
    """The columns of a run's table for one robot."""
    chosen = pc.equal(table["controller"].cast(pa.string()), controller)
    for name, value in (("seed", seed), ("place", place)):
        chosen = pc.and_(chosen, pc.equal(table[name], value))
    table = table.filter(chosen).sort_by("frame")
    return {name: table[name].to_numpy() for name in table.column_names if name != "controller"}


def record(simulation: Simulation, path: Path) -> Recorded:
    """Run a simulation to its end and record it, as the command does."""
    with FileRecording(path, simulation) as recording:
        outcome = drive(simulation, lambda frame: recording.update())
        recording.write()
        recording.finish(markdown.result(run.of(simulation, outcome).summary()))
    return Recorded(path)


def rrd(*arguments: str | Path) -> subprocess.CompletedProcess[str]:
    """`rerun rrd ...`"""
    return subprocess.run([RERUN, "rrd", *arguments], capture_output=True, text=True, check=False, timeout=60)


@dataclass(frozen=True)
class Driven:
    """A run: its log as a table, and its recording read back."""

    table: pa.Table
    recorded: Recorded


def driven_by(path: Path, controllers: list[str | type[Controller]], *overrides: str, **head: object) -> Driven:
    chosen = scenario.load("rect", list(overrides), {"plant": "kinematic", **head})
    simulation = Simulation(chosen, controllers)
    recorded = record(simulation, path)
    return Driven(simulation.log.table(), recorded)


def poses(recorded: Recorded, entity: str) -> NDArray:
    """Transforms as [x, y, heading] (frames, 3)."""
    at = np.array([row[0] for row in recorded.column(entity, "Transform3D:translation")])
    quaternion = np.array([row[0] for row in recorded.column(entity, "Transform3D:quaternion")])
    assert not quaternion[:, :2].any()  # about z
    return np.column_stack([at[:, :2], 2 * np.arctan2(quaternion[:, 2], quaternion[:, 3])])
