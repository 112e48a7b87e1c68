"""Backends that compute the functions of this package: numpy, or programs that JAX compiles.

A backend stores parameters and state of n robots, and runs functions

    (parameters, state, *inputs) -> (state, outputs).

Passing an array to a compiled program costs 1 to 3 us, and a state has sixty arrays. `JaxBackend`
therefore packs parameters, state and inputs into one array each, and unpacks state and outputs.
This halves the time of a frame of one robot. Each batch size needs a compilation of its own, so
batches are padded with copies of the last robot to one of a few sizes.
"""

import importlib.util
import math
import os
from collections.abc import Callable
from functools import cache
from itertools import accumulate, pairwise
from pathlib import Path
from typing import Any, Self

import numpy as np

from omni_control.errors import OmniError
from omni_control.install_hints import describe_installation

SMALL_BATCH_SIZES = 1, 16  # numbers of robots for which programs are compiled
BATCH_STEP = 64  # larger batches are padded to multiples of this number of robots
# Measured time of a frame with numpy on the plant planar: NUMPY_FRAME_S + NUMPY_ROBOT_S per robot
NUMPY_FRAME_S = 3e-3  # s
NUMPY_ROBOT_S = 2e-5  # s
JAX_START_S = 5.0  # measured time of import and compilation, s
# Halves the time of compilation for one robot, without loss of speed
COMPILER_OPTIONS = {"xla_cpu_use_fusion_emitters": False}

Function = Callable[..., tuple[Any, Any]]
Unpack = Callable[[Any], Any]  # an array (size,) -> NamedTuples of arrays
ShapeAndType = tuple[tuple[int, ...], Any]


def choose_backend(setting: str, plant: str, n_robots: int, n_frames: int) -> str:
    """Return the backend, numpy or jax, for a value of `physics.backend`.

    The plant mujoco spends its time in MuJoCo, which JAX does not accelerate. On the plant planar
    auto chooses JAX if numpy would take longer than the import of JAX and the compilation.

    Args:
        setting: auto, numpy or jax.
        plant: Name of the plant.
        n_robots: Number of robots.
        n_frames: Number of frames of the run.

    Raises:
        OmniError: The setting is jax, but the plant does not support it or it is not installed.
    """
    if setting == "jax":
        if plant in ("mujoco", "kinematic"):
            raise OmniError(
                "physics.backend = jax is available on the plant planar only, "
                f"not on {plant}; use numpy or auto"
            )
        if not has_jax():
            raise OmniError(
                "physics.backend = jax needs the package jax, which is not installed; install it "
                f"with {describe_installation('fast')}, or use physics.backend = numpy"
            )
    if setting != "auto":
        return setting
    numpy_s = n_frames * (NUMPY_FRAME_S + NUMPY_ROBOT_S * n_robots)
    return "jax" if plant == "planar" and numpy_s > JAX_START_S and has_jax() else "numpy"


def has_jax() -> bool:
    """Return whether JAX is installed."""
    return importlib.util.find_spec("jax") is not None


class NumpyBackend:
    """A backend that calls functions directly.

    Args:
        parameters: Parameters of n robots.
        state: State at the start.
    """

    def __init__(self, parameters: Any, state: Any) -> None:
        self.parameters = parameters
        self.state = state

    def run(self, function: Function, *inputs: Any) -> Any:
        """Run a function, store the state that it returns, and return its outputs."""
        self.state, outputs = function(self.parameters, self.state, *inputs)
        return outputs


@cache
def make_unpack(structure: Any, shapes_and_types: tuple[ShapeAndType, ...]) -> Unpack:
    """Return a function that unpacks NamedTuples of arrays from one array.

    The result is cached, so that equal structures share a compiled program.

    Args:
        structure: Tree definition of the NamedTuples (`jax.tree.structure`).
        shapes_and_types: Shape and type of each array.
    """
    ends = [0, *accumulate(math.prod(shape) for shape, _ in shapes_and_types)]

    def unpack(packed: Any) -> Any:
        flat_arrays = (packed[slice(*span)] for span in pairwise(ends))
        leaves = [
            flat.reshape(shape).astype(dtype, copy=False)
            for flat, (shape, dtype) in zip(flat_arrays, shapes_and_types, strict=True)
        ]
        return structure.unflatten(leaves)

    return unpack


def pack(tree: Any, xp: Any = np) -> tuple[Any, Unpack]:
    """Return the arrays of NamedTuples as one array (size,), and a function that unpacks it."""
    import jax

    leaves, structure = jax.tree.flatten(tree)
    unpack = make_unpack(structure, tuple((leaf.shape, np.dtype(leaf.dtype)) for leaf in leaves))
    flat_arrays = [leaf.ravel().astype(float, copy=False) for leaf in leaves]
    return xp.concatenate([xp.zeros(0), *flat_arrays]), unpack


class JaxBackend:
    """A backend that compiles functions with JAX; see the module and `NumpyBackend`."""

    def __init__(self, parameters: Any, state: Any) -> None:
        _set_up_jax()
        import jax

        self._n_robots = int(jax.tree.leaves(parameters)[0].shape[-1])
        sizes = *SMALL_BATCH_SIZES, BATCH_STEP * math.ceil(self._n_robots / BATCH_STEP)
        padded_size = min(size for size in sizes if size >= self._n_robots)
        self._padded_indices = np.minimum(np.arange(padded_size), self._n_robots - 1)
        self.parameters = parameters
        self.state = state

    def __reduce__(self) -> tuple[type[Self], tuple[Any, Any]]:
        """Copy and pickle without JAX's objects, which cannot be pickled."""
        return type(self), (self.parameters, self.state)

    @property
    def parameters(self) -> Any:
        """See `NumpyBackend`."""
        return self._parameters

    @parameters.setter
    def parameters(self, parameters: Any) -> None:
        import jax

        self._parameters = parameters
        packed, self._unpack_parameters = self._pad_and_pack(parameters)
        with jax.enable_x64(True):
            self._packed_parameters = jax.device_put(packed)

    @property
    def state(self) -> Any:
        """See `NumpyBackend`."""
        return self._remove_padding(self._unpack_state(np.asarray(self._packed_state)))

    @state.setter
    def state(self, state: Any) -> None:
        self._packed_state, self._unpack_state = self._pad_and_pack(state)

    def run(self, function: Function, *inputs: Any) -> Any:
        """See `NumpyBackend`."""
        import jax

        packed, unpack = self._pad_and_pack(inputs)
        run, unpack_results = compile_packed(
            function, unpack, self._unpack_parameters, self._unpack_state
        )
        with jax.enable_x64(True):
            self._packed_state, outputs = run(self._packed_parameters, self._packed_state, packed)
        self._unpack_state, unpack_outputs = unpack_results
        return self._remove_padding(unpack_outputs(np.asarray(outputs)))

    def _pad_and_pack(self, tree: Any) -> tuple[Any, Unpack]:
        """Pad arrays with copies of the last robot, and pack them."""
        import jax

        if len(self._padded_indices) > self._n_robots:
            tree = jax.tree.map(
                lambda leaf: leaf[..., self._padded_indices] if leaf.ndim else leaf, tree
            )
        return pack(tree)

    def _remove_padding(self, tree: Any) -> Any:
        """Return the arrays without the copies of the last robot."""
        import jax

        if len(self._padded_indices) == self._n_robots:
            return tree
        return jax.tree.map(lambda leaf: leaf[..., : self._n_robots] if leaf.ndim else leaf, tree)


@cache
def compile_packed(
    function: Function, unpack_inputs: Unpack, unpack_parameters: Unpack, unpack_state: Unpack
) -> tuple[Function, list[Unpack]]:
    """Return a function that takes and returns packed arrays, compiled when it is first run.

    Returns:
        The function: packed parameters, state and inputs -> packed state and outputs; and the two
        functions that unpack its results, known after the first run.
    """
    import jax

    unpack_results: list[Unpack] = []

    def run_packed(parameters: Any, state: Any, inputs: Any) -> tuple[Any, Any]:
        new_state, outputs = function(
            unpack_parameters(parameters), unpack_state(state), *unpack_inputs(inputs)
        )
        packed_state, unpack_new_state = pack(new_state, jax.numpy)
        packed_outputs, unpack_outputs = pack(outputs, jax.numpy)
        unpack_results[:] = [unpack_new_state, unpack_outputs]
        return packed_state, packed_outputs

    options = COMPILER_OPTIONS if jax.default_backend() == "cpu" else None
    return jax.jit(run_packed, compiler_options=options), unpack_results


@cache
def _set_up_jax() -> None:
    """Configure JAX: cache compiled programs on disk, and run them on one thread.

    The operations are too small to divide among threads. Without a pool of threads a frame costs
    28 % less CPU time for 1 robot, 30 % less for 64, and 14 % less for 1,024. The environment
    variable PJRT_NPROC sets another number of threads.
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
