"""`omni-mj serve`: a simulator of the league, which any team's software can drive, with our physics."""

import gc
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import click

from omni_control.errors import OmniError
from omni_mj.cli import complete, console, folders, options
from omni_mj.files import check_room

if TYPE_CHECKING:
    from omni_mj.live.serve.log import Tape
    from omni_mj.live.serve.pitch import Pitch
    from omni_mj.live.serve.server import Server
    from omni_mj.scenarios.scenario import Scenario

YELLOW = "scenario-yellow.toml"  # what robots the other team has, if they are others
OUTPUTS = ("trajectory.parquet", "recording.rrd", "scenario.toml", YELLOW, *folders.PROVENANCE)

PORT = click.IntRange(0, 65_535)
TABLE_B = 20e6  # of disk, that a recording leaves to the table, which goes on


@click.command("serve")
@click.option(
    "--scenario", "name", metavar="NAME|FILE.toml", shell_complete=complete.scenarios,
    help="Carpet, cameras, radio, faults and so on.",
)  # fmt: skip
@options.ROBOT
@click.option(
    "--yellow-robot", metavar="NAME|FILE.toml", shell_complete=complete.robots,
    help="Same, of the yellow team. [as --robot]",
)  # fmt: skip
@options.SETTINGS
@click.option("--seed", type=int, metavar="S", help="Of the random numbers. [0]")
@click.option("--blue", metavar="N|IDS", default="1", show_default=True, help="Robots: how many, or their numbers.")
@click.option("--yellow", metavar="N|IDS", default="0", show_default=True, help="Same.")
@click.option("--speed", type=float, default=1.0, show_default=True, help="Times as fast as real time; 0: paused.")
@click.option(
    "--lockstep",
    is_flag=False,
    flag_value="any",
    type=click.Choice(["any", "both"]),
    help="Time goes by commands: a camera's image for each packet to a team (any), or to both teams (both).",
)
@click.option("--control-port", type=PORT, default=10300, show_default=True, help="Of the simulator; 0: any.")
@click.option("--blue-port", type=PORT, default=10301, show_default=True, help="Of the blue robots.")
@click.option("--yellow-port", type=PORT, default=10302, show_default=True, help="Of the yellow robots.")
@click.option(
    "--vision", metavar="HOST:PORT", default="224.5.23.2:10020", show_default=True, help="Detections go there."
)
@click.option("--interface", metavar="ADDRESS", default="127.0.0.1", show_default=True, help="By which they go.")
@click.option("--for", "until_s", type=float, metavar="S", help="End after so much simulated time. [when interrupted]")
@click.option("--out", type=options.FOLDER, metavar="DIR", help="Record there. [nothing is recorded]")
@options.OVERWRITE
@click.option("--record/--no-record", default=True, help="With --out, write recording.rrd for the rerun viewer.")
@click.option("--view", is_flag=True, help="Watch in a rerun viewer of its own.")
@click.option("--connect", metavar="URL", help="Watch in a rerun viewer that is running.")
@options.QUIET
def command(
    name: str | None,
    robot: str | None,
    yellow_robot: str | None,
    overrides: tuple[str, ...],
    seed: int | None,
    blue: str,
    yellow: str,
    speed: float,
    lockstep: str | None,
    control_port: int,
    blue_port: int,
    yellow_port: int,
    vision: str,
    interface: str,
    until_s: float | None,
    out: Path | None,
    overwrite: bool,
    record: bool,
    view: bool,
    connect: str | None,
    quiet: bool,
) -> None:
    """Simulate robots for software that speaks the league's protocols."""
    from omni_mj.live.serve import line_up
    from omni_mj.live.serve.pitch import Pitch
    from omni_mj.live.serve.ports import Ports
    from omni_mj.live.serve.server import Server
    from omni_mj.live.sockets import address, check_local
    from omni_mj.live.wire.simulation import Team

    if not 0 <= speed <= 1000:
        raise OmniError(f"--speed must be a number from 0 to 1000, not {speed:g}")
    if until_s is not None and not until_s > 0:
        raise OmniError(f"--for must be more than 0 s, not {until_s:g}")
    target = address(vision, 10020)
    check_local(target, interface)
    head = {key: value for key, value in (("robot", robot), ("seed", seed)) if value is not None}
    ours = line_up.load(name, overrides, head)
    theirs = ours if yellow_robot is None else line_up.load(name, overrides, head | {"robot": yellow_robot})
    line_up.check_together(ours, theirs)
    teams = {"blue": ours, "yellow": theirs}
    wanted = line_up.numbers(blue, "--blue"), line_up.numbers(yellow, "--yellow")
    poses = line_up.poses(*wanted, ours if name is not None else None)

    def tell(text: str) -> None:
        if not quiet:
            click.echo(text, err=True)

    viewers = list[str]()
    if view or connect is not None:
        from omni_mj.show.recording import live

        viewers += [] if connect is None else [live.check(connect)]
        viewers += [live.open_viewer()] if view else []
    folder = None if out is None else folders.prepare(out, ours.name, OUTPUTS, overwrite)
    console.quiet_mujoco()
    pitch = Pitch({Team.BLUE: ours, Team.YELLOW: theirs}, poses, lambda kind, text: server.notes.add(kind, text))
    ports = Ports(control_port, blue_port, yellow_port, target, interface)
    server = Server(pitch, ports, speed, lockstep or "", tell)
    try:
        if folder is None:
            _execute(server, until_s, quiet, None, teams, record, viewers)
        else:
            with console.writing(folder):
                _execute(server, until_s, quiet, folder, teams, record, viewers)
    finally:
        server.close()


def _execute(
    server: "Server",
    until_s: float | None,
    quiet: bool,
    folder: Path | None,
    teams: Mapping[str, "Scenario"],
    record: bool,
    viewers: Sequence[str],
) -> None:
    """Serve until it ends; what is recorded is in `folder`, whatever ends it."""
    from omni_mj.cli.interrupts import Interrupts
    from omni_mj.live.serve import report
    from omni_mj.studies.outcome import StoppedError

    stopped = None
    with Interrupts() as interrupts, _taped(server.pitch, folder, teams, record, viewers) as tape:
        if tape is not None:
            server.after_frame = tape.add
        if not quiet:
            click.echo(report.begins(server))
        gc.collect()
        gc.freeze()  # a collection through all that was imported would hold up several frames
        try:
            server.run(interrupts.check, float("inf") if until_s is None else until_s)
        except StoppedError as error:
            stopped = error.reason
    if not quiet:
        click.echo(report.ends(server))
    left = "" if folder is None else f"; what was recorded until then is in {folder}"
    interrupts.end(stopped, f"{server.pitch.time_s:.1f} s were simulated{left}")


@contextmanager
def _taped(
    pitch: "Pitch", folder: Path | None, teams: Mapping[str, "Scenario"], record: bool, viewers: Sequence[str]
) -> "Iterator[Tape | None]":
    """What records, if anything shall."""
    if folder is None and not viewers:
        yield None
        return
    from omni_mj.live.serve.log import Block, Parquet, Tape

    table, shown, chosen, theirs = None, [], teams["blue"], teams["yellow"]
    robots = {team: each.settings for team, each in teams.items()}
    if folder is not None:
        from omni_mj.measure.result import write
        from omni_mj.provenance import record as provenance

        given = {} if theirs == chosen else {"yellow": theirs.to_toml()}
        # First of all, since by it --overwrite knows the folder for ours.
        provenance.save(folder, "serve", console.command_line(), [chosen], given=given)
        write(folder / "scenario.toml", chosen.to_toml())
        if theirs != chosen:
            write(folder / YELLOW, theirs.to_toml())
        table = Parquet(folder / "trajectory.parquet")
    if viewers or (folder is not None and record):
        from omni_mj.show.recording.served import ServedRecording, to_file, to_viewer
        from omni_mj.show.recording.viewer import answers

        for url in (url for url in viewers if not answers(url)):
            click.echo(f"warning: no viewer at {url}; the run goes on without it", err=True)
        title = f"serve {chosen.name}"
        shown = [ServedRecording(to_viewer(url), robots, title) for url in viewers if answers(url)]
        if folder is not None and record:
            room = partial(check_room, folder, TABLE_B)
            shown.append(ServedRecording(to_file(folder / "recording.rrd"), robots, title, room))

    def keep(block: Block) -> None:
        if table is not None:
            table(block)
        for each in shown:
            each.send(block.first, block.names, block.log, block.ball)

    tape = Tape(pitch, [keep])
    try:
        yield tape
    finally:
        tape.flush()
        if table is not None:
            table.finish()
        for lost in filter(None, [each.close() for each in shown]):
            click.echo(f"warning: not all of the recording has arrived: {' '.join(lost.split())}", err=True)
