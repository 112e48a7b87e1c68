"""What a user sees on the terminal: errors in a line each, progress."""

import errno
import os
import shlex
import signal
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

import click

from omni_control.errors import OmniError, printable
from omni_mj.cli import streams

if TYPE_CHECKING:
    from omni_mj.measure.result import Result
    from omni_mj.simulate.simulation import Failure
    from omni_mj.studies.cost import Cost

BAD_INPUT, FAILED = 2, 1
NO_PATH = (errno.ENAMETOOLONG, errno.ELOOP)  # what no file can be at
NO_MEMORY = "Could not allocate memory"  # what MuJoCo's compiler says
LEFT = "left by its terminal"
ENDED: dict[int, str] = {signal.SIGINT: "interrupted", signal.SIGTERM: "terminated"}  # what a signal did, in words
if hasattr(signal, "SIGHUP"):
    ENDED[signal.SIGHUP] = LEFT
EVENTS_SHOWN = 5
MESSAGE = 4000  # characters of a line, at most
PROGRESS_STEP = 12  # frames from one look of the progress bar to the next


def program(command: click.Command) -> NoReturn:
    """Run a click command by what was typed, as a program of its own, and exit; see `invoke`."""
    words = sys.argv[1:]
    if "film" not in words:  # nothing else draws by MuJoCo, which looks for libraries of windows
        os.environ.setdefault("MUJOCO_GL", "disable")
    invoke(command, words)


def invoke(command: click.Command, words: list[str]) -> NoReturn:
    """Run a click command and exit: 0 on success, 2 for bad input, 1 for a failure; each error is a line on stderr."""
    streams.attend()
    for word in words:
        if not word.isascii() and word.encode(errors="ignore").decode() != word:
            fail(f"{word!r} is not UTF-8, which names of files and all other words must be", BAD_INPUT)
    name = "omni-mj" if isinstance(command, click.Group) else f"python -m omni_mj.{command.name}"
    try:
        line = shlex.join([*name.split(), *words])
        code = command.main(args=words, prog_name=name, standalone_mode=False, obj=line)
        sys.stdout.flush()
    except click.exceptions.Abort:
        fail("interrupted", 130)
    except OmniError as error:
        fail(str(error), BAD_INPUT)
    except click.ClickException as error:
        context = getattr(error, "ctx", None)
        message = " ".join(error.format_message().split())
        fail(message if context is None else f"{message.rstrip('.')}; see {context.command_path} --help", BAD_INPUT)
    except OSError as error:
        if error.errno in NO_PATH:
            fail(f"{error.strerror}: {printable(str(error.filename), 100)}", BAD_INPUT)
        fail(f"{error.filename or 'file system'}: {error.strerror or error}", FAILED)
    except (MemoryError, ImportError, ValueError) as error:
        if isinstance(error, ValueError) and NO_MEMORY not in str(error):
            raise
        fail(f"there is too little memory, or a library cannot be loaded: {' '.join(str(error).split())}", FAILED)
    sys.exit(code if isinstance(code, int) else 0)


def command_line() -> str | None:
    """The command that goes on, as it was given; None outside of any."""
    context = click.get_current_context(silent=True)
    return None if context is None else context.obj


def fail(message: str, code: int) -> NoReturn:
    """Print each line of a message as an error on stderr and exit with `code`."""
    for line in message.split("\n"):
        click.echo(f"error: {printable(line, MESSAGE)}", err=True)
    sys.exit(code)


def fail_rows(failures: Mapping[str, Iterable["Failure"]], errors: Iterable[str] = ()) -> None:
    """End the program if anything failed, with a line for each.

    Args:
        failures: scenario -> its rows that were stopped.
        errors: what else went wrong.
    """
    several = len(failures) > 1
    lines = [f"{name}: " * several + str(failure) for name, rows in failures.items() for failure in rows]
    lines = [" ".join(line.split()) for line in (*lines, *errors)]
    if lines:
        fail("\n".join(lines), FAILED)


def tell_costs(costs: Sequence["Cost"], quiet: bool) -> None:
    """Print what big runs take, unless quiet.

    Raises:
        OmniError: one takes more memory than there is.
    """
    from omni_mj.studies import cost

    cost.check(costs)
    for each in costs:
        if each.big and not quiet:
            click.echo(f"note: {each}", err=True)


def quiet_mujoco() -> None:
    """Keep MuJoCo, if it is used at all, from printing warnings; those that matter are a row's failure."""
    if "mujoco" in sys.modules:
        import mujoco

        log = mujoco.MjLogConfig.get()
        log.logto_file = log.logto_console = False
        log.set()


def checked(check: Callable[[], None], show: Callable[[int], None]) -> Callable[[int], None]:
    """What to call with each frame's number: it checks whether to stop, and shows how far it is."""

    def after_frame(frame: int) -> None:
        check()
        if frame == 0:
            quiet_mujoco()
        show(frame)

    return after_frame


def tell(result: "Result", folder: Path, outputs: Iterable[str]) -> None:
    """Print a study's table, and which of its outputs are in the folder."""
    print(result.table())
    print(f"{results(folder, outputs)} after {result.wall_s:.0f} s")


def results(folder: Path, outputs: Iterable[str]) -> str:
    """Where results are, and which of the outputs."""
    return f"results in {folder}/ ({', '.join(output for output in outputs if (folder / output).exists())})"


@contextmanager
def progress(quiet: bool) -> Iterator[Callable[[str, int], Callable[[int], None]]]:
    """Progress bars on stderr.

    Yields:
        A function that begins a bar, given what it is of and how many frames there are; it returns a function that is
        told each frame's number.
    """
    if quiet or not sys.stderr.isatty():
        yield lambda description, total: lambda frame: None
        return
    from rich.console import Console
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        Progress,
        TextColumn,
        TimeElapsedColumn,
        TimeRemainingColumn,
    )

    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn())
    with Progress(
        *columns, TimeElapsedColumn(), TimeRemainingColumn(), console=Console(stderr=True), transient=True
    ) as display:

        def begin(description: str, total: int) -> Callable[[int], None]:
            for before in display.task_ids:
                display.remove_task(before)
            task = display.add_task(description, total=total)

            def after_frame(frame: int) -> None:
                if (frame + 1) % PROGRESS_STEP == 0 or frame + 1 == total:
                    display.update(task, completed=frame + 1)

            return after_frame

        yield begin


@contextmanager
def writing(folder: Path) -> Iterator[None]:
    """Within it, that files cannot be written to `folder` ends the program with one line that says so."""
    try:
        yield
    except OSError as error:
        if error.filename == streams.OUTPUT:
            raise
        reason = error.strerror or str(error)
        fail(f"cannot write to {folder}: {reason}; what could be written until then is there", FAILED)


@contextmanager
def drawing(folder: Path) -> Iterator[None]:
    """Within it, what cannot be drawn, or is interrupted, ends the program with a line: the numbers are on the disk."""
    kept = f"the numbers are whole in {folder}; figures and report may be missing"
    try:
        yield
    except KeyboardInterrupt:
        fail(f"{ENDED[signal.SIGINT]}; {kept}", 128 + signal.SIGINT)
    except Exception as error:
        reason = (isinstance(error, OSError) and error.strerror) or f"{type(error).__name__}: {error}"
        fail(f"not all could be drawn: {' '.join(reason.split())}; {kept}", FAILED)


def print_events(entry: Mapping[str, Any]) -> None:
    """Print the first events of a summary's entry, but for faults, which have a table, and rows that failed."""
    events = [event for event in entry["events"] if event["kind"] not in ("stopped", "fault")]
    for event in events[:EVENTS_SHOWN]:
        print(f"note: {event['time_s']:.2f} s, {event['controller']}, seed {event['seed']}: {event['text']}")
    if (more := len(events) - EVENTS_SHOWN) > 0:
        print(f"note: {more} more events are in summary.json")
