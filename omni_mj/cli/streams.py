"""Standard streams that are closed, or that nobody reads any more: neither costs numbers or figures."""

import errno
import io
import os
import sys
from typing import Any, TextIO

OUT, ERR = 1, 2
GONE = (errno.EPIPE, errno.EIO)  # the reader of a pipe, a terminal
OUTPUT = "standard output"  # as the name of the file that cannot be written


def attend() -> None:
    """See that there are standard streams, and that a program whose output nobody reads goes on without.

    A closed one is opened on nothing: the next file that is opened would take its number, and what libraries print
    would be written there. Streams that somebody has put in place of the process's own stay.
    """
    for number in (0, OUT, ERR):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # takes the lowest number that is free
    if sys.stdout is sys.__stdout__:
        sys.stdout = _stream(OUT, sys.stdout)
    if sys.stderr is sys.__stderr__:
        sys.stderr = _stream(ERR, sys.stderr)


class _Raw(io.FileIO):
    """A standard stream whose reader may go, as `head` does."""

    def write(self, data: Any, /) -> int:
        try:
            return super().write(data)
        except OSError as error:
            os.dup2(os.open(os.devnull, os.O_WRONLY), self.fileno())  # what is left shall not complain at the end
            if self.fileno() == OUT and error.errno not in GONE:
                raise OSError(error.errno, error.strerror, OUTPUT) from None
            return memoryview(data).nbytes


def _stream(number: int, before: TextIO | None) -> TextIO:
    return io.TextIOWrapper(
        io.BufferedWriter(_Raw(number, "w", closefd=False)),
        encoding=before.encoding if before else "utf-8",
        errors=(before.errors if before else None) or "backslashreplace",
        line_buffering=number == ERR or os.isatty(number),
    )
