"""Controllers of somebody else's, each in a process of its own, where nothing that it does reaches anybody else.

A thread (`guests`) can be given up only when it lets others run. A process can be ended whatever it does: a compiled
loop that never returns, `os._exit`, a crash, all memory. It is a fork, so that the class, what it is told and the
reference need not be sent; questions and answers are.
"""

import contextvars
import gc
import math
import os
import signal
import sys
import warnings
import weakref
from collections.abc import Callable
from contextlib import suppress
from multiprocessing.connection import Connection, Pipe
from typing import Any, NoReturn, TypeVar

from omni_control.controllers import guests
from omni_control.controllers.base import Controller, Seen, Told
from omni_control.controllers.checks import AnsweredError, Said, answer, said
from omni_control.errors import ControllerError, printable
from omni_control.kinematics import Array
from omni_control.reference import Reference

T = TypeVar("T")
POSSIBLE = hasattr(os, "fork")
SPARE_S = 3.0  # after its patience is over, until the system ends it even if nobody is left to do so


class Apart(Controller):
    """Stands for a controller that is somewhere else, and asks it.

    Args:
        told, reference, n: as `Controller`.
        make: what makes the controller; called there.

    Raises:
        ControllerError: it cannot be made.
    """

    def __init__(self, told: Told, reference: Reference, n: int, make: Callable[[], Controller]) -> None:
        super().__init__(told, reference, n)
        self._line, theirs = Pipe()
        for stream in (sys.stdout, sys.stderr):
            if stream is not None:
                stream.flush()  # or what is in it would be written twice
        try:
            with warnings.catch_warnings():  # from 3.12 on of other threads, of which nothing is used there
                warnings.simplefilter("ignore", DeprecationWarning)
                pid = os.fork()
        except OSError as error:
            raise AnsweredError(f"{_name(self)} cannot have a process of its own: {error.strerror}") from None
        if not pid:
            self._line.close()
            contextvars.Context().run(_live, theirs, make, type(self))
        theirs.close()
        self._pid, self.leave = pid, weakref.finalize(self, _end, pid, self._line, os.getpid())
        self.memory_frames, known = self._answered("when it was made")
        self._say(known)

    def command(self, frame: int, seen: Seen) -> Array:
        """See `Controller`.

        Raises:
            ControllerError: it failed, did not answer, or its process is no more.
        """
        wanted, known = self._answered(f"in frame {frame}", (frame, seen))
        self._say(known)
        return wanted

    def _heard(self, most_s: float) -> bool:
        """Whether there is an answer, or nobody to give one, within some seconds."""
        if self._line.poll(most_s):
            return True
        ended = os.waitid(os.P_PID, self._pid, os.WEXITED | os.WNOHANG | os.WNOWAIT)
        if ended is not None and not self._line.poll():
            raise EOFError  # what it has started may hold the line
        return False

    def _say(self, known: Said) -> None:
        vars(self).update(known.recorded, channels=known.channels)

    def _answered(self, when: str, question: object = None) -> tuple[Any, Said]:
        try:
            if question is not None:
                self._line.send(question)
            guests.wait(self._heard, self.patience_s)
            answered, error = self._line.recv()
        except TimeoutError as gone:
            self.leave()
            raise AnsweredError(f"{_name(self)} did not answer {when}: {gone}") from None
        except (EOFError, OSError):
            raise AnsweredError(f"{_name(self)} ended its process {when}{_how(self.leave())}") from None
        except BaseException:
            self.leave()
            raise
        if error is not None:
            raise AnsweredError(error)
        return answered


def make(
    kind: type[Controller], told: Told, reference: Reference, n: int, made: Callable[[], Controller]
) -> Controller:
    """A controller of a class in a process of its own; `made` makes it there."""
    own = {name: getattr(kind, name) for name in ("knows_truth", "patience_s")}
    return type(kind.__name__, (Apart,), own)(told, reference, n, made)


def _live(line: Connection, make: Callable[[], Controller], kind: type[Controller]) -> NoReturn:
    """The other process: make the controller, answer questions, end when nobody asks any more."""
    pid = os.getpid()
    try:
        os.setpgid(0, 0)  # what it starts ends with it, and a terminal's signals are for who asks
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
            signal.signal(number, signal.SIG_IGN)
        signal.signal(signal.SIGALRM, signal.SIG_DFL)
        gc.freeze()  # what the program had is nobody's here, and not to be thrown away
        os.dup2(2, 1)
        name, most_s = kind.__name__, math.ceil(kind.patience_s + SPARE_S)
        guests.settle(name)
        controller, error = _tried(make, name, "when it was made", most_s)
        known = None if controller is None else said(controller, len(controller.predicted), "when it was made")
        line.send((None if controller is None else (controller.memory_frames, known), error))
        while controller is not None:
            frame, seen = line.recv()
            answered = _tried(lambda: answer(controller, frame, seen), name, f"in frame {frame}", most_s)  # noqa: B023
            if os.getpid() != pid:  # it has forked, and this is not who was asked
                os._exit(0)
            line.send(answered)
    finally:
        if os.getpid() == pid:
            os.killpg(0, signal.SIGKILL)
        os._exit(0)


def _tried(task: Callable[[], T], name: str, when: str, most_s: int) -> tuple[T | None, str | None]:
    """What a task returns, or why it does not."""
    signal.alarm(most_s)
    try:
        return task(), None
    except ControllerError as error:
        return None, str(error)
    except Exception as error:
        return None, f"{name} failed {when}: {type(error).__name__}: {printable(str(error))}"
    except BaseException as error:
        return None, f"{name} wanted to end the program {when}, by {type(error).__name__}"
    finally:
        signal.alarm(0)


def _name(controller: Controller) -> str:
    return type(controller).__name__


def _how(status: int | None) -> str:
    """How a process ended, by what the system says of it."""
    if status is None:
        return ""
    code = os.waitstatus_to_exitcode(status)
    return f", by {signal.Signals(-code).name}" if code < 0 else f", with exit status {code}"


def _end(pid: int, line: Connection, owner: int) -> int | None:
    """End a process and what it has started; return what the system says of it."""
    line.close()
    if os.getpid() != owner:  # a fork of the program, whose process this is not
        return None
    for each in (os.killpg, os.kill):
        with suppress(OSError):
            each(pid, signal.SIGKILL)
    try:
        return os.waitpid(pid, 0)[1]
    except ChildProcessError:
        return None
