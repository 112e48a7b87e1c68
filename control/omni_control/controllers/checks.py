"""What a controller of somebody else's does is checked where it does it, so that its mistakes are one line each."""

import inspect
import traceback
from pathlib import Path

import numpy as np

from omni_control.controllers.base import Controller, Seen
from omni_control.errors import ControllerError
from omni_control.kinematics import Array

RECORDED = ("predicted", "alpha_hat", "latency_hat")


def answer(controller: Controller, frame: int, seen: Seen) -> Array:
    """What a controller commands for its robots (n, 3): numbers, but not necessarily finite.

    Raises:
        ControllerError: it raised an exception, its commands have another shape, or what it says of itself has.
    """
    name, shape = type(controller).__name__, seen.pose.shape
    try:
        wanted = np.asarray(controller.command(frame, seen), float)
    except Exception as error:
        raise ControllerError(f"{name} failed in frame {frame}{where(type(controller), error)}") from error
    if wanted.shape != shape:
        raise ControllerError(
            f"{name} returned commands of shape {wanted.shape} in frame {frame}; {shape} finite are needed"
        )
    check_record(controller, len(wanted), f"in frame {frame}")
    return wanted


def check_record(controller: Controller, n: int, when: str) -> None:
    """Check the shapes of what a controller of `n` robots says of itself.

    Raises:
        ControllerError: one is wrong, or the constructor of `Controller` was not called.
    """
    name = type(controller).__name__
    for what in RECORDED:
        got = np.asarray(getattr(controller, what, None)).shape
        if got != (n, 3):
            raise ControllerError(f"{name} has a {what} of shape {got} {when}; {(n, 3)} is needed")
    for channel, values in controller.channels.items():
        try:
            shape = np.asarray(values, float).shape
        except (TypeError, ValueError):
            raise ControllerError(f"{name} has a channel {channel!r} that is not of numbers {when}") from None
        if not (shape[:1] == (n,) and len(shape) <= 2):
            raise ControllerError(
                f"{name} has a channel {channel!r} of shape {shape} {when}; ({n},) or ({n}, k) is needed"
            )


def where(kind: type[Controller], error: Exception) -> str:
    """Where in the controller's file an exception came from, and what it says."""
    frames = traceback.extract_tb(error.__traceback__)
    place = [f for f in frames if f.filename == inspect.getfile(kind)][-1:] or frames[-1:]
    return f" ({Path(place[0].filename).name}, line {place[0].lineno}): {type(error).__name__}: {error}"
