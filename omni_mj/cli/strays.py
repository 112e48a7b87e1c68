"""What controllers of users leave behind in this process: errors that nobody catches, threads that do not end."""

import os
import sys
import threading
import time
from typing import Any

import click

from omni_control.errors import printable

WAIT_S = 1.0  # for threads, at the end


def attend() -> None:
    """See that an error in a thread or a finaliser is a line, not a traceback."""
    threading.excepthook = lambda args: _tell(args, f"in the thread {args.thread.name if args.thread else '?'}")
    sys.unraisablehook = lambda args: _tell(args, args.err_msg or "while something was thrown away")


def leave(code: int) -> None:
    """End the program at once if there are threads that would hold it up."""
    until = time.monotonic() + WAIT_S
    strays = [each for each in threading.enumerate() if not each.daemon and each is not threading.main_thread()]
    for each in strays:
        each.join(max(until - time.monotonic(), 0.0))
    if any(each.is_alive() for each in strays):
        click.echo("note: a controller's threads do not end; the program ends without them", err=True)
        for stream in (sys.stdout, sys.stderr):
            stream.flush()
        os._exit(code)


def _tell(args: Any, where: str) -> None:
    if not issubclass(args.exc_type, SystemExit):
        click.echo(f"note: {printable(f'{args.exc_type.__name__}: {args.exc_value}', 200)} {where}", err=True)
