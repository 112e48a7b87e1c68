"""Controllers by name: those of `omni_control`, and a user's own from a Python file."""

import importlib.util
import inspect
import sys
import traceback
from functools import lru_cache
from pathlib import Path
from types import ModuleType

import numpy as np

from omni_control.controllers import CONTROLLERS
from omni_control.controllers.base import Controller, Seen, Told
from omni_control.errors import OmniError, choose
from omni_control.kinematics import Array
from omni_control.reference.timed import Reference


class ControllerError(OmniError):
    """A user's controller failed when it was made or while it ran; says which, when and where."""


def find(name: str) -> type[Controller]:
    """The controller called `name`, or the class of a user's file: `my_file.py:MyTracker`.

    Raises:
        OmniError: there is no such controller, file or class, the file cannot be run, or the class is no `Controller`.
    """
    if name in CONTROLLERS:
        return CONTROLLERS[name]
    file, colon, class_name = name.rpartition(":")
    if not colon or not file.endswith(".py"):
        hint = choose(name, sorted(CONTROLLERS))
        raise OmniError(f"unknown controller {name!r}; {hint}, or a class of yours: file.py:Class")
    module = _module(Path(file))
    own: dict[str, type[Controller]] = {
        key: value
        for key, value in vars(module).items()
        if inspect.isclass(value) and issubclass(value, Controller) and value.__module__ == module.__name__
    }
    if class_name not in own:
        found = f"; {choose(class_name, sorted(own))}" if own else " and no other"
        raise OmniError(f"{file} has no class {class_name!r} derived from omni_control.tracker.Controller{found}")
    return own[class_name]


def label(name: str) -> str:
    """What a controller is called in tables and files: the class's name for one from a user's file."""
    return name.rpartition(":")[2]


def make(name: str, settings: Told, reference: Reference, n: int) -> Controller:
    """The controller called `name` for `n` robots.

    Raises:
        ControllerError: its constructor raised an exception, or did not call that of `Controller`.
    """
    kind = find(name)
    try:
        tracker = kind(settings, reference, n)
    except Exception as error:
        raise ControllerError(f"{kind.__name__} cannot be made{_where(kind, error)}") from error
    _check_record(tracker, n, "when it was made")
    return tracker


def command(tracker: Controller, frame: int, observed: Seen, sent: Array, rows: slice) -> Array:
    """What a tracker commands for its rows of the batch, (rows, 3).

    Raises:
        ControllerError: the tracker raised an exception, or returned something else than that many finite numbers.
    """
    own = Seen(*(np.array(values[rows]) for values in vars(observed).values()))  # copies, to do with as it likes
    try:
        wanted = np.asarray(tracker.command(frame, own, np.array(sent[rows])), float)
    except Exception as error:
        raise ControllerError(
            f"{type(tracker).__name__} failed in frame {frame}{_where(type(tracker), error)}"
        ) from error
    if wanted.shape != sent[rows].shape or not np.isfinite(wanted).all():
        got = f"of shape {wanted.shape}" if wanted.shape != sent[rows].shape else "that are not finite"
        raise ControllerError(
            f"{type(tracker).__name__} returned commands {got} in frame {frame}; {sent[rows].shape} finite are needed"
        )
    _check_record(tracker, len(wanted), f"in frame {frame}")
    return wanted


def _check_record(tracker: Controller, n: int, when: str) -> None:
    for name in ("predicted", "alpha_hat", "latency_hat"):
        got = np.asarray(getattr(tracker, name, None)).shape
        if got != (n, 3):
            raise ControllerError(f"{type(tracker).__name__} has a {name} of shape {got} {when}; {(n, 3)} is needed")


def _where(kind: type[Controller], error: Exception) -> str:
    """Where in the user's file an exception came from, and what it says."""
    frames = traceback.extract_tb(error.__traceback__)
    place = [f for f in frames if f.filename == inspect.getfile(kind)][-1:] or frames[-1:]
    where = f"{Path(place[0].filename).name}, line {place[0].lineno}"
    return f" ({where}): {type(error).__name__}: {error}"


@lru_cache
def _module(path: Path) -> ModuleType:
    """Run a Python file as a module."""
    if not path.is_file():
        raise OmniError(f"there is no file {path} with a controller in it")
    spec = importlib.util.spec_from_file_location(f"omni_user_{path.stem}", path.resolve())
    assert spec is not None, "a .py file has a loader"
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[module.__name__] = module  # where dataclasses look up the annotations of their module
    try:
        spec.loader.exec_module(module)
    except Exception as error:
        raise OmniError(f"{path} cannot be run: {type(error).__name__}: {error}") from error
    return module
