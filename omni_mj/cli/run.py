"""`python -m omni_mj.run`: run a scenario, show its result, leave its files."""

import shutil
import sys
import time
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import click

from omni_control.errors import OmniError
from omni_mj.cli import console, folders
from omni_mj.cli.interrupts import Interrupts, StoppedError
from omni_mj.measure import events, paper, summary
from omni_mj.plants import SimulationError
from omni_mj.scenarios import scenario
from omni_mj.scenarios.controllers import ControllerError
from omni_mj.scenarios.plants import PLANTS
from omni_mj.show import figures, listing, report
from omni_mj.show.recording import FileRecording, LiveRecording, Recording, live
from omni_mj.simulate.simulation import Simulation

OUTPUTS = ("summary.json", "trajectory.parquet", "recording.rrd", "scenario.toml", "figures", "report.html")


@click.command()
@click.option("--scenario", "scenario_name", metavar="NAME|FILE.toml", help="What to run.")
@click.option("--controller", "controllers", metavar="NAME", multiple=True, help="May be repeated. [flc and comp-flc]")
@click.option("--plant", metavar="|".join(PLANTS), help="What is driven. [mujoco]")
@click.option("--seed", type=int, metavar="S", help="First seed of the random numbers. [0]")
@click.option("--seeds", type=int, metavar="N", help="How many seeds, counting up from the first. [1]")
@click.option("--set", "overrides", metavar="SECTION.FIELD=VALUE", multiple=True, help="A setting; see --list.")
@click.option("--out", type=click.Path(path_type=Path), metavar="DIR", help="[runs/<scenario>-<UTC time>]")
@click.option("--overwrite", is_flag=True, help="Replace the files of an earlier run in --out.")
@click.option("--record/--no-record", default=True, help="Write recording.rrd for the rerun viewer.")
@click.option("--view", is_flag=True, help="Watch the run in a rerun viewer of its own.")
@click.option("--connect", metavar="URL", help="Watch the run in a rerun viewer that is running.")
@click.option("--figures/--no-figures", "draw", default=True, help="Draw the figures.")
@click.option("--quiet", is_flag=True, help="Print nothing but errors.")
@click.option("--list", "show_list", is_flag=True, help="List scenarios, controllers and settings.")
def run(
    scenario_name: str | None,
    controllers: tuple[str, ...],
    plant: str | None,
    seed: int | None,
    seeds: int | None,
    overrides: tuple[str, ...],
    out: Path | None,
    overwrite: bool,
    record: bool,
    view: bool,
    connect: str | None,
    draw: bool,
    quiet: bool,
    show_list: bool,
) -> None:
    """Run a scenario with one or several controllers and compare them."""
    if show_list:
        listing.show()
        return
    if scenario_name is None:
        raise OmniError(f"--scenario is missing; choose from {', '.join(scenario.builtin())}, or a .toml file")
    head = {"controllers": controllers or None, "plant": plant, "seed": seed, "seeds": seeds}
    chosen = scenario.load(scenario_name, overrides, {k: v for k, v in head.items() if v is not None})
    viewers = [] if connect is None else [live.check(connect)]
    viewers += [live.open_viewer()] if view else []
    folder = folders.prepare(out, chosen.name, OUTPUTS, overwrite)
    with console.writing(folder):
        execute(chosen, folder, record, draw, quiet, viewers)


def execute(
    chosen: scenario.Scenario, folder: Path, record: bool, draw: bool, quiet: bool, viewers: Sequence[str] = ()
) -> None:
    """Run `chosen`, shown by the `viewers` at these addresses; whatever ends it, what was recorded is in `folder`."""
    started = time.perf_counter()
    simulation = Simulation(chosen)
    (folder / "scenario.toml").write_text(chosen.to_toml(), encoding="utf-8")
    with ExitStack() as stack:
        recordings: list[Recording] = [LiveRecording(url, simulation) for url in viewers]
        recordings += [FileRecording(folder / "recording.rrd", simulation)] if record else []
        for recording in recordings:
            stack.enter_context(recording)
        stop = _simulate(simulation, recordings, quiet)
        trajectory = simulation.trajectory
        happened = events.find(trajectory, chosen.settings)
        reason, wall_s = stop.reason if stop else None, time.perf_counter() - started
        result = summary.summarise(chosen, trajectory, happened, wall_s, reason)
        if trajectory.length:
            trajectory.save(folder / "trajectory.parquet")
            for recording in recordings:
                recording.finish(console.markdown_result(result))
    if draw and trajectory.length:
        title = f"{chosen.name} on the {chosen.plant} plant"
        figures.save_all(trajectory, title, folder / "figures", chosen.settings, paper.TABLES.get(chosen.paper_table))
    result["wall_s"] = round(time.perf_counter() - started, 3)
    summary.save(result, folder / "summary.json")
    report.write([folder], folder / "report.html")
    if not quiet:
        _report(result, folder, record, draw)
    if stop:
        console.fail(f"{stop.reason}; what was recorded until then is in {folder}", stop.exit_code)


@dataclass(frozen=True)
class _Stop:
    """Why a run ended before its time."""

    reason: str
    exit_code: int


def _simulate(simulation: Simulation, recordings: Sequence[Recording], quiet: bool) -> _Stop | None:
    """Run to the end, recording in blocks; return why it stopped early, or None.

    Ctrl-C and SIGTERM end the run between two frames; a second one ends the program at once.
    """
    total = simulation.reference.frames
    try:
        with Interrupts() as interrupts, console.progress(simulation.scenario.name, total, quiet) as show:

            def after_frame(frame: int) -> None:
                interrupts.check()
                show(frame + 1)
                for recording in recordings:
                    recording.update()

            simulation.run(after_frame)
        return None
    except (SimulationError, ControllerError) as error:
        return _Stop(str(error), console.FAILED)
    except StoppedError as error:
        return _Stop(error.reason, error.exit_code)
    finally:
        for recording in recordings:
            recording.write()


def _report(result: dict[str, Any], folder: Path, record: bool, draw: bool) -> None:
    if result["results"]:
        console.print_result(result)
    print(f"{result['simulated_s']:.1f} s simulated in {result['wall_s']:.1f} s; results in {folder}/")
    print(f"  report     {folder / 'report.html'}")
    print(f"  numbers    {folder / 'summary.json'}, {folder / 'trajectory.parquet'}")
    if draw:
        print(f"  figures    {folder / 'figures'}/")
    print(f"  repeat     {_program('python')} -m omni_mj.run --scenario {folder / 'scenario.toml'}")
    if record:
        print(f"  recording  {_program('rerun')} {folder / 'recording.rrd'}")


def _program(name: str) -> str:
    """How a user starts a program that is installed beside this Python, whose folder need not be on the PATH."""
    program = Path(sys.executable).with_name(name)
    if (found := shutil.which(name)) and Path(found) == program:
        return name
    here = Path.cwd()
    return str(program.relative_to(here) if program.is_relative_to(here) else program)
