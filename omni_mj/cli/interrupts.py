"""Ctrl-C and other signals, which stop a command between two frames."""

import os
import signal
from typing import Any

from omni_mj.cli import console

SIGNAL_REASONS = {  # signal -> why the command stopped
    signal.SIGINT: "interrupted",
    signal.SIGTERM: "terminated",
    signal.SIGHUP: "stopped by its closed terminal",
}


class Interrupts:
    """Signals that stop a command between two frames, so that no file is cut off.

    As a context manager, it stores the first signal of `SIGNAL_REASONS` that arrives. Signals that
    are ignored, as in a background job, stay ignored. A second signal ends the program at once,
    except for SIGHUP: the shell and the system may both send it when a terminal closes.
    """

    def __init__(self) -> None:
        self._received: int = 0
        self._old_handlers: dict[int, Any] = {}

    def check(self) -> None:
        """Raise `StoppedError` if a signal has arrived."""
        from omni_mj.studies.run_scenario import StoppedError

        if self._received:
            raise StoppedError(SIGNAL_REASONS[signal.Signals(self._received)])

    def exit_if_stopped(self, reason: str | None, message: str) -> None:
        """Exit with code 128 plus the number of the signal if a signal stopped the run.

        Args:
            reason: Reason of `SIGNAL_REASONS`, or None if the run was not stopped.
            message: Text to print after the reason.
        """
        if reason:
            console.exit_with_error(f"{reason}; {message}", 128 + self._received)

    def exit_at_once(self, message: str) -> None:
        """Exit although code that hangs catches all exceptions: by the signal's code, or 1."""
        try:
            console.exit_with_error(
                message, 128 + self._received if self._received else console.FAILED
            )
        except SystemExit as end:
            os._exit(int(str(end.code)))

    def __enter__(self) -> "Interrupts":
        self._old_handlers = {
            number: signal.signal(number, self._store)
            for number in SIGNAL_REASONS
            if signal.getsignal(number) != signal.SIG_IGN
        }
        return self

    def __exit__(self, *error: object) -> None:
        for number, handler in self._old_handlers.items():
            signal.signal(number, handler)

    def _store(self, number: int, _: object) -> None:
        """Store the number of a signal, and restore the handlers; called by the system."""
        self._received = number
        self.__exit__()
        if number == signal.SIGHUP:
            signal.signal(number, signal.SIG_IGN)
