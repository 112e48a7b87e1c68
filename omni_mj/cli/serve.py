"""`omni-mj serve`: a simulator with the league's protocols, for any team's software."""

import gc
import math
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from omni_mj.cli import console, options, output_folders, run

if TYPE_CHECKING:
    from omni_mj.live.serve.server import Server

OUTPUTS = ("trajectory.parquet", "recording.rrd", "scenario.toml", *output_folders.PROVENANCE)

PORT = click.IntRange(0, 65_535)
DURATION = click.FloatRange(min=0, min_open=True)


@click.command("serve", context_settings={"show_default": True})
@click.option(
    "--scenario", "name", metavar="NAME|FILE.toml",
    help="Carpet, cameras, radio, faults and so on.",
)  # fmt: skip
@options.ROBOT
@options.SETTINGS
@click.option("--seed", type=int, metavar="S", help="Of the random numbers. [0]")
@click.option("--blue", metavar="N|IDS", default="1", help="Robots: how many, or their numbers.")
@click.option("--yellow", metavar="N|IDS", default="0", help="Same.")
@click.option(
    "--speed",
    type=click.FloatRange(0, 1000),
    default=1.0,
    help="Times as fast as real time; 0: paused.",
)
@click.option(
    "--lockstep",
    is_flag=True,
    help="Time goes by commands: an image of a camera for each packet to a team.",
)
@click.option("--control-port", type=PORT, default=10300, help="Of the simulator; 0: any.")
@click.option("--blue-port", type=PORT, default=10301, help="Of the blue robots.")
@click.option("--yellow-port", type=PORT, default=10302, help="Of the yellow robots.")
@click.option(
    "--vision", metavar="HOST:PORT", default="224.5.23.2:10020", help="Detections go there."
)
@click.option("--interface", metavar="ADDRESS", default="127.0.0.1", help="By which they go.")
@click.option(
    "--for", "until_s", type=DURATION, default=math.inf, help="End after so much simulated time, s."
)
@click.option(
    "--out", type=options.FOLDER, metavar="DIR", help="Record there. [nothing is recorded]"
)
@options.OVERWRITE
@options.RECORD
@options.VIEW
@options.CONNECT
@options.QUIET
def command(
    name: str | None,
    overrides: tuple[str, ...],
    out: Path | None,
    overwrite: bool,
    quiet: bool,
    until_s: float,
    **values: Any,
) -> None:
    """Simulate robots for software that speaks the league's protocols."""
    from omni_mj.files import write_text
    from omni_mj.live.serve import initial_setup
    from omni_mj.live.serve.served_world import ServedWorld
    from omni_mj.live.serve.server import Server
    from omni_mj.live.sockets import MessageCounter, parse_address
    from omni_mj.live.wire import VISION_PORT
    from omni_mj.results import provenance as provenance
    from omni_mj.studies.study_runner import StoppedError

    target = parse_address(values["vision"], VISION_PORT, values["interface"])
    head = {option: values[option] for option in ("robot", "seed") if values[option] is not None}
    scenario = initial_setup.load_served_scenario(name, overrides, head)
    poses = initial_setup.starting_poses(
        *(initial_setup.parse_robot_ids(values[team], f"--{team}") for team in ("blue", "yellow"))
    )
    targets: list[str | Path] = [*run.viewers(values["view"], values["connect"])]
    folder = None if out is None else output_folders.prepare(out, scenario.name, OUTPUTS, overwrite)
    console.quiet_mujoco()
    world = ServedWorld(
        scenario, poses, MessageCounter(lambda text: None if quiet else click.echo(text, err=True))
    )
    ports = [values[f"{port}_port"] for port in ("control", "blue", "yellow")]
    server = Server(world, ports, target, values["interface"], values["speed"], values["lockstep"])
    with ExitStack() as stack:
        stack.callback(server.close)
        interrupts = stack.enter_context(console.Interrupts())
        if folder is not None:
            stack.enter_context(console.writing(folder))
            # First of all, since by it --overwrite knows the folder for ours.
            provenance.save_provenance(folder, "serve", console.command_line(), [scenario])
            write_text(folder / "scenario.toml", scenario.to_toml())
            if values["record"]:
                targets.append(folder / "recording.rrd")
        _record(stack, server, folder, targets)
        if not quiet:
            click.echo(_introduction(server))
        gc.collect()
        gc.freeze()  # a collection through everything imported would hold up several frames
        reason = None
        try:
            server.run(interrupts.check, until_s)
        except StoppedError as error:
            reason = error.reason
    if not quiet:
        counts = [f"  {count:8d}  {kind}" for kind, count in sorted(server.messages.items())]
        click.echo("\n".join([f"{world.time_s:.1f} s simulated", *counts]))
    left = "" if folder is None else f"; what was recorded until then is in {folder}"
    interrupts.end(reason, f"{world.time_s:.1f} s were simulated{left}")


def _record(
    stack: ExitStack, server: "Server", folder: Path | None, targets: Sequence[str | Path]
) -> None:
    """Record the served world in `folder` and in `targets` of rerun until the end of `stack`."""
    from omni_mj.live.serve.recorder import Recorder

    if folder is None and not targets:
        return
    sinks, row = [], server.world.rows[0]
    for target in targets:
        from omni_mj.viz.recording.served_recording import ServedRecording

        recording = stack.enter_context(ServedRecording(target, row.settings))
        sinks.append(recording.send)
    recorder = Recorder(server.world, folder and folder / "trajectory.parquet", sinks)
    server.after_frame = recorder.add
    stack.callback(recorder.close)


def _introduction(server: "Server") -> str:
    """Return who is served where, in a line each."""
    from omni_mj.live.serve.simulation_requests import robot_label

    world, (control, blue, yellow) = server.world, server.ports
    row = world.rows[0]
    settings, timeout_s = row.settings, row.settings.firmware.timeout_s
    pace = (
        "in lockstep with commands"
        if server.lockstep
        else f"{server.speed:g} times as fast as real time"
    )
    stop = f"robots stop {timeout_s:g} s after" if timeout_s else "robots never forget"
    return f"""serving {", ".join(map(robot_label, world.names))}: {row.robot}
  ports      simulator {control}, blue {blue}, yellow {yellow}; vision to {server.vision}
  cameras    {settings.vision.cameras} of {settings.vision.rate_hz:g} Hz, {pace}
  dead time  {settings.radio.delay_frames} frames of 1/60 s (radio.delay_frames); {stop} \
the last command (firmware.timeout_s)"""
