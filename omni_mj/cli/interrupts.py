"""Ctrl-C and SIGTERM as a request that is granted at the next good moment, so that no file is cut off."""

import signal
from types import FrameType


class StoppedError(Exception):
    """A signal asked for the end.

    Attributes:
        reason: in a word, for messages.
        exit_code: what a program that a signal ended returns by convention.
    """

    def __init__(self, number: int) -> None:
        self.reason = "interrupted" if number == signal.SIGINT else "terminated"
        self.exit_code = 128 + number
        super().__init__(self.reason)


class Interrupts:
    """While entered, remembers the first SIGINT or SIGTERM, unless they are ignored as in a background job.

    A second signal ends the program at once.
    """

    HANDLED = (signal.SIGINT, signal.SIGTERM)

    def __init__(self) -> None:
        self._received = 0

    def check(self) -> None:
        """Raise `StoppedError` if a signal has come."""
        if self._received:
            raise StoppedError(self._received)

    def __enter__(self) -> "Interrupts":
        self._before = {number: signal.getsignal(number) for number in self.HANDLED}
        for number, handler in self._before.items():
            if handler != signal.SIG_IGN:
                signal.signal(number, self._remember)
        return self

    def __exit__(self, *error: object) -> None:
        for number, handler in self._before.items():
            signal.signal(number, handler)

    def _remember(self, number: int, frame: FrameType | None) -> None:
        self._received = number
        self.__exit__()
