"""What a user sees on the terminal: errors in one line, progress, the result's table."""

import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NoReturn

import click
import mujoco
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn
from rich.table import Table

from omni_control.errors import OmniError
from omni_mj.measure.metrics import AXES
from omni_mj.plants import SimulationError
from omni_mj.scenarios.controllers import ControllerError
from omni_mj.show import markdown

BAD_INPUT, FAILED = 2, 1
EVENTS_SHOWN = 5
PROGRESS_STEP = 12  # frames from one look of the progress bar to the next


def invoke(command: click.Command, args: list[str] | None = None) -> NoReturn:
    """Run a click command and exit: 0 on success, 2 for bad input, 1 for a failure; errors go to stderr."""
    log = mujoco.MjLogConfig.get()
    log.logto_file = log.logto_console = False  # warnings that matter become a SimulationError
    log.set()
    try:
        code = command.main(args=args, prog_name=_program(command), standalone_mode=False)
    except click.exceptions.Abort:
        fail("interrupted", 130)
    except (SimulationError, ControllerError) as error:
        fail(str(error), FAILED)
    except OmniError as error:
        fail(str(error), BAD_INPUT)
    except click.ClickException as error:
        fail(error.format_message(), BAD_INPUT)
    except BrokenPipeError:
        # Whoever read the output has gone, as `head` does; what is left in the buffer must not complain at exit.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        sys.exit(0)
    except OSError as error:
        fail(f"{error.filename or 'file system'}: {error.strerror or error}", FAILED)
    sys.exit(code if isinstance(code, int) else 0)


def _program(command: click.Command) -> str:
    return "omni-mj" if isinstance(command, click.Group) else f"python -m omni_mj.{command.name}"


def fail(message: str, code: int) -> NoReturn:
    """Print an error on stderr and exit with `code`; bad input has a line for each thing that is wrong."""
    for line in message.splitlines() if code == BAD_INPUT else [message]:
        click.echo(f"error: {' '.join(line.split())}", err=True)
    sys.exit(code)


@contextmanager
def progress(description: str, total: int, quiet: bool) -> Iterator[Callable[[int], None]]:
    """A progress bar on stderr; yields a function that is told how much is done."""
    if quiet or not sys.stderr.isatty():
        yield lambda done: None
        return
    label, bar, done = TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn()
    columns = (label, bar, done, TimeElapsedColumn(), TimeRemainingColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True) as display:
        task = display.add_task(description, total=total)

        def show(done: int) -> None:
            if done % PROGRESS_STEP == 0 or done == total:
                display.update(task, completed=done)

        yield show


@contextmanager
def writing(folder: Path) -> Iterator[None]:
    """Within it, that files cannot be written to `folder` ends the program with one line that says so."""
    try:
        yield
    except BrokenPipeError:  # not the folder's: whoever read the table has gone
        raise
    except OSError as error:
        reason = error.strerror or str(error)
        fail(f"cannot write to {folder}: {reason}; what could be written until then is there", FAILED)


def result_rows(summary: dict[str, Any]) -> tuple[list[str], list[list[str]]]:
    """Headings and rows of the table that compares the controllers, and the paper's, each with its first; in cm."""
    ours = {name: result["error_m"] for name, result in summary["results"].items()}
    medians = {
        name: {axis: {key: value["median"] for key, value in error[axis].items()} for axis in AXES}
        for name, error in ours.items()
    }
    statistics = [(axis, key, label) for axis in AXES for key, label in (("max", "maximum"), ("mean", "mean"))]
    rows = []
    for prefix, errors in (("", medians), ("paper's ", summary["paper"] or {})):
        base: dict[str, dict[str, float]] | None = None
        for name, error in errors.items():
            rows.append(
                [prefix + name]
                + [_cell(error[axis][key], base[axis][key] if base else None) for axis, key, _ in statistics]
            )
            base = base or error
    return ["error in cm", *(f"{axis} {label}" for axis, _, label in statistics)], rows


def _cell(error_m: float, base_m: float | None) -> str:
    """An error in cm and its difference to that of the first controller, if there is one."""
    return f"{100 * error_m:.2f}" + (f" ({100 * (error_m / base_m - 1):+.0f} %)" if base_m else "")


def print_result(summary: dict[str, Any]) -> None:
    """Print the table of a summary."""
    headings, rows = result_rows(summary)
    seeds = len(summary["seeds"])
    over = f"median of {seeds} seeds" if seeds > 1 else f"seed {summary['seeds'][0]}"
    title = f"{summary['scenario']} on the {summary['plant']} plant, {over}"
    table = Table(title=title, title_justify="left", title_style="bold")
    for i, heading in enumerate(headings):
        table.add_column(heading, justify="right" if i else "left")
    for row in rows:
        table.add_row(*row)
    Console(width=None if sys.stdout.isatty() else 120).print(table)
    for event in summary["events"][:EVENTS_SHOWN]:
        print(f"note: {event['time_s']:.2f} s, {event['controller']}, seed {event['seed']}: {event['text']}")
    if (more := len(summary["events"]) - EVENTS_SHOWN) > 0:
        print(f"note: {more} more events are in summary.json")


def print_alpha(result: dict[str, Any], folder: Path) -> None:
    """Print what came out of the alpha study."""
    table = Table(title="mean alpha over everything else", title_justify="left", title_style="bold")
    table.add_column("condition")
    table.add_column("alpha at each value", justify="left")
    for name, means in result["trends"].items():
        pairs = zip(result["axes"][name], means, strict=True)
        table.add_row(name, "   ".join(f"{value:g}: {mean:.3f}" for value, mean in pairs))
    Console(width=None if sys.stdout.isatty() else 120).print(table)
    usual = result["usual"]
    bounds = ", ".join(f"{name} {low:g} to {high:g}" for name, (low, high) in usual["conditions"].items())
    print(f"usual conditions ({bounds}):")
    print(f"  5th, 50th, 95th percentile of alpha: {usual['p5']:.3f}, {usual['p50']:.3f}, {usual['p95']:.3f}")
    print(f"results in {folder}/ (alpha.json, alpha.png) after {result['wall_s']:.0f} s")


def markdown_result(summary: dict[str, Any]) -> str:
    """The same table as Markdown."""
    return markdown.table(*result_rows(summary))
