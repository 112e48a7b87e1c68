"""`omni-mj drive`: drive external robots, real or of another simulator, and measure latency."""

import gc
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from omni_mj.cli import console, options, output_folders, run_command
from omni_mj.cli.interrupts import Interrupts

if TYPE_CHECKING:
    from omni_mj.config.scenario import Scenario
    from omni_mj.live.drive_setup import ConnectionOptions
    from omni_mj.live.frame_clock import FrameClock

DEFAULT_CONTROLLER = "adaptive-comp-flc"
# Settings in the section control for the assumed alpha. Zero means unknown.
ALPHA_FIELDS = "assumed_alpha_forward", "assumed_alpha_sideways"
OUTPUTS = (*run_command.OUTPUTS, "link.json")


@click.command("drive")
@options.SCENARIO
@click.option(
    "--controller",
    metavar="NAME|FILE.py:Class",
    default=DEFAULT_CONTROLLER,
    help=f"Controller to run. Default: {DEFAULT_CONTROLLER}.",
)
@options.ROBOT
@click.option(
    "--team",
    "color",
    type=click.Choice(["blue", "yellow"]),
    default="blue",
    help="Color of the robots. Default: blue.",
)
@click.option(
    "--id",
    "ids",
    type=click.IntRange(0, 255),
    multiple=True,
    metavar="ID",
    help="Number of a robot to drive; may be repeated. Default: the lowest that is detected.",
)
@click.option(
    "--vision",
    metavar="ADDRESS[:PORT]",
    default="224.5.23.2:10020",
    help="Multicast address of SSL-Vision. Default: 224.5.23.2:10020.",
)
@click.option(
    "--commands",
    metavar="HOST[:PORT]",
    help="Where commands are sent. Default: 127.0.0.1:10301 for blue, :10302 for yellow.",
)
@options.INTERFACE
@click.option(
    "--clock",
    "pace",
    type=click.Choice(["auto", "60", "vision"]),
    default="auto",
    help="Clock of the control frames: this computer's at 60 Hz, or the images of a camera. "
    "Default: auto, a camera if one sends 60 Hz.",
)
@click.option(
    "--radio",
    metavar="FILE.py:Class",
    help="Radio of your own. Default: the ssl-simulation-protocol.",
)
@click.option(
    "--wait",
    "wait_s",
    type=click.FloatRange(0, 1e5),
    default=10.0,
    metavar="S",
    help="Longest time to wait for vision, s. Default: 10.",
)
@click.option(
    "--duration",
    "duration_s",
    type=click.FloatRange(min=0, max=1e5, min_open=True),
    metavar="S",
    help="Time after which the drive ends, s. Default: the end of the reference.",
)
@click.option(
    "--pulse/--no-pulse",
    default=True,
    help="Measure the dead time first, by turning the robots back and forth. Default: --pulse.",
)
@click.option(
    "--dry-run",
    is_flag=True,
    help="Listen only, and print the cameras, their rates and noise, and the robots.",
)
@options.SETTINGS
@options.out_option("drive-<scenario>")
@options.OVERWRITE
@options.viewer_options
@options.FIGURES
@options.QUIET
def drive_command(
    name: str | None,
    controller: str,
    robot: str | None,
    overrides: tuple[str, ...],
    output_options: options.OutputOptions,
    quiet: bool,
    **values: Any,
) -> None:
    """Drive robots that SSL-Vision detects, and measure their latency and alpha.

    The controller assumes the numbers of --robot. Without it, it assumes those of tigers-v2016,
    except alpha, which is then unknown.
    """
    from omni_mj.live import drive_setup
    from omni_mj.studies.run_scenario import StoppedError

    # The other values are fields of ConnectionOptions.
    out, overwrite, dry_run = map(values.pop, ("out", "overwrite", "dry_run"))
    connection = drive_setup.ConnectionOptions(overrides=overrides, **values)
    if dry_run:
        with _connect(connection, "no measurements yet") as (frame_clock, _):
            with suppress(StoppedError):
                frame_clock.listen_for(connection.duration_s or float("inf"))
            print("\n".join(frame_clock.vision.describe()))
        return
    scenario = _load_scenario(run_command.require_scenario(name), controller, robot, connection)
    drive_setup.check_drivable(scenario, connection)
    rerun_targets = run_command.open_viewers(output_options)
    folder = output_folders.prepare_folder(out, f"drive-{scenario.name}", OUTPUTS, overwrite)
    if output_options.record:
        rerun_targets.append(folder / "recording.rrd")
    try:
        with console.report_write_errors(folder):
            _drive(scenario, connection, folder, rerun_targets, output_options, quiet)
    finally:
        if not any(folder.iterdir()):  # no robot was found
            folder.rmdir()


def _load_scenario(
    name: str, controller: str, robot: str | None, connection: "ConnectionOptions"
) -> "Scenario":
    """Return the scenario to drive. If neither it nor the user names a robot, alpha is unknown."""
    from omni_mj.config import scenario
    from omni_mj.config.robot_files import DEFAULT_ROBOT

    head: dict[str, Any] = {"controllers": (controller,), "plant": "live", "seeds": 1}
    if robot:
        head["robot"] = robot
    loaded = scenario.load_with_overrides(name, connection.overrides, head)
    if robot is not None or loaded.robot != DEFAULT_ROBOT:
        return loaded
    unknown = {
        field: 0.0 for field in ALPHA_FIELDS if not connection.is_overridden(f"control.{field}")
    }
    return loaded.replace(settings=loaded.settings.replace(control=unknown))


@contextmanager
def _connect(
    connection: "ConnectionOptions", stop_message: str
) -> Iterator[tuple["FrameClock", Interrupts]]:
    """Receive vision and check for signals until the end of the block.

    Args:
        connection: Addresses and times.
        stop_message: Message to print if a signal stops the block.

    Yields:
        The clock of the control frames, and the signals.
    """
    from omni_mj.live import drive_setup
    from omni_mj.live.sockets import MessageCounter
    from omni_mj.studies.run_scenario import StoppedError

    with Interrupts() as interrupts:
        try:
            messages = MessageCounter(lambda text: click.echo(f"note: {text}", err=True))
            with drive_setup.open_vision(connection, messages, interrupts.check) as frame_clock:
                yield frame_clock, interrupts
        except StoppedError as stopped:
            interrupts.exit_if_stopped(str(stopped), stop_message)


def _drive(
    scenario: "Scenario",
    connection: "ConnectionOptions",
    folder: Path,
    rerun_targets: list[Path | str],
    output_options: options.OutputOptions,
    quiet: bool,
) -> None:
    """Drive the robots, save the results, and print them with the measured latency."""
    from omni_mj.io.atomic_files import write_json
    from omni_mj.live import drive_setup, latency_fit

    def show(text: str) -> None:
        if not quiet:
            print(text, flush=True)

    with _connect(connection, "the robots had not started") as (frame_clock, interrupts):
        show("\n".join(frame_clock.vision.describe()))
        with drive_setup.prepare_drive(scenario, connection, frame_clock) as live:
            clock = (
                "this computer's clock"
                if frame_clock.leader is None
                else f"camera {frame_clock.leader}"
            )
            show(f"robots {', '.join(map(str, live.ids))}; frames at 60 Hz from {clock}")
            gc.collect()
            gc.freeze()  # later collections skip all present objects, and delay no frame
            result = run_command.run_and_save(
                live, folder, rerun_targets, interrupts, quiet, "drive"
            )
    summary = latency_fit.summarize(live)
    write_json(folder / "link.json", summary)
    run_command.report_result(result, folder, output_options, quiet)
    show("\n".join(latency_fit.describe(summary)))
    run_command.exit_unless_complete(result, folder, interrupts)
