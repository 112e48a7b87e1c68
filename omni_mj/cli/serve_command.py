"""`omni-mj serve`: a simulator with the league's protocols, for any team's software."""

import gc
import math
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from omni_mj.cli import console, options, output_folders, run_command
from omni_mj.cli.interrupts import Interrupts

if TYPE_CHECKING:
    from omni_mj.live.serve.server import Server

OUTPUTS = ("trajectory.parquet", "recording.rrd", "scenario.toml", *output_folders.PROVENANCE)
PORT = click.IntRange(0, 65_535)


@click.command("serve")
@click.option(
    "--scenario",
    "name",
    metavar="NAME|FILE.toml",
    help="Scenario with the settings of carpet, cameras, radio and faults. Default: no dead time, "
    "and robots that stop 0.1 s after the last command.",
)
@options.scenario_options
@options.SEED
@click.option(
    "--blue",
    metavar="N|IDS",
    default="1",
    help="Number of blue robots, or their numbers, such as 0,3,7. Default: 1.",
)
@click.option(
    "--yellow",
    metavar="N|IDS",
    default="0",
    help="Number of yellow robots, or their numbers. Default: 0.",
)
@click.option(
    "--speed",
    type=click.FloatRange(0, 1000),
    default=1.0,
    metavar="X",
    help="Simulated time over real time; 0 pauses. Default: 1.",
)
@click.option(
    "--lockstep",
    is_flag=True,
    help="Advance by one camera image per command packet, in place of real time.",
)
@click.option(
    "--control-port",
    type=PORT,
    default=10300,
    metavar="PORT",
    help="Port of the simulation control; 0 for any. Default: 10300.",
)
@click.option(
    "--blue-port",
    type=PORT,
    default=10301,
    metavar="PORT",
    help="Port for commands to the blue robots. Default: 10301.",
)
@click.option(
    "--yellow-port",
    type=PORT,
    default=10302,
    metavar="PORT",
    help="Port for commands to the yellow robots. Default: 10302.",
)
@click.option(
    "--vision",
    metavar="HOST:PORT",
    default="224.5.23.2:10020",
    help="Where detections are sent. Default: 224.5.23.2:10020.",
)
@options.INTERFACE
@click.option(
    "--duration",
    "duration_s",
    type=click.FloatRange(min=0, min_open=True),
    default=math.inf,
    metavar="S",
    help="Simulated time after which it ends, s. Default: it does not end.",
)
@click.option(
    "--out",
    type=options.FOLDER,
    metavar="DIR",
    help="Folder of the recorded trajectory. Default: nothing is recorded.",
)
@options.OVERWRITE
@options.viewer_options
@options.QUIET
def serve_command(
    scenario_options: options.ScenarioOptions,
    name: str | None,
    out: Path | None,
    overwrite: bool,
    output_options: options.OutputOptions,
    quiet: bool,
    **values: Any,
) -> None:
    """Simulate robots for software that uses the league's protocols."""
    from omni_mj.io.atomic_files import write_text
    from omni_mj.live.serve import initial_setup
    from omni_mj.live.serve.served_world import ServedWorld
    from omni_mj.live.serve.server import Server
    from omni_mj.live.sockets import MessageCounter, parse_address
    from omni_mj.live.wire import VISION_PORT
    from omni_mj.results import provenance
    from omni_mj.studies.run_scenario import StoppedError, quiet_mujoco

    vision = parse_address(values["vision"], VISION_PORT, values["interface"])
    scenario = initial_setup.load_served_scenario(
        name, scenario_options.setting_overrides, scenario_options.top_level
    )
    blue, yellow = (
        initial_setup.parse_robot_ids(values[team], f"--{team}") for team in ("blue", "yellow")
    )
    poses = initial_setup.starting_poses(blue, yellow, scenario)
    rerun_targets = run_command.open_viewers(output_options)
    folder = None
    if out is not None:
        folder = output_folders.prepare_folder(out, scenario.name, OUTPUTS, overwrite)
    quiet_mujoco()
    messages = MessageCounter(lambda text: None if quiet else click.echo(text, err=True))
    world = ServedWorld(scenario, poses, messages)
    ports = [values[f"{port}_port"] for port in ("control", "blue", "yellow")]
    server = Server(world, ports, vision, values["interface"], values["speed"], values["lockstep"])
    with ExitStack() as stack:
        stack.callback(server.close)
        interrupts = stack.enter_context(Interrupts())
        if folder is not None:
            stack.enter_context(console.report_write_errors(folder))
            # Written first, because --overwrite recognizes the folder of a run by it.
            provenance.save_provenance(folder, "serve", console.get_command_line(), [scenario], {})
            write_text(folder / "scenario.toml", scenario.to_toml())
            if output_options.record:
                rerun_targets.append(folder / "recording.rrd")
        _start_recording(stack, server, folder, rerun_targets)
        if not quiet:
            click.echo(_describe_server(server, initial_setup.measure_load(scenario, poses)))
        gc.collect()
        gc.freeze()  # later collections skip all present objects, and delay no frame
        reason = None
        try:
            server.run(interrupts.check, values["duration_s"])
        except StoppedError as error:
            reason = str(error)
    if not quiet:
        counts = [f"  {count:8d}  {kind}" for kind, count in sorted(server.messages.items())]
        click.echo("\n".join([f"{world.time_s:.1f} s simulated", *counts]))
    remark = "" if folder is None else f"; the frames so far are in {folder}"
    interrupts.exit_if_stopped(reason, f"{world.time_s:.1f} s were simulated{remark}")


def _start_recording(
    stack: ExitStack, server: "Server", folder: Path | None, rerun_targets: Sequence[str | Path]
) -> None:
    """Record the served world until the end of `stack`.

    Args:
        stack: Stack that closes the recordings.
        server: Server whose world is recorded.
        folder: Folder of trajectory.parquet, or None if it is not written.
        rerun_targets: Recording files and URLs of rerun viewers to which frames are sent.
    """
    from omni_mj.live.serve.recorder import Recorder, TrajectoryWriter

    if folder is None and not rerun_targets:
        return
    sinks: list[Any] = []
    for target in rerun_targets:
        from omni_mj.viz.recording import ServedRecording

        settings = server.world.rows[0].settings
        recording = stack.enter_context(ServedRecording(target, settings))
        sinks.append(recording.send)
    if folder is not None:
        writer = TrajectoryWriter(folder / "trajectory.parquet")
        stack.callback(writer.close)
        sinks.append(writer.add_block)
    recorder = Recorder(server.world, sinks)
    server.after_frame = recorder.add_frame
    stack.callback(recorder.end_block)


def _describe_server(server: "Server", load: float) -> str:
    """Return the robots, ports, cameras, dead time and load of a server, a line each.

    Args:
        server: The server.
        load: CPU time of a simulated second, s.
    """
    from omni_mj.live.serve.simulation_requests import robot_label

    world, (control, blue, yellow) = server.world, server.ports
    row = world.rows[0]
    vision, radio = row.settings.vision, row.settings.radio
    timeout_s = row.settings.firmware.timeout_s
    pace = "in lockstep with commands" if server.lockstep else f"at {server.speed:g} x real time"
    stop = f"robots stop {timeout_s:g} s after" if timeout_s else "robots never stop after"
    load *= 1.0 if server.lockstep else server.speed
    physics = f"wheels.model {row.settings.wheels.model}"
    if world.plant_name == "planar":
        physics = "without collisions"
    too_slow = "; simulated time will fall behind" if load > 1 and not server.lockstep else ""
    robot = row.settings.model.file or row.robot
    air = "" if radio.kind == "fixed" else f" and {radio.kind}"
    dead_time = f"{radio.delay_frames} frames of 1/60 s (radio.delay_frames){air}"
    return f"""serving {", ".join(map(robot_label, world.names))}: {robot}
  physics    {world.plant_name}, {physics}; about {load:.0%} of one core{too_slow}
  ports      simulator {control}, blue {blue}, yellow {yellow}; vision to {server.vision}
  cameras    {vision.cameras} of {vision.rate_hz:g} Hz, {pace}
  dead time  {dead_time}; {stop} the last command
             (firmware.timeout_s)"""
