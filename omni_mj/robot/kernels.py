"""Kernels: what computes the functions of this package, numpy or programs that JAX compiles from them.

A kernel holds parameters and state of n robots, and runs functions (parameters, state, *inputs) -> (state, outputs).
Handing an array to a compiled program costs 1 to 3 us, and a state has sixty. So JAX gets parameters, state and inputs
packed into one array each, and returns outputs packed as well: a frame of one robot takes half the time. Robots are
computed in blocks, filled up to a few sizes, because every new size compiles anew.
"""

import importlib.util
import math
import os
import sys
from collections.abc import Callable
from functools import cache
from itertools import accumulate
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from omni_control.errors import OmniError

BLOCKS = 1, 16, 64  # robots that a compiled program takes
LARGE_BLOCK, MANY_ROBOTS = 256, 512  # for this many robots; one of a large block takes 3/4 of the time of one of 64
NUMPY_FRAME_S, NUMPY_ROBOT_S = 3e-3, 2e-5  # that a frame of `planar` takes, and a robot in it
JAX_START_S = 5.0  # import and compilation
COMPILER_OPTIONS = {"xla_cpu_use_fusion_emitters": False}  # one robot compiles in half the time, and runs as fast
Function = Callable[..., tuple[Any, Any]]


class Kernel(Protocol):
    """Parameters and state of n robots, and what computes them."""

    parameters: Any
    state: Any

    def run(self, function: Function, *inputs: Any) -> Any:
        """Run a function, keep the state that it returns, and return its outputs."""
        ...


def check_kernel(name: str) -> None:
    """See that what a kernel needs is installed.

    Raises:
        OmniError: It is not.
    """
    if name == "jax" and not has_jax():
        raise OmniError(
            "physics.kernel = jax needs the package jax, which is not installed: pip install 'omni-mj[fast]'; or take "
            "physics.kernel = numpy"
        )


def choose_kernel(setting: str, plant: str, robots: int, frames: int) -> str:
    """Return the kernel, numpy or jax, that a setting of `physics.kernel` means.

    Robots of `mujoco` spend their time in MuJoCo, where compiled functions gain nothing. On `planar` JAX is taken if
    numpy would need longer than it takes to import JAX and to compile.

    Args:
        setting: auto, numpy or jax.
        plant: By its name.
        robots: How many.
        frames: Of the run.

    Raises:
        OmniError: JAX is set for a plant that it does not compute.
    """
    if setting == "jax" and plant in ("mujoco", "kinematic"):
        raise OmniError(f"physics.kernel = jax computes the plant planar only, not {plant}; take numpy or auto")
    if setting != "auto":
        return setting
    numpy_s = frames * (NUMPY_FRAME_S + NUMPY_ROBOT_S * robots)
    return "jax" if plant == "planar" and numpy_s > JAX_START_S and has_jax() else "numpy"


def has_jax() -> bool:
    """Return whether JAX is installed."""
    return importlib.util.find_spec("jax") is not None


def make_kernel(name: str, parameters: Any, state: Any) -> Kernel:
    """Return a kernel by its name, numpy or jax; auto is numpy, unless `choose_kernel` took JAX.

    Raises:
        OmniError: What it needs is not installed.
    """
    check_kernel(name)
    return JaxKernel(parameters, state) if name == "jax" else NumpyKernel(parameters, state)


class NumpyKernel:
    """Functions as they are."""

    def __init__(self, parameters: Any, state: Any) -> None:
        self.parameters, self.state = parameters, state

    def run(self, function: Function, *inputs: Any) -> Any:
        """See `Kernel`."""
        self.state, outputs = function(self.parameters, self.state, *inputs)
        return outputs


class Structure:
    """What packs NamedTuples of arrays of certain shapes into one array, and unpacks them.

    Args:
        tree: JAX's description of the NamedTuples.
        kinds: Shape and type of each array.
    """

    def __init__(self, tree: Any, kinds: tuple[tuple[tuple[int, ...], Any], ...]) -> None:
        self._tree = tree
        ends = [0, *accumulate(math.prod(shape) for shape, _ in kinds)]
        self._parts = [(slice(*ends[i : i + 2]), *kind) for i, kind in enumerate(kinds)]

    @classmethod
    def of(cls, tree: Any) -> "Structure":
        """Return the structure of NamedTuples; the same object for equal structures."""
        import jax

        leaves, structure = jax.tree.flatten(tree)
        return _structure(structure, tuple((leaf.shape, np.dtype(leaf.dtype)) for leaf in leaves))

    def unpack(self, packed: Any) -> Any:
        """Return the NamedTuples in an array (numbers,)."""
        leaves = []
        for place, shape, kind in self._parts:
            leaf = packed[place].reshape(shape)
            leaves.append(leaf if kind == leaf.dtype else leaf.astype(kind))
        return self._tree.unflatten(leaves)


@cache
def _structure(tree: Any, kinds: tuple[tuple[tuple[int, ...], Any], ...]) -> Structure:
    return Structure(tree, kinds)


def pack(tree: Any, xp: Any = np) -> Any:
    """Put the arrays of NamedTuples one after the other, (numbers,)."""
    import jax

    leaves = [leaf.ravel().astype(float, copy=False) for leaf in jax.tree.leaves(tree)]
    return xp.concatenate(leaves) if leaves else xp.zeros(0)


class JaxKernel:
    """Functions compiled by JAX; see the module."""

    def __init__(self, parameters: Any, state: Any) -> None:
        _set_up_jax()
        import jax

        self._robots = int(jax.tree.leaves(parameters)[0].shape[-1])
        self._size = next((size for size in BLOCKS if size >= self._robots), BLOCKS[-1])
        if self._robots >= MANY_ROBOTS:
            self._size = LARGE_BLOCK
        self.parameters, self.state = parameters, state

    @property
    def parameters(self) -> Any:
        """See `Kernel`."""
        return self._parameters

    @parameters.setter
    def parameters(self, parameters: Any) -> None:
        import jax

        blocks = self._cut(parameters)
        self._parameters, self._parameter_structure = parameters, Structure.of(blocks[0])
        with jax.enable_x64(True):
            self._parameter_blocks = [jax.device_put(pack(block)) for block in blocks]

    @property
    def state(self) -> Any:
        """See `Kernel`."""
        return self._joined([self._state_structure.unpack(np.asarray(block)) for block in self._state_blocks])

    @state.setter
    def state(self, state: Any) -> None:
        blocks = self._cut(state)
        self._state_structure = Structure.of(blocks[0])
        self._state_blocks = [pack(block) for block in blocks]

    def run(self, function: Function, *inputs: Any) -> Any:
        """See `Kernel`."""
        import jax

        blocks, outputs = self._cut(inputs), []
        structures = Structure.of(blocks[0]), self._parameter_structure, self._state_structure
        program = compiled(function, *structures)
        with jax.enable_x64(True):
            for i, block in enumerate(blocks):
                self._state_blocks[i], output = program.run(
                    self._parameter_blocks[i], self._state_blocks[i], pack(block)
                )
                outputs.append(program.output_structure.unpack(np.asarray(output)))
        self._state_structure = program.state_structure
        return self._joined(outputs)

    def _cut(self, tree: Any) -> list[Any]:
        """Cut arrays of all robots into blocks, the last one filled up with copies of the last robot."""
        import jax

        n, size = self._robots, self._size
        if n == size:
            return [tree]

        def cut(leaf: Any, start: int) -> Any:
            if not leaf.ndim:
                return leaf
            part = leaf[..., start : start + size]
            missing = size - part.shape[-1]
            return np.concatenate([part, np.repeat(part[..., -1:], missing, axis=-1)], axis=-1) if missing else part

        return [jax.tree.map(lambda leaf: cut(leaf, start), tree) for start in range(0, n, size)]  # noqa: B023

    def _joined(self, blocks: list[Any]) -> Any:
        if len(blocks) == 1 and self._robots == self._size:
            return blocks[0]
        import jax

        def join(*leaves: Any) -> np.ndarray:
            if not leaves[0].ndim:
                return np.asarray(leaves[0])
            return np.concatenate(leaves, axis=-1)[..., : self._robots]

        return jax.tree.map(join, *blocks)


class Program:
    """A function compiled for packed inputs, parameters and state.

    Attributes:
        run: Takes packed parameters, state and inputs; returns the packed state and the packed outputs.
        state_structure: Of the state that it returns, known after the first run.
        output_structure: Of the outputs, known after the first run.
    """

    state_structure: Structure
    output_structure: Structure

    def __init__(self, function: Function, inputs: Structure, parameters: Structure, state: Structure) -> None:
        import jax

        def packed(parameter_array: Any, state_array: Any, input_array: Any) -> tuple[Any, Any]:
            arguments = parameters.unpack(parameter_array), state.unpack(state_array), *inputs.unpack(input_array)
            after, outputs = function(*arguments)
            self.state_structure, self.output_structure = Structure.of(after), Structure.of(outputs)
            return pack(after, jax.numpy), pack(outputs, jax.numpy)

        options = COMPILER_OPTIONS if jax.default_backend() == "cpu" else None
        self.run = jax.jit(packed, compiler_options=options)


@cache
def compiled(function: Function, inputs: Structure, parameters: Structure, state: Structure) -> Program:
    """Return the program of a function, compiled when it is first run."""
    return Program(function, inputs, parameters, state)


@cache
def _set_up_jax() -> None:
    """Prepare JAX: programs are stored for the next process, and run on one thread.

    Operations on so few robots are too small to share. Without the pool of threads a frame costs 28 % less CPU time for
    1 robot, 30 % less for 64, and 14 % less for 1,024. Set PJRT_NPROC before to choose another number of threads.
    """
    import jax

    config: Any = jax.config
    config.update("jax_cpu_enable_async_dispatch", False)
    if "PJRT_NPROC" not in os.environ:
        os.environ["PJRT_NPROC"] = "1"
        jax.devices("cpu")  # starts the threads
        del os.environ["PJRT_NPROC"]
    if getattr(config, "jax_compilation_cache_dir", None) is None:
        config.update("jax_compilation_cache_dir", str(_cache_folder()))
        config.update("jax_persistent_cache_min_compile_time_secs", 0.0)


def _cache_folder() -> Path:
    """Return where this system stores what can be made again."""
    if sys.platform == "win32":
        home = os.environ.get("LOCALAPPDATA", Path.home() / "AppData" / "Local")
    elif sys.platform == "darwin":
        home = Path.home() / "Library" / "Caches"
    else:
        home = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return Path(home) / "omni-mj" / "jax"
