"""A world by itself, which compiled loops can step: no way back to Python between its physics steps, no copies."""

import copy
import ctypes
import sys
from functools import cache
from pathlib import Path

import mujoco
import numpy as np

from omni_mj.onboard import addresses
from omni_mj.plants import loads

STATE = "qpos", "qvel", "ctrl", "xfrc_applied"


class Alone:
    """As much of `mujoco.batch.Batch` as plants use, of one world: its arrays are the model's and the data's own.

    A step has the same bits as in a batch (`tests/plants/test_world_by_itself.py`). If MuJoCo gives up for want of
    memory while a compiled loop steps, it ends the process with a line; 12 robots on full wheels use a sixtieth of what
    there is.

    Args:
        model: of the world; changed where others write into what `expand` gives.

    Attributes:
        model: as given.
        state: one piece of memory with all of `STATE` in it, (1, numbers).
        warning: MuJoCo's warnings, the last one's detail and how many there were, (1, warnings, 2).
        stepping: what `step` is handed: addresses of `mj_step`, of model and data, and the table of `Loads`.
    """

    def __init__(self, model: mujoco.MjModel) -> None:
        self.model, self._data = model, mujoco.MjData(model)
        self._loads = loads.Loads(model, self._data)
        fields = [getattr(self._data, name) for name in STATE]
        first = min(fields, key=lambda field: int(field.ctypes.data))
        end = max(field.ctypes.data + field.nbytes for field in fields)
        size = (end - first.ctypes.data) // first.itemsize
        self.state = np.lib.stride_tricks.as_strided(first, (1, size), (end - first.ctypes.data, first.itemsize))
        details = self._data.warning.lastinfo
        self.warning = np.lib.stride_tricks.as_strided(details, (1, len(details), 2), (0, *details.strides, 4))
        self.stepping = np.array([_mj_step(), model._address, self._data._address, *self._loads.table], np.int64)

    def bind(self, name: str) -> np.ndarray:
        """A field of `MjData`, (1, ...)."""
        field: np.ndarray = getattr(self._data, name)[None]
        return field

    def expand(self, name: str) -> np.ndarray:
        """A field of `MjModel`, (1, ...); options as `opt.name`."""
        section, _, field = name.rpartition(".")
        values: np.ndarray = getattr(getattr(self.model, section) if section else self.model, field)[None]
        return values

    def step(self, ids: np.ndarray | None = None) -> None:
        """Step the world, unless `ids` has none."""
        if ids is None or len(ids):
            step(self.stepping)

    def forward(self, ids: np.ndarray | None = None) -> None:
        """Find what follows from the state, sensors among it."""
        if ids is None or len(ids):
            mujoco.mj_forward(self.model, self._data)
            loads.weigh(self._loads.table)

    def get_model(self, sim: int = 0) -> mujoco.MjModel:
        """A copy of the model as it is now."""
        model = copy.copy(self.model)
        self._loads.give_back(model)
        return model

    def get_data(self, sim: int = 0) -> mujoco.MjData:
        """A copy of the data."""
        return copy.copy(self._data)


def step(stepping: np.ndarray) -> None:
    """Step a world; compiled or not."""
    addresses.call(stepping[0], stepping[1], stepping[2])
    loads.weigh(stepping[3:])


@cache
def _mj_step() -> int:
    """The address of MuJoCo's own function."""
    # Elsewhere than on Windows a symbol is also looked for in the libraries that a library needs.
    binding = Path(sys.modules[mujoco.mj_step.__module__].__file__ or "")
    library = ctypes.CDLL(str(binding.parent / "mujoco.dll" if sys.platform == "win32" else binding))
    address = ctypes.cast(library.mj_step, ctypes.c_void_p).value
    assert address is not None
    return address
