"""Signals as a request that is granted at the next good moment, so that no file is cut off."""

import signal
from types import FrameType

from omni_mj.cli import console
from omni_mj.studies.outcome import StoppedError


class Interrupts:
    """While entered, remembers the first signal of `console.ENDED`, unless it is ignored as in a background job.

    A second signal ends the program at once, but for that of a terminal that closes: shell and system may each send it.
    """

    def __init__(self) -> None:
        self._received = 0

    def check(self) -> None:
        """Raise `StoppedError` if a signal has come."""
        if self._received:
            raise StoppedError(console.ENDED[self._received])

    def end(self, stopped: str | None, left: str) -> None:
        """End the program, if a signal stopped what it did; it returns what one that a signal ended does by convention.

        Args:
            stopped: the reason that a result gives, or None.
            left: what is said of what there is.
        """
        if stopped:
            console.fail(f"{stopped}; {left}", 128 + self._received)

    def __enter__(self) -> "Interrupts":
        self._before = {number: signal.getsignal(number) for number in console.ENDED}
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
        if console.ENDED[number] == console.LEFT:
            signal.signal(number, signal.SIG_IGN)
