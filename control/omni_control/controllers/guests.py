"""Controllers of somebody else's, asked in such a way that what they do wrong is theirs alone.

A guest is asked in a thread that can be given up when it does not answer. Python's and numpy's global random numbers
are its own, whoever seeds them; what it prints goes to stderr after its name; the working folder, warnings and numpy's
error handling are afterwards as they were. This is what mistakes need, not more: a guest here is code that runs in this
process. Those from files have processes of their own (`apart`).
"""

import contextvars
import ctypes
import io
import os
import random
import sys
import threading
import time
import warnings
import zlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from queue import SimpleQueue
from typing import Any, TypeVar

import numpy as np
from numpy.random.mtrand import get_bit_generator, set_bit_generator

from omni_control.controllers.base import Controller
from omni_control.errors import ControllerError

T = TypeVar("T")
HOUSE = ("omni_control.", "omni_mj.")  # packages whose controllers are no guests
ATTRIBUTE = "_guest"  # of a controller that is one
HURRY_S = 1.0  # how much longer a guest is waited for when somebody wants to stop
OURS = (  # what is put back in its place
    (sys, "stdout"), (sys, "stderr"), (sys, "stdin"), (sys, "excepthook"), (sys, "unraisablehook"),
    (threading, "excepthook"),
)  # fmt: skip
LOOK_S = 0.05  # how often is looked whether somebody does

_hurried: float | None = None  # since when
_look: Callable[[float], None] | None = None  # see `watched`
_worker: "_Worker | None" = None


class Guest:
    """Calls what is a guest's.

    Args:
        name: of the guest, for messages; its random numbers are seeded by it.
        patience_s: how long it may take to answer, s.
    """

    def __init__(self, name: str, patience_s: float) -> None:
        self._name, self._patience_s = name, patience_s
        seed = zlib.crc32(name.encode())
        self._numpy: np.random.BitGenerator = np.random.MT19937(seed)
        self._python = random.Random(seed).getstate()
        self._voice = _Voice(name)

    def call(self, task: Callable[[], T], when: str) -> T:
        """What `task`, which calls the guest, returns.

        Args:
            task: is called with nothing.
            when: that is, for messages.

        Raises:
            ControllerError: it does not answer in time, or wants to end the program.
            Exception: whatever else it raises.
        """
        global _worker
        if _worker is None:
            _worker = _Worker()
        with self._aside():
            try:
                answer, error = _worker.call(task, self._patience_s)
            except BaseException as gone:  # it still has not answered
                _worker.give_up()
                _worker = None
                if isinstance(gone, TimeoutError):
                    raise ControllerError(f"{self._name} did not answer {when}: {gone}") from None
                raise
        if error is None:
            return answer
        if isinstance(error, Exception):
            raise error
        raise ControllerError(f"{self._name} wanted to end the program {when}, by {type(error).__name__}")

    @contextmanager
    def _aside(self) -> Iterator[None]:
        """Put away what is the program's, within it the guest's is in place."""
        bits, state, folder = get_bit_generator(), random.getstate(), _folder()
        filters, depth, ours = warnings.filters[:], sys.getrecursionlimit(), [getattr(*each) for each in OURS]
        hooks = threading.gettrace(), threading.getprofile()
        set_bit_generator(self._numpy)
        random.setstate(self._python)
        if self._voice.closed:
            self._voice = _Voice(self._name)
        self._voice.listener = sys.stderr
        sys.stdout = sys.stderr = self._voice
        try:
            yield
        finally:
            for (module, name), value in zip(OURS, ours, strict=True):
                setattr(module, name, value)
            threading.settrace(hooks[0])
            threading.setprofile(hooks[1])
            if sys.getrecursionlimit() != depth:
                sys.setrecursionlimit(depth)
            self._numpy, self._python = get_bit_generator(), random.getstate()
            set_bit_generator(bits)
            random.setstate(state)
            if warnings.filters != filters:
                warnings.filters[:] = filters  # type: ignore[index]
            if folder is not None and _folder() != folder:
                os.chdir(folder)


def guest(kind: type[Controller]) -> Guest | None:
    """What calls a controller of a class, or None where that is no guest's."""
    return None if f"{kind.__module__}.".startswith(HOUSE) else Guest(kind.__name__, kind.patience_s)


def guest_of(controller: Controller) -> Guest | None:
    """What calls a controller, the same as when it was made."""
    return vars(controller).get(ATTRIBUTE) or guest(type(controller))


def hurry(wanted: bool = True) -> None:
    """Say that somebody wants to stop, and guests that do not answer within `HURRY_S` have failed; or no more."""
    global _hurried
    _hurried = time.monotonic() if wanted else None


@contextmanager
def watched(look: Callable[[float], None]) -> Iterator[None]:
    """Within it, a function is called every `LOOK_S` while a guest is waited for, by the thread that waits.

    Args:
        look: is given how long the guest has been waited for, s. The guest has failed if it raises `TimeoutError`.
    """
    global _look
    before, _look = _look, look
    try:
        yield
    finally:
        _look = before


def wait(answered: Callable[[float], bool], patience_s: float) -> None:
    """Wait for a guest's answer.

    Args:
        answered: waits so many seconds at most, and returns whether there is one.
        patience_s: after which it has failed.

    Raises:
        TimeoutError: there is none in time.
    """
    began = time.monotonic()
    while True:
        now = time.monotonic()
        if now - began >= patience_s:
            raise TimeoutError(f"it was waited for for {patience_s:g} s")
        if _hurried is not None and now - max(began, _hurried) >= HURRY_S:
            raise TimeoutError("it was to stop")
        if answered(min(began + patience_s - now, LOOK_S)):
            return
        if _look is not None:
            _look(time.monotonic() - began)


def settle(name: str) -> None:
    """Make all of this process a guest's: random numbers as in `Guest`, and streams that say its name."""
    seed = zlib.crc32(name.encode())
    set_bit_generator(np.random.MT19937(seed))
    random.seed(seed)
    voice = _Voice(name)
    voice.listener = open(2, "w", buffering=1, errors="backslashreplace", closefd=False)  # noqa: SIM115
    sys.stdout = sys.stderr = voice


class _Worker:
    """A thread that does one task after the other."""

    def __init__(self) -> None:
        self._tasks, self._given_up = SimpleQueue[Callable[[], Any]](), False
        self._answer: tuple[Any, BaseException | None] = None, None
        # A lock is free while there is an answer. A queue would not do: CPython's `SimpleQueue.get` waits without end
        # when a signal's handler takes longer than what is left of its timeout.
        self._answered = threading.Lock()
        self._answered.acquire()
        self._thread = threading.Thread(target=self._work, name="guest", daemon=True)
        self._thread.start()

    def call(self, task: Callable[[], T], patience_s: float) -> tuple[Any, BaseException | None]:
        """What the task returns, or raises.

        Raises:
            TimeoutError: it does neither in time.
        """
        self._tasks.put(task)
        wait(lambda most_s: self._answered.acquire(timeout=most_s), patience_s)
        answer, self._answer = self._answer, (None, None)
        return answer

    def give_up(self) -> None:
        """Let the thread end as soon as it will, by an exception in what it does."""
        self._given_up = True
        ctypes.pythonapi.PyThreadState_SetAsyncExc(
            ctypes.c_ulong(self._thread.ident or 0), ctypes.py_object(SystemExit)
        )

    def _work(self) -> None:
        trace, profile, program = sys.gettrace(), sys.getprofile(), os.getpid()
        while not self._given_up:
            task = self._tasks.get()
            try:
                self._answer = contextvars.Context().run(task), None
            except BaseException as error:
                self._answer = None, error
            if os.getpid() != program:  # the guest has forked, and this is not who was asked
                os._exit(0)
            del task
            sys.settrace(trace)
            sys.setprofile(profile)
            self._answered.release()


class _Voice(io.TextIOBase):
    """What a guest prints, line by line after its name."""

    def __init__(self, name: str) -> None:
        self._name, self._begun = name, False
        self.listener: Any = None

    def write(self, text: str) -> int:
        """See `io.TextIOBase`; nobody listening costs nothing.

        Raises:
            TypeError: it is no text, by which others know that this is no binary stream.
        """
        if not isinstance(text, str):
            raise TypeError(f"a text is needed, not {type(text).__name__}")
        for line in text.splitlines(keepends=True):
            said = line if self._begun else f"{self._name}: {line}"
            self._begun = not line.endswith("\n")
            try:
                self.listener.write(said)
            except (OSError, ValueError, AttributeError):
                return len(text)
        return len(text)


def _folder() -> str | None:
    try:
        return os.getcwd()
    except OSError:  # it was removed
        return None


def _forget() -> None:
    """In a process that was forked off, there is no thread."""
    global _worker
    _worker = None


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_forget)
