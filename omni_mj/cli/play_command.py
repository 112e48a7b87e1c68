"""`omni-mj play`: robots in the browser, with sliders, up to three controllers side by side."""

import threading
import webbrowser
from collections.abc import Mapping
from contextlib import closing
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from omni_control.errors import OmniError
from omni_control.install_hints import describe_installation
from omni_mj.cli import options
from omni_mj.cli.interrupts import Interrupts

if TYPE_CHECKING:
    from omni_mj.config.scenario import Scenario
    from omni_mj.play.play_server import PlayServer


@click.command("play")
@click.option(
    "--scenario",
    "name",
    default="rect",
    metavar="NAME|FILE.toml",
    help="Scenario to play. Default: rect.",
)
@options.CONTROLLER
@options.scenario_options
@options.SEED
@options.ALLOW_CODE
@click.option(
    "--port",
    type=click.IntRange(0, 65_535),
    metavar="PORT",
    help="Port of the page; 0 for any. Default: 8642, or any other if it is in use.",
)
@click.option("--open/--no-open", "open_page", default=True, help="Open the page in the browser.")
@click.option(
    "--record",
    type=options.FOLDER,
    metavar="FILE.rrd",
    help="Recording for rerun. A restart begins another: FILE-2.rrd.",
)
def play_command(
    scenario_options: options.ScenarioOptions,
    name: str,
    port: int | None,
    open_page: bool,
    record: Path | None,
) -> None:
    """Play with robots in the browser: sliders, disturbances, targets by a click.

    The program ends 5 s after the last page is closed.
    """
    reason = None
    with Interrupts() as interrupts:  # before imports that take a second
        from omni_mj.studies.run_scenario import StoppedError

        try:
            with closing(_start_server(scenario_options, name, port, record, interrupts)) as server:
                if open_page:
                    webbrowser.open(server.url)
                server.run()
        except StoppedError as error:
            reason = str(error)
        if sum(not thread.daemon for thread in threading.enumerate()) > 1:
            interrupts.exit_at_once("the session has ended, but not a thread of a controller")
    interrupts.exit_if_stopped(reason, "the session has ended")


def _start_server(
    scenario_options: options.ScenarioOptions,
    name: str,
    port: int | None,
    record: Path | None,
    interrupts: Interrupts,
) -> "PlayServer":
    """Return the server of the page, and print its address."""
    try:
        from omni_mj.play.play_server import DEFAULT_PORT, PlayServer
    except ModuleNotFoundError as error:
        if error.name not in ("viser", "trimesh"):
            raise
        raise OmniError(
            f"omni-mj play needs the package {error.name}, which is not installed; "
            f"install it with {describe_installation('play')}"
        ) from None

    if record and record.suffix != ".rrd":
        raise OmniError(f"--record {record} must be a file whose name ends in .rrd")
    try:
        if record:
            record.open("ab").close()
    except OSError as error:
        raise OmniError(f"--record {record} cannot be written: {error.strerror}") from error

    def load_scenario(other_name: str | None, top_level: Mapping[str, Any]) -> "Scenario":
        changed = options.ScenarioOptions(**vars(scenario_options) | dict(top_level))
        return changed.load_scenario(other_name or name)

    server = PlayServer(load_scenario, interrupts.check, interrupts.exit_at_once, port, record)
    note = ""
    if port is None and not server.url.endswith(f":{DEFAULT_PORT}/"):
        note = f" (port {DEFAULT_PORT}, which links in the lessons need, is in use)"
    click.echo(f"playing at {server.url}{note}")
    return server
