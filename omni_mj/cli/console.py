"""What a user sees on the terminal: errors in a line each, progress."""

import io
import os
import shlex
import signal
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

import click

from omni_control.errors import OmniError, to_printable

if TYPE_CHECKING:
    from omni_mj.results.result import Outcome, Result

BAD_INPUT, FAILED = 2, 1
ENDED = {  # what a signal did, in words
    signal.SIGINT: "interrupted",
    signal.SIGTERM: "terminated",
    signal.SIGHUP: "left by its terminal",
}
EVENTS_SHOWN = 5
MESSAGE = 4000  # characters of a line, at most


def program(command: click.Command) -> NoReturn:
    """Run a click command by what was typed, as a program of its own, and exit; see `invoke`."""
    words = sys.argv[1:]
    sys.stdout, sys.stderr = (
        stream or io.StringIO() for stream in (sys.stdout, sys.stderr)
    )  # closed ones
    if "film" not in words:  # nothing else draws by MuJoCo, which looks for libraries of windows
        os.environ.setdefault("MUJOCO_GL", "disable")
    invoke(command, words)


def invoke(command: click.Command, words: list[str]) -> NoReturn:
    """Run a click command and exit.

    The code is 0 on success, 2 for bad input, 1 for a failure; each error is a line on stderr.
    """
    name = "omni-mj" if isinstance(command, click.Group) else f"python -m omni_mj.{command.name}"
    line = f"{name} {shlex.join(words)}"
    try:
        line.encode()
        code = command.main(args=words, prog_name=name, standalone_mode=False, obj=line)
        print(end="", flush=True)
    except click.exceptions.Abort:
        fail("interrupted", 130)
    except OmniError as error:
        fail(str(error), BAD_INPUT)
    except click.ClickException as error:
        context = getattr(error, "ctx", None)
        message = " ".join(error.format_message().split())
        hint = "" if context is None else f"; see {context.command_path} --help"
        fail(message.rstrip(".") + hint, BAD_INPUT)
    except BrokenPipeError:  # the reader of the output has gone, as `head` does
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        sys.exit(FAILED)
    except OSError as error:
        fail(f"{error.filename or 'standard output'}: {error.strerror or error}", FAILED)
    except UnicodeError:
        fail("names of files and all other words must be UTF-8", BAD_INPUT)
    except (MemoryError, ImportError) as error:
        fail(f"too little memory, or a library cannot be loaded: {error}", FAILED)
    sys.exit(code if isinstance(code, int) else 0)


def command_line() -> str | None:
    """The command that goes on, as it was given; None outside of any."""
    context = click.get_current_context(silent=True)
    return None if context is None else context.obj


def fail(message: str, code: int) -> NoReturn:
    """Print each line of a message as an error on stderr and exit with `code`."""
    for line in message.split("\n"):
        click.echo(f"error: {to_printable(line, MESSAGE)}", err=True)
    sys.exit(code)


def fail_rows(outcomes: Sequence["Outcome"], errors: Iterable[str] = ()) -> None:
    """End the program if anything failed, with a line for each; rows of which the same is to be said share one.

    Args:
        outcomes: of scenarios, in some of which rows were stopped.
        errors: what else went wrong.
    """
    several = len(outcomes) > 1
    lines = [
        f"{o.scenario.name}: " * several + str(failure) for o in outcomes for failure in o.failures
    ]
    lines = [" ".join(line.split()) for line in (*lines, *errors)]
    if lines:
        fail("\n".join(dict.fromkeys(lines)), FAILED)


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
    """Show progress bars on stderr.

    Yields:
        A function that begins a bar, given its title and the number of frames; it returns a
        function that is called with each frame's number.
    """
    from rich.console import Console
    from rich.progress import Progress

    is_hidden = quiet or not sys.stderr.isatty()
    with Progress(console=Console(stderr=True), transient=True, disable=is_hidden) as display:

        def begin(title: str, total: int) -> Callable[[int], None]:
            for before in display.task_ids:
                display.remove_task(before)
            task = display.add_task(title, total=total)
            return lambda frame: display.update(task, completed=frame + 1)

        yield begin


@contextmanager
def writing(folder: Path) -> Iterator[None]:
    """Within it, Ctrl-C and files that cannot be written to `folder` end the program with one line that says so."""
    left = "what could be written until then is"
    try:
        yield
    except KeyboardInterrupt:
        fail(f"{ENDED[signal.SIGINT]}; {left} in {folder}", 128 + signal.SIGINT)
    except OSError as error:
        fail(f"cannot write to {folder}: {error.strerror or error}; {left} there", FAILED)


def print_events(entry: Mapping[str, Any]) -> None:
    """Print the first events of a summary's entry, but for faults, which have a table, and rows that failed."""
    events = [event for event in entry["events"] if event["kind"] not in ("stopped", "fault")]
    for event in events[:EVENTS_SHOWN]:
        print(
            f"note: {event['time_s']:.2f} s, {event['controller']}, seed {event['seed']}: {event['text']}"
        )
    if (more := len(events) - EVENTS_SHOWN) > 0:
        print(f"note: {more} more events are in summary.json")


class Interrupts:
    """Signals as a request that is granted at the next good moment, so that no file is cut off.

    While entered, it remembers the first signal of `ENDED`, unless it is ignored as in a background
    job. A second one ends the program at once, but for that of a terminal that closes: shell and
    system may each send it.
    """

    def __init__(self) -> None:
        self._received: int = 0
        self._before: dict[int, Any] = {}

    def check(self) -> None:
        """Raise `StoppedError` if a signal has come."""
        from omni_mj.studies.study_runner import StoppedError

        if self._received:
            raise StoppedError(ENDED[signal.Signals(self._received)])

    def end(self, stopped: str | None, left: str) -> None:
        """End the program with the code of a signal, if one stopped what it did.

        Args:
            stopped: The reason that a result gives, or None.
            left: What is said of what there is.
        """
        if stopped:
            fail(f"{stopped}; {left}", 128 + self._received)

    def __enter__(self) -> "Interrupts":
        used = [number for number in ENDED if signal.getsignal(number) != signal.SIG_IGN]
        self._before = {number: signal.signal(number, self._remember) for number in used}
        return self

    def __exit__(self, *error: object) -> None:
        for number, handler in self._before.items():
            signal.signal(number, handler)

    def _remember(self, number: int, frame: object) -> None:
        self._received = number
        self.__exit__()
        if number == signal.SIGHUP:
            signal.signal(number, signal.SIG_IGN)
