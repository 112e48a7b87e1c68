"""The physics of the plant `mujoco` by MuJoCo Warp, on a GPU if there is one, else on its device `cpu`; a seam.

`WarpPlant` is `MujocoPlant` with another batch. All that is between the steps runs as it does there, by numpy on this
machine, so that states and sensors are copied from and to the device in every step. That is right on either device, and
fast on none: a GPU gains once firmware, motors and battery run on it as well. Numbers are float32 on the device.

Needs `pip install 'omni-mj[warp]'`. A file with `from omni_mj.plants.warp import WarpPlant` is a plant for `--plant`.
"""

import importlib
from typing import Any

import mujoco
import numpy as np

from omni_control.errors import OmniError
from omni_mj.plants import batches
from omni_mj.plants.mujoco import MujocoPlant
from omni_mj.worlds.build import World

CONTACTS, CONSTRAINTS = 128, 512  # of a world, at most; a robot on full wheels has up to 70 contacts
LEAST_TOLERANCE = 1e-6  # of the solver: float32 knows no less
_SENT = "qpos", "qvel", "ctrl", "xfrc_applied"
_RETURNED = "qpos", "qvel", "sensordata"


class WarpBatch:
    """As much of `mujoco.batch.Batch` as `MujocoPlant` uses: arrays of this machine, stepped on another device.

    Args:
        model: of each world.
        worlds: how many.

    Attributes:
        model: as given.
        warning: counts of MuJoCo's warnings, (worlds, warnings, 2): here of positions that are not numbers alone.

    Raises:
        OmniError: MuJoCo Warp is not installed.
    """

    def __init__(self, model: mujoco.MjModel, worlds: int) -> None:
        try:
            self._warp, self._mjw = (importlib.import_module(name) for name in ("warp", "mujoco_warp"))
        except ImportError:
            raise OmniError("MuJoCo Warp is not installed: pip install 'omni-mj[warp]'") from None
        self.model = model
        model.opt.tolerance = max(model.opt.tolerance, LEAST_TOLERANCE)
        self._data = mujoco.MjData(model)
        mujoco.mj_forward(model, self._data)
        self._worlds = worlds
        self._there = self._mjw.put_model(model)
        sizes = {"nworld": worlds, "nconmax": CONTACTS, "njmax": CONSTRAINTS}
        self._state: Any = self._mjw.put_data(model, self._data, **sizes)
        self._bound: dict[str, np.ndarray] = {}
        self._expanded: dict[str, np.ndarray] = {}
        self.warning = np.zeros((worlds, int(mujoco.mjtWarning.mjNWARNING), 2))

    def bind(self, name: str) -> np.ndarray:
        """A field of `MjData` of each world, (worlds, ...)."""
        if name not in self._bound:
            self._bound[name] = self._each(getattr(self._data, name))
        return self._bound[name]

    def expand(self, name: str) -> np.ndarray:
        """A field of `MjModel` that may differ from world to world, (worlds, ...); options as `opt.name`."""
        if name not in self._expanded:
            of, field = _field(self.model, name)
            self._expanded[name] = self._each(getattr(of, field))
        return self._expanded[name]

    def step(self, ids: np.ndarray | None = None) -> None:
        """Step all worlds, or some."""
        self._run(self._mjw.step, ids)
        broken = ~np.isfinite(self.bind("qpos")).all(1)
        self.warning[:, int(mujoco.mjtWarning.mjWARN_BADQPOS), 1] = broken

    def forward(self, ids: np.ndarray | None = None) -> None:
        """Find what follows from the state, sensors among it."""
        self._run(self._mjw.forward, ids)

    def _run(self, function: Any, ids: np.ndarray | None) -> None:
        for name in _SENT:
            getattr(self._state, name).assign(self.bind(name).astype(np.float32))
        for name, values in self._expanded.items():
            of, field = _field(self._there, name)
            there = getattr(of, field)
            setattr(of, field, self._warp.array(values.astype(np.float32), dtype=there.dtype, device=there.device))
        function(self._there, self._state)
        for name in _RETURNED:
            found = getattr(self._state, name).numpy()
            rows = slice(None) if ids is None else ids
            self.bind(name)[rows] = found[rows]

    def _each(self, values: np.ndarray) -> np.ndarray:
        return np.repeat(np.asarray(values, float)[None], self._worlds, axis=0)


class WarpPlant(MujocoPlant):
    """`MujocoPlant` on MuJoCo Warp; for arguments, attributes and errors see there. Its kernel is numpy."""

    def _made(self, world: World, worlds: int, threads: int) -> Any:
        if self._kernel != "numpy":
            raise OmniError("physics by MuJoCo Warp needs physics.kernel = numpy")
        return WarpBatch(batches.model_of(world), worlds)


def _field(of: Any, name: str) -> tuple[Any, str]:
    """The object that has a field, and the field's name there."""
    section, _, field = name.rpartition(".")
    return (getattr(of, section) if section else of), field
