"""Terminal output that the commands share: errors, progress bars, results; exit codes."""

import errno
import io
import os
import signal
import sys
import textwrap
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

import click

from omni_control.errors import MAX_LINE_LENGTH, OmniError, to_printable
from omni_mj.io.atomic_files import check_folder
from omni_mj.io.printable_text import PrintableOutput, format_count, join_words

if TYPE_CHECKING:
    from omni_mj.results.result import Outcome
    from omni_mj.studies.run_scenario import AfterFrame, StartProgress

FAILED, BAD_INPUT, INTERRUPTED = 1, 2, 130  # exit codes; the last is 128 + SIGINT
# Value of MUJOCO_GL to draw without a window, which other systems than Linux do by default
OFFSCREEN_GL = "egl" if sys.platform.startswith("linux") else ""
GL_LIBRARIES = ("egl", "osmesa", "glfw", "glx", "cgl")  # that a user may choose by MUJOCO_GL
MAX_EVENTS = 5  # printed after a run


_interrupts: list[int] = []  # signals that `_interrupt` received


def _interrupt(number: int, _: object) -> NoReturn:
    """Raise KeyboardInterrupt, and record it."""
    _interrupts.append(number)
    raise KeyboardInterrupt


def run_program(command: click.Command) -> NoReturn:
    """Run a click command with the arguments of this process, and exit."""
    arguments = sys.argv[1:]
    # Closed streams are None. Output to them is discarded.
    sys.stdout, sys.stderr = (stream or io.StringIO() for stream in (sys.stdout, sys.stderr))
    if isinstance(out := sys.stdout, io.TextIOWrapper):
        encoding, is_interactive, is_unbuffered = (
            out.encoding,
            out.line_buffering,
            out.write_through,
        )
        sys.stdout = PrintableOutput(
            out.detach(), encoding, None, None, is_interactive, is_unbuffered
        )
    _set_environment(is_film=arguments[:1] == ["film"])
    if signal.getsignal(signal.SIGINT) != signal.SIG_IGN:
        signal.signal(signal.SIGINT, _interrupt)
    invoke_command(command, arguments)


def _set_environment(is_film: bool) -> None:
    """Replace settings of libraries in the environment, which may be meant for other programs.

    Figures are drawn into files without a window. Only `omni-mj film` uses MuJoCo's renderer.
    """
    for name in [name for name in os.environ if name.lstrip("_").startswith("RERUN")]:
        del os.environ[name]  # may turn recordings off
    os.environ["MPLBACKEND"] = "agg"
    if not is_film:
        os.environ["MUJOCO_GL"] = "disable"
    elif os.environ.get("MUJOCO_GL", "").strip().lower() not in GL_LIBRARIES:
        os.environ["MUJOCO_GL"] = OFFSCREEN_GL


def invoke_command(command: click.Command, arguments: list[str]) -> NoReturn:
    """Run a click command and exit.

    The exit code is 0 on success, 1 for a failure, 2 for wrong input and 130 after Ctrl-C. Errors
    and warnings are printed on stderr, one line each.
    """
    name = "omni-mj" if isinstance(command, click.Group) else f"python -m omni_mj.{command.name}"
    command_line = f"{name} {join_words(arguments)}"
    try:
        "".join(arguments).encode()  # raises UnicodeError
        with warnings.catch_warnings():
            warnings.showwarning = lambda message, *_: click.echo(
                f"warning: {to_printable(str(message), MAX_LINE_LENGTH)}", err=True
            )
            code = command.main(
                args=arguments, prog_name=name, standalone_mode=False, obj=command_line
            )
        print(end="", flush=True)
    except click.exceptions.Abort:
        exit_with_error("interrupted", INTERRUPTED)
    except OmniError as error:
        exit_with_error(str(error), BAD_INPUT)
    except click.ClickException as error:
        context = getattr(error, "ctx", None)
        message = " ".join(error.format_message().split())
        hint = "" if context is None else f"; see {context.command_path} --help"
        exit_with_error(message.rstrip(".") + hint, BAD_INPUT)
    except BrokenPipeError:  # the reader of the output ended, as `head` does
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        sys.exit(FAILED)
    except OSError as error:
        file_name = to_printable(str(error.filename or "standard output"))
        code = BAD_INPUT if error.errno == errno.ENAMETOOLONG else FAILED
        exit_with_error(f"{file_name}: {error.strerror or error}", code)
    except UnicodeError:
        exit_with_error("file names and all other arguments must be UTF-8", BAD_INPUT)
    except (MemoryError, ImportError) as error:
        if _interrupts:  # a library that is being imported may replace KeyboardInterrupt
            exit_with_error("interrupted", INTERRUPTED)
        exit_with_error(f"too little memory, or a library cannot be loaded: {error}", FAILED)
    sys.exit(code if isinstance(code, int) else 0)


def get_command_line() -> str | None:
    """Return the command line of the running command, or None if none is running."""
    context = click.get_current_context(silent=True)
    return None if context is None else context.obj


def exit_with_error(message: str, code: int) -> NoReturn:
    """Print each line of a message as an error on stderr, and exit with `code`."""
    for line in message.split("\n"):
        click.echo(f"error: {to_printable(line, MAX_LINE_LENGTH)}", err=True)
    sys.exit(code)


def exit_if_failed(outcomes: Sequence["Outcome"]) -> None:
    """Exit with code 1 if a row failed or a scenario could not be run.

    Equal lines are printed once.
    """
    lines: list[str] = []
    for outcome in outcomes:
        errors = [str(failure) for failure in outcome.failures]
        if outcome.entry["status"] == "failed":
            errors.append(outcome.entry["reason"])
        prefix = f"{outcome.scenario.name}: " if len(outcomes) > 1 else ""
        lines += [prefix + " ".join(error.split()) for error in errors]
    if lines:
        exit_with_error("\n".join(dict.fromkeys(lines)), FAILED)


def print_summary_sentence(summary: Mapping[str, Any]) -> None:
    """Print which controller was best, by how much, and why."""
    from omni_mj.results.summary_sentence import summary_sentence
    from omni_mj.results.text_table import TERMINAL_WIDTH

    if sentence := summary_sentence(summary):
        print(textwrap.fill(sentence, TERMINAL_WIDTH), end="\n\n")


def describe_outputs(folder: Path, outputs: Iterable[str]) -> str:
    """Return lines that list which of the outputs are in a folder."""
    names = ", ".join(output for output in outputs if (folder / output).exists())
    line = f"results in {folder}/ ({names})"
    return textwrap.fill(line, subsequent_indent="  ", break_long_words=False)


@contextmanager
def show_progress(
    quiet: bool, check: Callable[[], None] = lambda: None
) -> "Iterator[StartProgress]":
    """Show progress bars on stderr.

    Args:
        quiet: Whether the bars are hidden.
        check: Called after each frame; it may raise `StoppedError`.

    Yields:
        A function that starts a bar, given its title and the number of frames. It returns a
            function to call with each frame's number.
    """
    from rich.console import Console
    from rich.progress import Progress

    from omni_mj.studies.run_scenario import quiet_mujoco

    is_hidden = quiet or not sys.stderr.isatty()
    with Progress(console=Console(stderr=True), transient=True, disable=is_hidden) as display:

        def start_progress(title: str, n_frames: int) -> "AfterFrame":
            for finished_task in display.task_ids:
                display.remove_task(finished_task)
            task = display.add_task(title, total=n_frames)

            def after_frame(frame: int) -> None:
                check()
                if frame == 0:  # MuJoCo is loaded by now, if the plant needs it
                    quiet_mujoco()
                display.update(task, completed=frame + 1)

            return after_frame

        yield start_progress


@contextmanager
def report_write_errors(folder: Path) -> Iterator[None]:
    """Exit with an error of one line if the block is interrupted or cannot write to a folder.

    Raises:
        OmniError: See `omni_mj.io.atomic_files.check_folder`.
    """
    try:
        yield
    except KeyboardInterrupt:
        exit_with_error(f"interrupted; the results so far are in {folder}", INTERRUPTED)
    except BrokenPipeError:  # of standard output, see `invoke_command`
        raise
    except OSError as error:
        check_folder(folder)
        reason = error.strerror or str(error)
        exit_with_error(f"cannot write to {folder}: {reason}; the results so far are there", FAILED)


def print_events(entry: Mapping[str, Any]) -> None:
    """Print the first events of a scenario, except faults and failures, which are shown elsewhere.

    Args:
        entry: Entry of the scenario in a summary.
    """
    events = [event for event in entry["events"] if event["kind"] not in ("stopped", "fault")]
    for event in events[:MAX_EVENTS]:
        source = f"{event['controller']}, seed {event['seed']}"
        print(f"note: {event['time_s']:.2f} s, {source}: {event['text']}")
    if (n_more := len(events) - MAX_EVENTS) > 0:
        print(f"note: {format_count(n_more, 'more event')} in summary.json")
