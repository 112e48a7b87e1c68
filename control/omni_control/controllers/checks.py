"""What a controller of somebody else's does is checked where it does it, so that its mistakes are one line each."""

import inspect
import traceback
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from omni_control.controllers.base import Controller, Seen, Told
from omni_control.delay import Rows
from omni_control.errors import ControllerError, OmniError, printable
from omni_control.kinematics import Array

RECORDED = ("predicted", "alpha_hat", "latency_hat")
MOST_COLUMNS = 256  # of a controller's own that are recorded
MOST_FRAMES = 36_000  # that a controller may remember of what was sent


class AnsweredError(ControllerError):
    """A controller failed elsewhere; it is named already, with when and where."""


@dataclass(frozen=True)
class Said:
    """What a controller of n robots says of itself: see `Controller`.

    Attributes:
        recorded: `RECORDED`, by name: (n, 3) each.
        channels: by name, (n, k) each.
    """

    recorded: dict[str, Array]
    channels: dict[str, Array]


def answer(controller: Controller, frame: int, seen: Seen) -> tuple[Array, Said]:
    """What a controller commands for its robots (n, 3): numbers, but not necessarily finite; and what it says.

    Raises:
        ControllerError: it raised an exception, its commands have another shape, or what it says of itself has.
    """
    name, shape = type(controller).__name__, seen.pose.shape
    wanted = _asked(controller, frame, seen, _numbers)
    if wanted.shape != shape:
        raise ControllerError(
            f"{name} returned commands of shape {wanted.shape} in frame {frame}; {shape} finite are needed"
        )
    return wanted, said(controller, len(wanted), f"in frame {frame}")


def own_answer(controller: Controller, frame: int, seen: Seen) -> tuple[Array, Said]:
    """As `answer`, of a controller that is no guest: what it answers is what it should be, if it answers.

    Raises:
        ControllerError: it raised an exception.
    """
    wanted, channels = _asked(controller, frame, seen, lambda commands: commands), controller.channels
    own = {name: values.reshape(len(wanted), -1) for name, values in channels.items()}
    return wanted, Said({what: getattr(controller, what) for what in RECORDED}, own)


def _asked(controller: Controller, frame: int, seen: Seen, become: Callable[[Array], Array]) -> Array:
    """What becomes of a controller's commands."""
    try:
        return become(controller.command(frame, seen))
    except AnsweredError:
        raise
    except Exception as error:
        name = type(controller).__name__
        raise ControllerError(f"{name} failed in frame {frame}{where(type(controller), error)}") from error


def said(controller: Controller, n: int, when: str) -> Said:
    """What a controller of `n` robots says of itself.

    Raises:
        ControllerError: it has a wrong shape, or is no numbers, or the constructor of `Controller` was not called.
    """
    name = type(controller).__name__
    try:
        recorded = {what: np.asarray(getattr(controller, what, None), float) for what in RECORDED}
    except Exception as error:
        raise ControllerError(
            f"{name} has no {' or '.join(RECORDED)} {when}{where(type(controller), error)}"
        ) from error
    for what, values in recorded.items():
        if values.shape != (n, 3):
            raise ControllerError(f"{name} has a {what} of shape {values.shape} {when}; {(n, 3)} is needed")
    try:
        channels = {str(channel): values for channel, values in controller.channels.items()}
    except Exception as error:
        raise ControllerError(f"{name} has no channels {when}{where(type(controller), error)}") from error
    for channel, given in channels.items():
        try:
            values = np.asarray(given, float)
        except (TypeError, ValueError):
            raise ControllerError(f"{name} has a channel {channel!r} that is not of numbers {when}") from None
        if not (values.shape[:1] == (n,) and values.ndim <= 2):
            raise ControllerError(
                f"{name} has a channel {channel!r} of shape {values.shape} {when}; ({n},) or ({n}, k) is needed"
            )
        channels[channel] = values.reshape(n, -1)
    if (columns := sum(values.shape[1] for values in channels.values())) > MOST_COLUMNS:
        raise ControllerError(
            f"{name} has {columns} columns in its channels {when}; {MOST_COLUMNS} at most are recorded"
        )
    return Said(recorded, channels)


def together(each: Sequence[Said], rows: Sequence[Rows], n: int) -> Said:
    """What several controllers of `n` robots say of themselves, in arrays of its own.

    Args:
        each: what they say.
        rows: the robots of each.
        n: as above.

    Returns:
        That of all robots; not a number for those whose controller has no such channel, or a narrower one.
    """
    if len(each) == 1 and isinstance(rows[0], slice):  # of all robots
        own = each[0]
        return Said(
            {name: values.copy() for name, values in own.recorded.items()},
            {name: values.copy() for name, values in own.channels.items()},
        )
    recorded = {name: np.empty((n, 3)) for name in RECORDED}
    channels: dict[str, Array] = {}
    for own, part in zip(each, rows, strict=True):
        for name, table in recorded.items():
            table[part] = own.recorded[name]
        for name, columns in own.channels.items():
            width, known = columns.shape[1], channels.get(name)
            if known is None or known.shape[1] < width:
                channels[name] = np.full((n, width), np.nan)
                if known is not None:
                    channels[name][:, : known.shape[1]] = known
            channels[name][part, :width] = columns
    return Said(recorded, channels)


def check_made(controller: Controller, n: int) -> None:
    """See that a controller of `n` robots is one.

    Raises:
        ControllerError: it is not.
    """
    name = type(controller).__name__
    said(controller, n, "when it was made")
    memory = controller.memory_frames
    if not isinstance(memory, int) or not 0 <= memory <= MOST_FRAMES:
        raise ControllerError(
            f"{name} has memory_frames = {memory!r}; a whole number from 0 to {MOST_FRAMES} is needed"
        )


def where(kind: type[Controller], error: Exception) -> str:
    """Where in the controller's file an exception came from, and what it says."""
    frames = traceback.extract_tb(error.__traceback__)
    try:
        file = inspect.getfile(kind)
    except (TypeError, OSError):  # made without a file
        file = ""
    place = [f for f in frames if f.filename == file][-1:] or frames[-1:]
    try:
        text = str(error)
    except Exception:
        text = "what it says cannot be read"
    at = f" ({Path(place[0].filename).name}, line {place[0].lineno})" if place[0].filename != __file__ else ""
    return f"{at}: {type(error).__name__}: {printable(text)}"


def _numbers(values: ArrayLike) -> Array:
    """Commands as numbers.

    Raises:
        Exception: they are not, or the array that they are in raises one.
    """
    given = np.asarray(values)
    if given.dtype.kind == "c":
        raise TypeError("the commands are complex numbers")
    numbers = np.array(given, float)
    if given.dtype.kind not in "biufO":
        raise TypeError("the commands are text, not numbers")
    return numbers


def one_controller_each(controllers: Sequence[Controller], rows: Sequence[Rows] | None, n: int) -> list[Rows]:
    """The rows of each controller among n robots, checked; slices where they can be, which are read without copying.

    Raises:
        OmniError: robots have no controller, or two.
    """
    sizes = [len(c.predicted) for c in controllers]
    ends = np.cumsum(sizes)
    given = [slice(end - size, end) for end, size in zip(ends, sizes, strict=True)] if rows is None else rows
    try:
        robots = [np.arange(n)[part] for part in given]
    except IndexError:
        robots = []
    every = sorted(np.concatenate([[], *robots])) == list(range(n))
    if [len(part) for part in robots] != sizes or not every or 0 in sizes or not n:
        raise OmniError(
            f"{n} robots need one controller each; there are controllers for {sizes} robots, in rows {rows}"
        )
    return [slice(int(part[0]), int(part[-1]) + 1) if (np.diff(part) == 1).all() else part for part in robots]


def told_of_each(controllers: Sequence[Controller], rows: Sequence[Rows], n: int) -> list[Told]:
    """What was told of each of n robots, by the rows of each controller.

    Raises:
        OmniError: frames of different lengths.
    """
    table = np.empty(n, object)
    for controller, part in zip(controllers, rows, strict=True):
        table[part] = controller.told
    if len({told.period for told in table}) > 1:
        raise OmniError("controllers that are called together must be told frames of the same length")
    return list(table)


def checked(values: ArrayLike, n: int, what: str, *, finite: bool = False) -> Array:
    """Numbers (n, 3) of n robots, copied; `what` they are says the error.

    Raises:
        OmniError: they are not of that shape, or infinite, or, where they must be finite, not numbers.
    """
    numbers = np.array(values, float)
    finite_ones = np.isfinite(numbers) if finite else ~np.isinf(numbers)
    if numbers.shape != (n, 3) or np.count_nonzero(finite_ones) < numbers.size:
        got = f"not of shape {numbers.shape}" if numbers.shape != (n, 3) else "which these are not"
        raise OmniError(f"{what} must be finite numbers ({n}, 3), {got}")
    return numbers


def checked_ages(age: ArrayLike, n: int) -> Array | None:
    """Ages (n,) of what is seen, s, copied; none if all are zero.

    Raises:
        OmniError: they are not n finite numbers from 0 on.
    """
    try:
        ages = np.array(age, float)
    except (TypeError, ValueError):
        ages = np.full(0, np.nan)
    if ages.shape != (n,) or not (np.isfinite(ages) & (ages >= 0)).all():
        raise OmniError(f"ages must be ({n},) finite numbers of s from 0 on, not {age!r}")
    return ages if ages.any() else None
