"""Kernels: what computes the functions of this package, numpy or programs that JAX compiles from them.

A kernel holds parameters and state of n robots, and runs functions (parameters, state, *inputs) -> (state, outputs).
Handing an array to a compiled program costs about a microsecond, and a state has sixty. So JAX gets each NamedTuple
packed into one array (rows, robots). Robots are computed in blocks, filled up to a few sizes, because every new size
compiles anew, and because larger blocks leave the processor's cache.
"""

import importlib.util
import math
import os
import sys
from collections.abc import Callable, Iterator, Sequence
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple, Protocol

import numpy as np

from omni_control.errors import OmniError

BLOCKS = 1, 16, 64  # robots that a compiled program takes
NUMPY_FRAME_S, NUMPY_ROBOT_S = 3e-3, 2e-5  # that a frame of `planar` takes, and a robot in it
JAX_START_S = 5.0  # import and compilation
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


def choose_kernel(setting: str, plant: str, robots: int = 1, frames: int = 0) -> str:
    """Return the kernel, numpy or jax, that a setting of `physics.kernel` means.

    Robots of `mujoco` spend their time in MuJoCo, where compiled functions gain nothing. On `planar` JAX is taken if
    numpy would need longer than it takes to import JAX and to compile.

    Args:
        setting: auto, numpy or jax.
        plant: By its name.
        robots: How many.
        frames: Of the run; 0 if that is not known.
    """
    if setting != "auto":
        return setting
    numpy_s = frames * (NUMPY_FRAME_S + NUMPY_ROBOT_S * robots)
    return "jax" if plant == "planar" and numpy_s > JAX_START_S and has_jax() else "numpy"


def has_jax() -> bool:
    """Return whether JAX is installed."""
    return importlib.util.find_spec("jax") is not None


def make_kernel(name: str, parameters: Any, state: Any) -> Kernel:
    """Return a kernel by its name, numpy or jax."""
    return JaxKernel(parameters, state) if name == "jax" else NumpyKernel(parameters, state)


class NumpyKernel:
    """Functions as they are."""

    def __init__(self, parameters: Any, state: Any) -> None:
        self.parameters, self.state = parameters, state

    def run(self, function: Function, *inputs: Any) -> Any:
        """See `Kernel`."""
        self.state, outputs = function(self.parameters, self.state, *inputs)
        return outputs


class Field(NamedTuple):
    """A field of a packed NamedTuple.

    Attributes:
        rows: How many it takes.
        shape: Without the axis of robots; None for a single number.
        kind: Of its numbers, the letter of numpy's `dtype.kind`.
    """

    rows: int
    shape: tuple[int, ...] | None
    kind: str


class Layout(NamedTuple):
    """Where the fields of a NamedTuple are in its packed array.

    Attributes:
        kind: Its class.
        fields: For each field None, a layout, or a field.
    """

    kind: type
    fields: tuple[Any, ...]

    @classmethod
    def of(cls, tree: Any) -> "Layout":
        """Return the layout of a NamedTuple of arrays."""
        return cls(type(tree), tuple(map(_field, tree)))

    def unpack(self, packed: Any, row: int = 0) -> tuple[Any, int]:
        """Return the NamedTuple in an array (rows, n) from a row on, and the row after it."""
        parts: list[Any] = []
        for field in self.fields:
            if field is None:
                parts.append(None)
            elif isinstance(field, Layout):
                part, row = field.unpack(packed, row)
                parts.append(part)
            else:
                rows, shape, kind = field
                if shape is None:
                    part = packed[row, 0]
                elif len(shape) == 1:
                    part = packed[row : row + rows]
                else:
                    part = packed[row] if not shape else packed[row : row + rows].reshape((*shape, -1))
                parts.append(part if kind == "f" else part.astype(bool if kind == "b" else int))
                row += rows
        return self.kind(*parts), row


def _field(part: Any) -> Any:
    if part is None:
        return None
    if isinstance(part, tuple):
        return Layout.of(part)
    shape = part.shape[:-1] if part.ndim else None
    return Field(math.prod(shape or ()), shape, part.dtype.kind)


def pack(tree: Any, n: int, xp: Any = np) -> Any:
    """Put the arrays of a NamedTuple of n robots below each other, (rows, n)."""
    rows = [
        (part.reshape(-1, n) if part.ndim else xp.broadcast_to(part, (1, n))).astype(float) for part in _arrays(tree)
    ]
    return xp.concatenate(rows)


def _arrays(tree: Any) -> Iterator[Any]:
    for part in tree:
        if isinstance(part, tuple):
            yield from _arrays(part)
        elif part is not None:
            yield part


def _pattern(tree: Any) -> tuple[Any, ...]:
    """Return which fields of a NamedTuple are None."""
    return tuple(_pattern(part) if isinstance(part, tuple) else part is None for part in tree)


class JaxKernel:
    """Functions compiled by JAX; see the module."""

    def __init__(self, parameters: Any, state: Any) -> None:
        _set_up_jax()
        self._n = _robots(parameters)
        self._size = next((size for size in BLOCKS if size >= self._n), BLOCKS[-1])
        self._programs: dict[Any, Program] = {}  # of functions and of which fields of their inputs are None
        self.parameters, self.state = parameters, state

    @property
    def parameters(self) -> Any:
        """See `Kernel`."""
        return self._parameters

    @parameters.setter
    def parameters(self, parameters: Any) -> None:
        self._programs.clear()
        self._parameters, self._parameter_layout = parameters, Layout.of(parameters)
        self._parameter_blocks = self._blocks(parameters)

    @property
    def state(self) -> Any:
        """See `Kernel`."""
        return self._joined(self._state_layout, self._state_blocks)

    @state.setter
    def state(self, state: Any) -> None:
        self._programs.clear()
        self._state_layout, self._state_blocks = Layout.of(state), self._blocks(state)

    def run(self, function: Function, *inputs: Any) -> Any:
        """See `Kernel`."""
        import jax

        key = (function, *map(_pattern, inputs))
        if (program := self._programs.get(key)) is None:
            layouts = self._parameter_layout, self._state_layout, *map(Layout.of, inputs)
            program = self._programs[key] = compiled(function, layouts, self._size)
        blocks, outputs = list(zip(*(self._blocks(tree) for tree in inputs), strict=True)), []
        with jax.enable_x64(True):
            for i, (parameters, state) in enumerate(zip(self._parameter_blocks, self._state_blocks, strict=True)):
                self._state_blocks[i], output = program.run(parameters, state, *blocks[i])
                outputs.append(output)
        state_layout, layout = program.layouts
        assert state_layout is not None
        if state_layout is not self._state_layout and state_layout != self._state_layout:
            self._state_layout = state_layout
            self._programs.clear()
        return None if layout is None else self._joined(layout, outputs)

    def _blocks(self, tree: Any) -> list[Any]:
        """Pack a NamedTuple, fill it up with copies of the last robot, and cut it into blocks."""
        packed = pack(tree, self._n)
        missing = -self._n % self._size
        if missing:
            packed = np.concatenate([packed, np.repeat(packed[:, -1:], missing, axis=1)], axis=1)
        if packed.shape[1] == self._size:
            return [packed]
        return [np.ascontiguousarray(packed[:, i : i + self._size]) for i in range(0, packed.shape[1], self._size)]

    def _joined(self, layout: Layout, blocks: Sequence[Any]) -> Any:
        arrays = [np.asarray(block) for block in blocks]
        packed = arrays[0] if len(arrays) == 1 else np.concatenate(arrays, axis=1)
        return layout.unpack(packed[:, : self._n])[0]


class Program:
    """A function compiled for packed arguments.

    Attributes:
        run: Takes packed parameters, state and inputs; returns the packed state and outputs.
        layouts: Of the state and of the outputs, known after the first run.
    """

    def __init__(self, function: Function, layouts: tuple[Layout, ...], size: int) -> None:
        import jax

        def packed(*arrays: Any) -> tuple[Any, ...]:
            arguments = [layout.unpack(array)[0] for layout, array in zip(layouts, arrays, strict=True)]
            results = function(*arguments)
            self.layouts = tuple(None if result is None else Layout.of(result) for result in results)
            return tuple(None if result is None else pack(result, size, jax.numpy) for result in results)

        self.run = jax.jit(packed)


@cache
def compiled(function: Function, layouts: tuple[Layout, ...], size: int) -> Program:
    """Return the program of a function, compiled when it is first run."""
    return Program(function, layouts, size)


def _robots(parameters: Any) -> int:
    return int(next(_arrays(parameters)).shape[-1])


@cache
def _set_up_jax() -> None:
    """Prepare JAX: programs are stored for the next process, and small ones are not handed to another thread."""
    import jax

    config: Any = jax.config
    config.update("jax_cpu_enable_async_dispatch", False)
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
