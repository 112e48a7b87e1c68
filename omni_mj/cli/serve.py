"""`omni-mj serve`: a simulator of the league, which any team's software can drive, with our physics."""

import gc
import math
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import click

from omni_mj.cli import console, folders, options, run

if TYPE_CHECKING:
    from omni_mj.live.serve.server import Server
    from omni_mj.scenarios.scenario import Scenario

YELLOW = "scenario-yellow.toml"  # what robots the other team has, if they are others
OUTPUTS = ("trajectory.parquet", "recording.rrd", "scenario.toml", YELLOW, *folders.PROVENANCE)

PORT = click.IntRange(0, 65_535)
DURATION = click.FloatRange(min=0, min_open=True)


@click.command("serve", context_settings={"show_default": True})
@click.option(
    "--scenario", "name", metavar="NAME|FILE.toml", shell_complete=options.complete("scenarios"),
    help="Carpet, cameras, radio, faults and so on.",
)  # fmt: skip
@options.ROBOT
@click.option(
    "--yellow-robot", metavar="NAME|FILE.toml", shell_complete=options.complete("robots"),
    help="Same, of the yellow team. [as --robot]",
)  # fmt: skip
@options.SETTINGS
@click.option("--seed", type=int, metavar="S", help="Of the random numbers. [0]")
@click.option("--blue", metavar="N|IDS", default="1", help="Robots: how many, or their numbers.")
@click.option("--yellow", metavar="N|IDS", default="0", help="Same.")
@click.option("--speed", type=click.FloatRange(0, 1000), default=1.0, help="Times as fast as real time; 0: paused.")
@click.option(
    "--lockstep",
    is_flag=False,
    flag_value="any",
    type=click.Choice(["any", "both"]),
    help="Time goes by commands: a camera's image for each packet to a team (any), or to both teams (both).",
)
@click.option("--control-port", type=PORT, default=10300, help="Of the simulator; 0: any.")
@click.option("--blue-port", type=PORT, default=10301, help="Of the blue robots.")
@click.option("--yellow-port", type=PORT, default=10302, help="Of the yellow robots.")
@click.option("--vision", metavar="HOST:PORT", default="224.5.23.2:10020", help="Detections go there.")
@click.option("--interface", metavar="ADDRESS", default="127.0.0.1", help="By which they go.")
@click.option("--for", "until_s", type=DURATION, default=math.inf, help="End after so much simulated time, s.")
@click.option("--out", type=options.FOLDER, metavar="DIR", help="Record there. [nothing is recorded]")
@options.OVERWRITE
@options.RECORD
@options.VIEW
@options.CONNECT
@options.QUIET
def command(**values: Any) -> None:
    """Simulate robots for software that speaks the league's protocols."""
    from omni_mj.cli.console import Interrupts
    from omni_mj.live.notes import Notes
    from omni_mj.live.serve import line_up
    from omni_mj.live.serve.pitch import Pitch
    from omni_mj.live.serve.server import Server
    from omni_mj.live.sockets import address
    from omni_mj.live.wire import VISION_PORT
    from omni_mj.live.wire.simulation_pb2 import Team
    from omni_mj.studies.outcome import StoppedError

    chosen = SimpleNamespace(**values)
    target = address(chosen.vision, VISION_PORT, chosen.interface)
    head = {name: values[name] for name in ("robot", "seed") if values[name] is not None}
    ours = line_up.load(chosen.name, chosen.overrides, head)
    theirs = line_up.load(chosen.name, chosen.overrides, head | {"robot": chosen.yellow_robot or ours.robot})
    line_up.check_together(ours, theirs)
    numbers = line_up.numbers(chosen.blue, "--blue"), line_up.numbers(chosen.yellow, "--yellow")
    poses = line_up.poses(*numbers, None if chosen.name is None else ours)
    targets: list[str | Path] = [*run.viewers(chosen.view, chosen.connect)]
    out, quiet = chosen.out, chosen.quiet
    folder = None if out is None else folders.prepare(out, ours.name, OUTPUTS, chosen.overwrite)
    console.quiet_mujoco()
    notes = Notes(lambda text: None if quiet else click.echo(text, err=True))
    pitch = Pitch({Team.BLUE: ours, Team.YELLOW: theirs}, poses, notes)
    ports = chosen.control_port, chosen.blue_port, chosen.yellow_port
    server = Server(pitch, ports, target, chosen.interface, chosen.speed, chosen.lockstep or "")
    with ExitStack() as stack:
        stack.callback(server.close)
        interrupts = stack.enter_context(Interrupts())
        if folder is not None:
            stack.enter_context(console.writing(folder))
            targets += [folder / "recording.rrd"] * chosen.record
        _record(stack, server, folder, {"blue": ours, "yellow": theirs}, targets)
        if not quiet:
            click.echo(_introduction(server))
        gc.collect()
        gc.freeze()  # a collection through everything imported would hold up several frames
        reason = None
        try:
            server.run(interrupts.check, chosen.until_s)
        except StoppedError as error:
            reason = error.reason
    if not quiet:
        click.echo(_summary(server))
    left = "" if folder is None else f"; what was recorded until then is in {folder}"
    interrupts.end(reason, f"{pitch.time_s:.1f} s were simulated{left}")


def _record(
    stack: ExitStack,
    server: "Server",
    folder: Path | None,
    teams: "Mapping[str, Scenario]",
    targets: Sequence[str | Path],
) -> None:
    """Record what is served in `folder`, and show it in `targets` for rerun, until the end of `stack`."""
    from omni_mj.files import write
    from omni_mj.live.serve.log import Block, TableWriter, Tape
    from omni_mj.provenance import record as provenance

    sinks, blue, yellow = list[Callable[[Block], None]](), teams["blue"], teams["yellow"]
    if folder is not None:
        provenance.save(folder, "serve", console.command_line(), [blue])
        write(folder / "scenario.toml", blue.to_toml())
        if yellow != blue:
            write(folder / YELLOW, yellow.to_toml())
        table = TableWriter(folder / "trajectory.parquet")
        stack.callback(table.finish)
        sinks.append(table)
    for target in targets:
        from omni_mj.show.recording.served import ServedRecording

        settings = {team: scenario.settings for team, scenario in teams.items()}
        recording = ServedRecording(target, settings, f"serve {blue.name}")
        stack.callback(recording.close)
        sinks.append(recording.send)
    if sinks:
        tape = Tape(server.pitch, sinks)
        server.after_frame = tape.add
        stack.callback(tape.flush)


def _introduction(server: "Server") -> str:
    """Return who is served where, in a line each."""
    from omni_mj.live.serve.pitch import label

    pitch, (control, blue, yellow) = server.pitch, server.ports
    settings, speed = pitch.rows[0].settings, server.pace.speed
    timeout_s = settings.firmware.timeout_s
    pace = f"{speed:g} times as fast as real time" if speed else "paused"
    if server.lockstep:
        teams = "either team" if server.lockstep == "any" else "both teams"
        pace = f"an image for each packet to {teams}, and steps by TCP (lockstep)"
    stop = f"robots stop {timeout_s:g} s after" if timeout_s else "robots never forget"
    robots = ", ".join(dict.fromkeys(row.robot for row in pitch.rows))
    return f"""serving {", ".join(map(label, pitch.names))}: {robots}
  ports      simulator {control}, blue {blue}, yellow {yellow}; vision to {server.publisher.to}
  cameras    {settings.vision.cameras} of {settings.vision.rate_hz:g} Hz, {pace}
  dead time  {settings.radio.delay_frames} frames of 1/60 s (radio.delay_frames); {stop} the last command \
(firmware.timeout_s)"""


def _summary(server: "Server") -> str:
    """Return what came and went, in a line each."""
    import numpy as np

    lines = [f"{server.pitch.time_s:.1f} s simulated"]
    lines += [f"  {count:8d}  {kind}" for kind, count in sorted((server.counts + server.notes.counts).items())]
    if server.pace.lost_s:
        lines.append(f"  {server.pace.lost_s:8.1f}  s behind, in which this computer was too slow")
    if server.publisher.lateness and not server.lockstep:
        late_ms = 1e3 * np.quantile(server.publisher.lateness, [0.05, 0.5, 0.95, 0.99, 1])
        shares = "{:.2f} (5%), {:.2f} (50%), {:.2f} (95%), {:.2f} (99%), {:.2f} ms (most)".format(*late_ms)
        lines.append(f"  detections left {shares} after they were due")
    return "\n".join(lines)
