"""What the tests of measures share: logs filled by hand."""

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from omni_mj.scenarios.rows import Row
from omni_mj.scenarios.settings import Settings
from omni_mj.simulate.log import Log
from omni_mj.simulate.simulation import Failure

WHEELS = 4


def rows(
    controllers: Sequence[str] = ("flc",), seeds: Sequence[int] = (0,), settings: Settings | None = None
) -> list[Row]:
    """All seeds of one controller after those of the one before."""
    named = [(controller, seed) for controller in controllers for seed in seeds]
    chosen = Settings() if settings is None else settings
    return [Row(world, 0, controller, seed, chosen, "tigers-v2016") for world, (controller, seed) in enumerate(named)]


def filled(
    table: Sequence[Row],
    frames: int,
    lengths: ArrayLike | None = None,
    own: Mapping[str, NDArray] | None = None,
    **channels: NDArray | float | bool,
) -> Log:
    """A log of so many frames, of rows that end after `lengths`.

    `channels` are (frames, n, columns), or what broadcasts to it; poses, references and commands are zero otherwise.
    Those of controllers' `own` are (n, columns), the same in all frames.
    """
    log = Log(table, WHEELS)
    ends = np.full(len(table), frames) if lengths is None else np.asarray(lengths)
    given = {"ref": 0.0, "pose": 0.0, "command": 0.0, **channels}
    values = {
        name: np.broadcast_to(np.asarray(value), (frames, len(table), len(log.columns[name])))
        for name, value in given.items()
    }
    for frame in range(frames):
        log.write(frame < ends, own or {}, **{name: value[frame] for name, value in values.items()})
    return log


def failure(log: Log, row: int, cause: str = "toppled over") -> Failure:
    """Of a row that was stopped after its last frame."""
    of = log.rows[row]
    return Failure(row, of.controller, of.seed, log.lengths[row] / 60, cause)
