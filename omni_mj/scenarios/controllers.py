"""Controllers by name: those of `omni_control`, and a user's own from a Python file."""

import inspect
import sys
import traceback
from pathlib import Path
from typing import ClassVar, get_origin, get_type_hints

import numpy as np

from omni_control.controllers import CONTROLLERS
from omni_control.controllers.base import Controller, Seen, Told
from omni_control.errors import OmniError, choose
from omni_control.kinematics import Array
from omni_control.reference.timed import Reference
from omni_mj.scenarios import user_files


class ControllerError(OmniError):
    """A user's controller failed when it was made or while it ran; says which, when and where."""


def find(kind: str | type[Controller]) -> type[Controller]:
    """The class of a controller: given itself, by the name of one that comes along, or as `my_file.py:MyController`.

    Raises:
        OmniError: there is no such controller, file or class, the file cannot be run, or the class is no `Controller`.
    """
    if not isinstance(kind, str):
        return kind
    if kind in CONTROLLERS:
        return CONTROLLERS[kind]
    if not user_files.names_class(kind):
        hint = choose(kind, sorted(CONTROLLERS))
        raise OmniError(f"unknown controller {kind!r}; {hint}, or a class of yours: file.py:Class")
    return user_files.find(kind, "derived from omni_control.Controller", lambda found: issubclass(found, Controller))


def label(kind: str | type[Controller]) -> str:
    """What a controller is called in tables and files: the class's name for a user's own."""
    return kind.rpartition(":")[2] if isinstance(kind, str) else kind.__name__


def written(kind: str | type[Controller]) -> str:
    """How a scenario's file names a controller: a class by the file that it is in, as far as it is in one."""
    if isinstance(kind, str):
        return kind
    file = getattr(sys.modules.get(kind.__module__), "__file__", None) or kind.__module__
    return f"{file}:{kind.__qualname__}"


def parameters(kind: type[Controller]) -> dict[str, float | int | bool | str]:
    """The parameters of a controller and their defaults: public annotated class attributes that hold one value."""
    found = {
        name: getattr(kind, name, None)
        for name, hint in get_type_hints(kind).items()
        if not name.startswith("_") and get_origin(hint) is not ClassVar
    }
    return {name: value for name, value in found.items() if isinstance(value, (float, int, bool, str))}


def make(name: str | type[Controller], settings: Told, reference: Reference, n: int) -> Controller:
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
