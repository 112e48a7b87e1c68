"""Backends: what computes the functions of this package, numpy or programs that JAX compiles from them.

A backend holds parameters and state of n robots, and runs functions (parameters, state, *inputs) -> (state, outputs).
Handing an array to a compiled program costs 1 to 3 us, and a state has sixty. So JAX gets parameters, state and inputs
packed into one array each, and returns state and outputs packed as well: a frame of one robot takes half the time.
Batches are filled up with copies of the last robot to a few sizes, because every new size compiles anew.
"""

import importlib.util
import math
import os
from collections.abc import Callable
from functools import cache
from itertools import accumulate, pairwise
from pathlib import Path
from typing import Any

import numpy as np

from omni_control.errors import OmniError

SIZES = 1, 16, 64  # robots that compiled programs take, and then multiples of the last
NUMPY_FRAME_S, NUMPY_ROBOT_S = 3e-3, 2e-5  # that a frame of `planar` takes, and a robot in it
JAX_START_S = 5.0  # import and compilation
COMPILER_OPTIONS = {
    "xla_cpu_use_fusion_emitters": False
}  # one robot compiles in half the time, and runs as fast
Function = Callable[..., tuple[Any, Any]]
Unpack = Callable[[Any], Any]  # an array (numbers,) -> NamedTuples of arrays


def choose_backend(setting: str, plant: str, robots: int, frames: int) -> str:
    """Return the backend, numpy or jax, that a setting of `physics.backend` means.

    Robots of `mujoco` spend their time in MuJoCo, where compiled functions gain nothing. On
    `planar` JAX is taken if numpy would need longer than it takes to import JAX and to compile.

    Args:
        setting: auto, numpy or jax.
        plant: By its name.
        robots: How many.
        frames: Of the run.

    Raises:
        OmniError: JAX is set for a plant that it does not compute, or is not installed.
    """
    if setting == "jax" and plant in ("mujoco", "kinematic"):
        raise OmniError(
            f"physics.backend = jax computes the plant planar only, not {plant}; take numpy or auto"
        )
    if setting == "jax" and not has_jax():
        raise OmniError(
            "physics.backend = jax needs the package jax, which is not installed: pip install 'omni-mj[fast]'; or take "
            "physics.backend = numpy"
        )
    if setting != "auto":
        return setting
    numpy_s = frames * (NUMPY_FRAME_S + NUMPY_ROBOT_S * robots)
    return "jax" if plant == "planar" and numpy_s > JAX_START_S and has_jax() else "numpy"


def has_jax() -> bool:
    """Return whether JAX is installed."""
    return importlib.util.find_spec("jax") is not None


class NumpyBackend:
    """Functions as they are.

    Args:
        parameters: Of n robots.
        state: At the start.
    """

    def __init__(self, parameters: Any, state: Any) -> None:
        self.parameters, self.state = parameters, state

    def run(self, function: Function, *inputs: Any) -> Any:
        """Run a function, keep the state that it returns, and return its outputs."""
        self.state, outputs = function(self.parameters, self.state, *inputs)
        return outputs


@cache
def unpacker(tree: Any, kinds: tuple[tuple[tuple[int, ...], Any], ...]) -> Unpack:
    """Return what unpacks NamedTuples of arrays from one array; the same function for the same arguments.

    Args:
        tree: JAX's description of the NamedTuples.
        kinds: Shape and type of each array.
    """
    ends = [0, *accumulate(math.prod(shape) for shape, _ in kinds)]

    def unpack(packed: Any) -> Any:
        parts = (packed[slice(*span)] for span in pairwise(ends))
        leaves = [
            part.reshape(shape).astype(kind, copy=False)
            for part, (shape, kind) in zip(parts, kinds, strict=True)
        ]
        return tree.unflatten(leaves)

    return unpack


def pack(tree: Any, xp: Any = np) -> tuple[Any, Unpack]:
    """Put the arrays of NamedTuples one after the other, (numbers,); return also what unpacks them."""
    import jax

    leaves, tree = jax.tree.flatten(tree)
    unpack = unpacker(tree, tuple((leaf.shape, np.dtype(leaf.dtype)) for leaf in leaves))
    return xp.concatenate(
        [xp.zeros(0), *(leaf.ravel().astype(float, copy=False) for leaf in leaves)]
    ), unpack


class JaxBackend:
    """Functions compiled by JAX; see the module. It has what `NumpyBackend` has."""

    def __init__(self, parameters: Any, state: Any) -> None:
        _set_up_jax()
        import jax

        self._robots = int(jax.tree.leaves(parameters)[0].shape[-1])
        size = next(
            (size for size in SIZES if size >= self._robots),
            -(-self._robots // SIZES[-1]) * SIZES[-1],
        )
        self._filled = np.minimum(np.arange(size), self._robots - 1)
        self.parameters, self.state = parameters, state

    @property
    def parameters(self) -> Any:
        """See `NumpyBackend`."""
        return self._parameters

    @parameters.setter
    def parameters(self, parameters: Any) -> None:
        import jax

        self._parameters = parameters
        packed, self._unpack_parameters = self._pack(parameters)
        with jax.enable_x64(True):
            self._packed_parameters = jax.device_put(packed)

    @property
    def state(self) -> Any:
        """See `NumpyBackend`."""
        return self._cut(self._unpack_state(np.asarray(self._packed_state)))

    @state.setter
    def state(self, state: Any) -> None:
        self._packed_state, self._unpack_state = self._pack(state)

    def run(self, function: Function, *inputs: Any) -> Any:
        """See `NumpyBackend`."""
        import jax

        packed, unpack = self._pack(inputs)
        run, after = compiled(function, unpack, self._unpack_parameters, self._unpack_state)
        with jax.enable_x64(True):
            self._packed_state, outputs = run(self._packed_parameters, self._packed_state, packed)
        self._unpack_state, unpack_outputs = after
        return self._cut(unpack_outputs(np.asarray(outputs)))

    def _pack(self, tree: Any) -> tuple[Any, Unpack]:
        """Fill arrays up with copies of the last robot, and pack them."""
        import jax

        if len(self._filled) > self._robots:
            tree = jax.tree.map(lambda leaf: leaf[..., self._filled] if leaf.ndim else leaf, tree)
        return pack(tree)

    def _cut(self, tree: Any) -> Any:
        """Return arrays of the robots alone."""
        import jax

        if len(self._filled) == self._robots:
            return tree
        return jax.tree.map(lambda leaf: leaf[..., : self._robots] if leaf.ndim else leaf, tree)


@cache
def compiled(
    function: Function, inputs: Unpack, parameters: Unpack, state: Unpack
) -> tuple[Function, list[Unpack]]:
    """Compile a function for packed inputs, parameters and state, when it is first run.

    Returns:
        Takes packed parameters, state and inputs; returns the packed state, and the packed outputs.
        What unpacks these two, known after the first run.
    """
    import jax

    after: list[Unpack] = []

    def run(parameter_array: Any, state_array: Any, input_array: Any) -> tuple[Any, Any]:
        new, outputs = function(
            parameters(parameter_array), state(state_array), *inputs(input_array)
        )
        (packed, unpack), (packed_outputs, unpack_outputs) = (
            pack(tree, jax.numpy) for tree in (new, outputs)
        )
        after[:] = [unpack, unpack_outputs]
        return packed, packed_outputs

    options = COMPILER_OPTIONS if jax.default_backend() == "cpu" else None
    return jax.jit(run, compiler_options=options), after


@cache
def _set_up_jax() -> None:
    """Prepare JAX: programs are stored for the next process, and run on one thread.

    Operations on so few robots are too small to share. Without the pool of threads a frame costs 28
    % less CPU time for 1 robot, 30 % less for 64, and 14 % less for 1,024. Set PJRT_NPROC before to
    choose another number of threads.
    """
    import jax

    config: Any = jax.config
    config.update("jax_cpu_enable_async_dispatch", False)
    if "PJRT_NPROC" not in os.environ:
        os.environ["PJRT_NPROC"] = "1"
        jax.devices("cpu")  # starts the threads
        del os.environ["PJRT_NPROC"]
    if getattr(config, "jax_compilation_cache_dir", None) is None:
        home = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
        config.update("jax_compilation_cache_dir", str(Path(home) / "omni-mj" / "jax"))
        config.update("jax_persistent_cache_min_compile_time_secs", 0.0)
