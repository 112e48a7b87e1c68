"""A limit for the time that a block takes, even if users' code in it swallows exceptions."""

import signal
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import FrameType

from omni_mj.config.plugins import USER_MODULE_PREFIX

LIMIT_S = 60.0
USER_LIMIT_S = 3.0  # longest time in a user's file
TICK_S = 0.2
MAX_EXCEPTIONS = 5  # that a block may swallow


class TimeLimitError(BaseException):
    """A block took too long. Code that catches `Exception` does not swallow it."""


@contextmanager
def limit_time(
    must_end: Callable[[], bool],
    end: Callable[[str], object],
    user_limit_s: float = USER_LIMIT_S,
) -> Iterator[None]:
    """Raise `TimeLimitError` in the main thread, again and again, if the block takes over 60 s.

    Args:
        must_end: Returns whether the program must end, which ends the block within 0.2 s.
        end: Ends the program, given a message, if the block swallows all exceptions.
        user_limit_s: Longest time in users' files, s.
    """
    start = time.monotonic()
    user_s, n_exceptions = 0.0, 0

    def interrupt(_: int, frame: FrameType | None) -> None:
        nonlocal user_s, n_exceptions
        line = _find_user_line(frame)
        user_s = user_s + TICK_S if line else 0.0
        seconds = user_limit_s if user_s >= user_limit_s else LIMIT_S
        is_over = max(user_s, time.monotonic() - start) >= seconds
        if not (is_over or n_exceptions or must_end()):
            return
        n_exceptions += 1
        message = f"{line or 'this'} took longer than {seconds:g} s"
        if n_exceptions > MAX_EXCEPTIONS:
            signal.setitimer(signal.ITIMER_REAL, 0)
            end(f"{line or 'this'} hangs and could not be stopped")
        raise TimeLimitError(message)

    signal.signal(signal.SIGALRM, interrupt)
    signal.setitimer(signal.ITIMER_REAL, TICK_S, TICK_S)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)


def _find_user_line(frame: FrameType | None) -> str:
    """Return the line of a user's file that is being run, or an empty text."""
    while frame:
        if str(frame.f_globals.get("__name__")).startswith(USER_MODULE_PREFIX):
            return f"line {frame.f_lineno} of {Path(frame.f_code.co_filename).name}"
        frame = frame.f_back
    return ""
