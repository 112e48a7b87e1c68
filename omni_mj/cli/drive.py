"""`omni-mj drive`: drive robots outside of this program, a simulator's or real ones, and measure how they answer."""

import gc
import json
import time
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from omni_control.errors import OmniError
from omni_mj.cli import complete, console, folders, options
from omni_mj.cli import run as run_command

if TYPE_CHECKING:
    from omni_mj.live.drive import Live
    from omni_mj.live.session import Options
    from omni_mj.scenarios.scenario import Scenario

CONTROLLER = "adaptive-comp-flc"
OUTPUTS = (*run_command.OUTPUTS, "link.json")


@click.command("drive")
@options.SCENARIO
@click.option("--controller", metavar="NAME|FILE.py:Class", shell_complete=complete.controllers, help=f"[{CONTROLLER}]")
@options.ROBOT
@click.option("--team", "colour", type=click.Choice(["blue", "yellow"]), default="blue", help="[blue]")
@click.option("--id", "ids", type=int, multiple=True, help="A robot's number; may be repeated. [the lowest seen]")
@click.option("--vision", metavar="ADDRESS[:PORT]", default="224.5.23.2:10020", help="[224.5.23.2:10020]")
@click.option("--commands", metavar="HOST[:PORT]", help="[127.0.0.1:10301 for blue, 10302 for yellow]")
@click.option("--interface", metavar="ADDRESS", default="127.0.0.1", help="Own address on their net. [127.0.0.1]")
@click.option("--rate", type=click.Choice(["auto", "60", "vision"]), default="auto", help="What gives ticks. [auto]")
@click.option("--velocity", type=click.Choice(["local", "global"]), default="local", help="As told to robots. [local]")
@click.option("--radio", metavar="FILE.py:Class", help="A radio of your own. [ssl-simulation-protocol]")
@click.option("--here", is_flag=True, help="Start where the robots are, all that are seen if none is named.")
@click.option("--wait", type=float, default=10.0, metavar="S", help="How long vision is waited for. [10]")
@click.option("--duration", type=float, metavar="S", help="End after so many seconds. [the whole route]")
@click.option("--pulse/--no-pulse", "ask", default=True, help="Measure dead time first: robots turn to and fro.")
@click.option("--dry-run", is_flag=True, help="Only listen: rates, cameras, robots, noise.")
@options.SETTINGS
@click.option("--out", type=options.FOLDER, metavar="DIR", help="[runs/drive-<scenario>-<UTC time>]")
@options.OVERWRITE
@options.RECORD
@options.VIEW
@options.CONNECT
@options.FIGURES
@options.QUIET
def command(
    name: str | None,
    controller: str | None,
    robot: str | None,
    overrides: tuple[str, ...],
    out: Path | None,
    overwrite: bool,
    record: bool,
    view: bool,
    connect: str | None,
    draw: bool,
    dry_run: bool,
    quiet: bool,
    **given: Any,
) -> None:
    """Drive robots that SSL-Vision sees, and tell how late and how well they answer."""
    from omni_mj.live import session
    from omni_mj.scenarios import scenario
    from omni_mj.scenarios.library import builtin

    chosen = _options(overrides=overrides, **given)
    if dry_run:
        _listen(chosen, quiet)
        return
    if name is None:
        raise OmniError(f"--scenario is missing; choose from {', '.join(builtin())}, or a .toml file")
    head = {"controllers": (controller or CONTROLLER,), "plant": "live", "seeds": 1}
    what = untold(scenario.load(name, overrides, head | ({"robot": robot} if robot else {})), robot is None)
    session.check(what, chosen)
    viewers = run_command.viewers(view, connect)
    folder = folders.prepare(out, f"drive-{what.name}", OUTPUTS, overwrite)
    try:
        with console.writing(folder):
            _drive(what, chosen, folder, record, draw, quiet, viewers)
    finally:
        if not any(folder.iterdir()):  # nobody was there to be driven
            folder.rmdir()


def untold(what: "Scenario", unnamed: bool) -> "Scenario":
    """A scenario whose robot nobody named: who is out there need not be the default one, whose alpha is not told."""
    from omni_mj.scenarios.robots import DEFAULT
    from omni_mj.scenarios.settings import Settings

    names = "alpha_forward", "alpha_sideways"
    usual = all(getattr(what.settings.control, name) == getattr(Settings().control, name) for name in names)
    if not (unnamed and what.robot == DEFAULT and usual):
        return what
    return what.replace(settings=what.settings.replace(control=dict.fromkeys(names, 0.0)))


def _options(
    vision: str,
    commands: str | None,
    interface: str,
    colour: Any,
    ids: tuple[int, ...],
    rate: Any,
    velocity: str,
    radio: str | None,
    here: bool,
    wait: float,
    duration: float | None,
    ask: bool,
    overrides: tuple[str, ...],
) -> "Options":
    """What is said of the connection, checked.

    Raises:
        OmniError: something of it cannot be; a line for each.
    """
    from omni_mj.live.radio import PORTS
    from omni_mj.live.session import DEAD_TIME, MEASURED, Options
    from omni_mj.live.sockets import address, check_local
    from omni_mj.live.wire.vision import SIMULATED_VISION_PORT

    target = None if commands is None else address(commands, PORTS[colour])
    if target is not None and radio is None:
        check_local(target, interface)
    if duration is not None and not 0 < duration < 1e5:
        raise OmniError(f"--duration must be a positive number of seconds, not {duration:g}")
    if not 0 <= wait < 1e5:
        raise OmniError(f"--wait must be a number of seconds, not {wait:g}")
    if any(not 0 <= number < 256 for number in ids):
        raise OmniError(f"--id must be from 0 to 255, not {', '.join(map(str, ids))}")
    said = {override.partition("=")[0].strip() for override in overrides} | (set() if ask else {DEAD_TIME})
    return Options(
        address(vision, SIMULATED_VISION_PORT), target, interface, colour, tuple(ids), rate, velocity == "global",
        radio, here, wait_s=wait, duration_s=duration, measured=frozenset(MEASURED) - said,
    )  # fmt: skip


def _listen(chosen: "Options", quiet: bool) -> None:
    """Print what vision sends, until somebody ends it."""
    from omni_mj.cli.interrupts import Interrupts
    from omni_mj.live import listen, session
    from omni_mj.live.notes import Notes
    from omni_mj.studies.outcome import StoppedError

    notes = Notes(_warn)
    with Interrupts() as interrupts:
        try:
            with session.listening(chosen, notes, interrupts.check) as link:
                until = time.monotonic() + (chosen.duration_s or float("inf"))
                with suppress(StoppedError):
                    while time.monotonic() < until:
                        link.listen(min(1.0, max(until - time.monotonic(), 0.0)))
                        if not quiet:
                            print(f"{len(link.vision.cameras)} cameras, {len(link.heard.robots())} robots", flush=True)
                print("\n".join([*listen.cameras(link.vision.cameras), *link.heard.robots(), *_counts(notes)]))
        except StoppedError as stopped:
            interrupts.end(stopped.reason, "vision had not been listened to for long enough to say anything")


def _drive(
    what: Any, chosen: "Options", folder: Path, record: bool, draw: bool, quiet: bool, viewers: list[str]
) -> None:
    from omni_mj.cli.interrupts import Interrupts
    from omni_mj.live import listen, report, session
    from omni_mj.live.notes import Notes
    from omni_mj.measure.result import write
    from omni_mj.studies.outcome import StoppedError

    notes = Notes(_warn)
    with Interrupts() as interrupts:
        try:
            with session.listening(chosen, notes, interrupts.check) as link:
                if not quiet:
                    print("\n".join(listen.cameras(link.vision.cameras)), flush=True)
                with session.ready(what, chosen, link, notes) as live:
                    if not quiet:
                        _begin(live)
                    watch = None if quiet else _watch(live)
                    gc.collect()
                    gc.freeze()  # what there is needs not be looked through while robots wait
                    outcome = run_command.recorded(live, folder, record, viewers, interrupts, quiet, "drive", watch)
        except StoppedError as stopped:  # before there was anything to record
            interrupts.end(stopped.reason, "the robots had not begun")
            raise AssertionError from stopped
    summary = report.summary(live)
    write(folder / "link.json", json.dumps(summary, indent=2, allow_nan=False) + "\n")
    run_command.shown(outcome, folder, draw, quiet)
    if not quiet:
        print("\n".join([*report.told(summary), *listen.cameras(live.link.vision.cameras), *_counts(notes)]))
    run_command.ended(outcome, folder, interrupts)


def _begin(live: "Live") -> None:
    pace = f"camera {live.link.leader}" if live.link.with_frames else "the clock of this computer"
    robots = ", ".join(map(str, live.ids))
    print(f"robots {robots} at 60 frames a second of {pace}", flush=True)


def _watch(live: "Live") -> Any:
    """What to call after each frame: it prints once a second what was identified."""
    from omni_mj.live import report
    from omni_mj.scenarios.settings import FRAME_RATE_HZ

    def after(frame: int) -> None:
        if (frame + 1) % FRAME_RATE_HZ == 0:
            for line in report.found(live) or [f"frame {frame + 1}"]:
                print(f"{(frame + 1) // FRAME_RATE_HZ:4d} s  {line}", flush=True)

    return after


def _warn(text: str) -> None:
    click.echo(f"note: {text}", err=True)


def _counts(notes: Any) -> list[str]:
    """How often what went wrong did."""
    counted = ", ".join(f"{kind}: {count}" for kind, count in notes.counts.items())
    return [f"noted: {counted}"] if counted else []
