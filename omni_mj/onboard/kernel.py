"""What reckons between physics steps: numpy, with all robots at once, or loops over robots that numba compiles."""

import hashlib
import importlib.util
import os
import sys
from collections.abc import Callable, Iterator
from functools import cache, wraps
from pathlib import Path
from types import FunctionType, ModuleType
from typing import Any

from omni_control.errors import OmniError
from omni_mj.onboard import addresses, laws, wide

OURS = "omni_mj.", "omni_control."  # modules whose functions are compiled with those that call them


def check(kernel: str) -> None:
    """See that what a kernel needs is installed.

    Raises:
        OmniError: it is not.
    """
    if kernel == "numba" and importlib.util.find_spec("numba") is None:
        raise OmniError(
            "physics.kernel = numba needs the package numba, which is not installed: pip install 'omni-mj[fast]'; or "
            "take physics.kernel = numpy"
        )


@cache
def compiled(loop: Callable[..., Any]) -> Callable[..., Any]:
    """A loop, compiled by numba, with all functions of ours that it calls, when it is first called with its types.

    Machine code is kept for the next process, in a folder that is named after the sources: numba itself looks at the
    loop's own file only. No fast maths: what numba compiles rounds as written.

    Raises:
        OmniError: numba is not installed.
    """
    check("numba")
    import numba
    from numba.extending import overload, register_jitable

    from omni_mj.onboard import pointers

    config: Any = numba.config
    instead: dict[Callable[..., Any], Callable[..., Any]] = {
        laws.where: wide.where,
        laws.count: wide.count,
        laws.direction: wide.direction,
        addresses.floats: pointers.floats,
        addresses.vectors: pointers.vectors,
        addresses.numbers: pointers.numbers,
        addresses.words: pointers.words,
        addresses.truths: pointers.truths,
        addresses.call: pointers.call,
    }
    for function, other in instead.items():
        if function not in _REGISTERED:
            overload(function, jit_options=_UNCALLED)(_always(other))
            _REGISTERED.add(function)
    functions = list(_ours(loop, {loop}))
    for function in functions:
        if function not in _REGISTERED:
            register_jitable(**_UNCALLED)(function)
            _REGISTERED.add(function)
    sources = sorted({str(function.__code__.co_filename) for function in [loop, *functions, *instead.values()]})
    digest = hashlib.sha256(b"".join(Path(source).read_bytes() for source in sources)).hexdigest()
    kept = config.CACHE_DIR
    config.CACHE_DIR = str(Path(kept or _cache()) / digest[:16])
    try:
        return numba.njit(cache=True, error_model="numpy", **_UNCALLED)(loop)
    finally:
        config.CACHE_DIR = kept


_REGISTERED: set[Any] = set()
_UNCALLED: Any = {"no_cfunc_wrapper": True}  # an entry for C, which nobody calls, is another copy of all to optimise


def _always(instead: Callable[..., Any]) -> Callable[..., Any]:
    """What numba asks, with the arguments' types, for the code of a function."""

    @wraps(instead)
    def code(*types: Any, **named: Any) -> Any:
        return instead

    return code


def _ours(function: Any, known: set[Any]) -> Iterator[Any]:
    """The functions of this package that a function calls, and those that they call, each once."""
    names, scope = function.__code__.co_names, function.__globals__
    found = [scope[name] for name in names if name in scope]
    found += [
        getattr(each, name) for each in found if isinstance(each, ModuleType) for name in names if hasattr(each, name)
    ]
    for each in found:
        if isinstance(each, FunctionType) and each.__module__.startswith(OURS) and each not in known:
            known.add(each)
            yield each
            yield from _ours(each, known)


def _cache() -> Path:
    """Where this system keeps what can be made again."""
    if sys.platform == "win32":
        home = os.environ.get("LOCALAPPDATA", Path.home() / "AppData" / "Local")
    elif sys.platform == "darwin":
        home = Path.home() / "Library" / "Caches"
    else:
        home = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return Path(home) / "omni-mj" / "numba"
