"""`omni-mj drive`: drive external robots, real or of another simulator, and measure latency."""

import gc
import json
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from omni_control.errors import OmniError
from omni_mj.cli import console, options, output_folders
from omni_mj.cli import run as run_command

if TYPE_CHECKING:
    from omni_mj.config.scenario import Scenario
    from omni_mj.live.frame_clock import FrameClock
    from omni_mj.live.session import ConnectionOptions

CONTROLLER = "adaptive-comp-flc"
ALPHAS = "assumed_alpha_forward", "assumed_alpha_sideways"  # zero: not known
DURATION = click.FloatRange(min=0, max=1e5, min_open=True)
OUTPUTS = (*run_command.OUTPUTS, "link.json")


@click.command("drive", context_settings={"show_default": True})
@options.SCENARIO
@click.option("--controller", metavar="NAME|FILE.py:Class", default=CONTROLLER)
@options.ROBOT
@click.option("--team", "colour", type=click.Choice(["blue", "yellow"]), default="blue")
@click.option(
    "--id",
    "ids",
    type=click.IntRange(0, 255),
    multiple=True,
    help="A robot's number; may be repeated. [lowest seen]",
)
@click.option("--vision", metavar="ADDRESS[:PORT]", default="224.5.23.2:10020")
@click.option(
    "--commands", metavar="HOST[:PORT]", help="[127.0.0.1:10301 for blue, 10302 for yellow]"
)
@click.option(
    "--interface", metavar="ADDRESS", default="127.0.0.1", help="Own address on their net."
)
@click.option(
    "--rate",
    "pace",
    type=click.Choice(["auto", "60", "vision"]),
    default="auto",
    help="What gives ticks.",
)
@click.option(
    "--radio", metavar="FILE.py:Class", help="A radio of your own. [ssl-simulation-protocol]"
)
@click.option(
    "--wait",
    "wait_s",
    type=click.FloatRange(0, 1e5),
    default=10.0,
    help="How long vision is waited for, s.",
)
@click.option(
    "--duration", "duration_s", type=DURATION, help="End after so many seconds. [the whole route]"
)
@click.option(
    "--pulse/--no-pulse", default=True, help="Measure dead time first: robots turn to and fro."
)
@click.option("--dry-run", is_flag=True, help="Only listen: rates, cameras, robots, noise.")
@options.SETTINGS
@click.option(
    "--out", type=options.FOLDER, metavar="DIR", help="[runs/drive-<scenario>-<UTC time>]"
)
@options.OVERWRITE
@options.RECORD
@options.VIEW
@options.CONNECT
@options.FIGURES
@options.QUIET
@options.outputs
def command(
    name: str | None,
    controller: str,
    robot: str | None,
    overrides: tuple[str, ...],
    outputs: options.Outputs,
    quiet: bool,
    **values: Any,
) -> None:
    """Drive robots that SSL-Vision detects, and measure their latency and alpha."""
    from omni_mj.config import scenario
    from omni_mj.config.robot_files import DEFAULT_ROBOT
    from omni_mj.config.toml_files import find_builtin_scenarios
    from omni_mj.live import session
    from omni_mj.studies.study_runner import StoppedError

    out, overwrite, dry_run = map(values.pop, ("out", "overwrite", "dry_run"))
    connection = session.ConnectionOptions(overrides=overrides, **values)
    if dry_run:
        with _connected(
            connection, "vision had not been listened to for long enough to say anything"
        ) as (frame_clock, _):
            with suppress(StoppedError):
                frame_clock.listen_for(connection.duration_s or float("inf"))
            print("\n".join(frame_clock.vision.describe()))
        return
    if name is None:
        raise OmniError(
            f"--scenario is missing; choose from {', '.join(find_builtin_scenarios())}, or a .toml file"
        )
    head = {"controllers": (controller,), "plant": "live", "seeds": 1} | (
        {"robot": robot} if robot else {}
    )
    chosen = scenario.load_with_overrides(name, overrides, head)
    if robot is None and chosen.robot == DEFAULT_ROBOT:  # nobody said which robot is out there
        unknown = {
            alpha: 0.0 for alpha in ALPHAS if not connection.is_overridden(f"control.{alpha}")
        }
        chosen = chosen.replace(settings=chosen.settings.replace(control=unknown))
    session.check_drivable(chosen, connection)
    viewers = run_command.viewers(outputs.view, outputs.connect)
    folder = output_folders.prepare(out, f"drive-{chosen.name}", OUTPUTS, overwrite)
    try:
        with console.writing(folder):
            _drive(chosen, connection, folder, outputs, viewers, quiet)
    finally:
        if not any(folder.iterdir()):  # nobody was there to be driven
            folder.rmdir()


@contextmanager
def _connected(
    connection: "ConnectionOptions", failure: str
) -> Iterator[tuple["FrameClock", console.Interrupts]]:
    """Listen to vision until the end of the block. A signal that ends it prints `failure`."""
    from omni_mj.live import session
    from omni_mj.live.sockets import MessageCounter
    from omni_mj.studies.study_runner import StoppedError

    with console.Interrupts() as interrupts:
        try:
            messages = MessageCounter(lambda text: click.echo(f"note: {text}", err=True))
            with session.open_vision(connection, messages, interrupts.check) as frame_clock:
                yield frame_clock, interrupts
        except StoppedError as stopped:
            interrupts.end(stopped.reason, failure)


def _drive(
    scenario: "Scenario",
    connection: "ConnectionOptions",
    folder: Path,
    outputs: options.Outputs,
    viewers: list[str],
    quiet: bool,
) -> None:
    from omni_mj.files import write_text
    from omni_mj.live import latency_fit, session

    def show(text: str) -> None:
        if not quiet:
            print(text, flush=True)

    with _connected(connection, "the robots had not begun") as (frame_clock, interrupts):
        show("\n".join(frame_clock.vision.describe()))
        with session.prepare_drive(scenario, connection, frame_clock) as live:
            clock = (
                "this computer" if frame_clock.leader is None else f"camera {frame_clock.leader}"
            )
            show(f"robots {', '.join(map(str, live.ids))} at 60 frames a second of {clock}")
            gc.collect()
            gc.freeze()  # a collection through everything imported would hold up robots
            result = run_command.recorded(
                live, folder, outputs.record, viewers, interrupts, quiet, "drive"
            )
    summary = latency_fit.summarize(live)
    write_text(folder / "link.json", json.dumps(summary, indent=2, allow_nan=False) + "\n")
    run_command.shown(result, folder, outputs.draw, quiet)
    show("\n".join([*latency_fit.describe(summary), *frame_clock.vision.describe()]))
    run_command.ended(result, folder, interrupts)
