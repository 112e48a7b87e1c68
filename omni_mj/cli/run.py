"""`omni-mj run`, or `python -m omni_mj.run`: run a scenario, show its result, leave its files."""

import os
import shlex
import shutil
import sys
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING

import click

from omni_control.errors import OmniError
from omni_mj.cli import console, folders, options

if TYPE_CHECKING:
    from omni_mj.cli.console import Interrupts
    from omni_mj.measure.result import Outcome, Result
    from omni_mj.scenarios.scenario import Scenario
    from omni_mj.show.recording import Recording
    from omni_mj.simulate.simulation import Simulation

RESULTS = ("summary.json", "trajectory.parquet", "recording.rrd", "scenario.toml", "figures", "report.html")
OUTPUTS = (*RESULTS, *folders.PROVENANCE)


@click.command("run")
@options.SCENARIO
@options.CONTROLLER
@options.PLANT
@options.ROBOT
@options.MODEL
@click.option("--seed", type=int, metavar="S", help="First seed of the random numbers. [0]")
@click.option("--seeds", type=int, metavar="N", help="How many seeds, counting up from the first. [1]")
@options.SETTINGS
@click.option("--out", type=options.FOLDER, metavar="DIR", help="[runs/<scenario>-<UTC time>]")
@options.ALLOW_CODE
@options.OVERWRITE
@options.RECORD
@options.VIEW
@options.CONNECT
@options.FIGURES
@options.SVG
@options.QUIET
@click.option("--list", "show_list", is_flag=True, help="The same as omni-mj list.")
@options.choice
@options.outputs
def command(
    choice: options.Choice,
    outputs: options.Outputs,
    name: str | None,
    out: Path | None,
    overwrite: bool,
    quiet: bool,
    show_list: bool,
) -> None:
    """Run a scenario with one or several controllers and compare them."""
    if show_list:
        from omni_mj.show import listing

        listing.show()
        return
    from omni_mj.cli.console import Interrupts
    from omni_mj.scenarios.toml_files import builtin
    from omni_mj.studies import run

    if name is None:
        raise OmniError(f"--scenario is missing; choose from {', '.join(builtin())}, or a .toml file")
    chosen = choice.load(name)
    options.tell_model(chosen, quiet)
    simulation = run.prepare(chosen)
    shown_by = viewers(outputs.view, outputs.connect)
    folder = folders.prepare(out, chosen.name, OUTPUTS, overwrite)
    with console.writing(folder):
        with Interrupts() as interrupts:  # Ctrl-C and SIGTERM end it between two frames
            result = recorded(simulation, folder, outputs.record, shown_by, interrupts, quiet)
        shown(result, folder, outputs.draw, quiet, outputs.svg)
        ended(result, folder, interrupts)


def recorded(
    simulation: "Simulation",
    folder: Path,
    record: bool,
    shown_by: Sequence[str],
    interrupts: "Interrupts",
    quiet: bool,
    study: str = "run",
    watch: Callable[[int], None] | None = None,
) -> "Result":
    """Run a simulation and save what came of it.

    Args:
        simulation: at its start.
        folder: for the files.
        record: whether to write a recording.
        shown_by: addresses of viewers.
        interrupts: asked after each frame.
        quiet: whether to show nothing while it runs.
        study: the command's name.
        watch: called with each frame's number in place of showing progress.
    """
    from omni_mj.files import write
    from omni_mj.measure.table import table
    from omni_mj.show import tables
    from omni_mj.studies import run

    console.quiet_mujoco()
    folders.begin_record(folder, study, console.command_line(), [simulation.scenario])
    write(folder / "scenario.toml", simulation.scenario.to_toml())
    with ExitStack() as stack:
        recordings = _recordings(simulation, folder, record, shown_by)
        for recording in recordings:
            stack.enter_context(recording)
        outcome = _drive(simulation, recordings, interrupts, quiet, watch)
        result = run.of(simulation, outcome)
        result.repeat = shlex.join(["omni-mj", study, *_as_it_was(simulation.scenario, folder)])
        result.save_files(folder)
        if simulation.log.lengths.any():
            text = tables.titled(table(result.summary()))
            for recording in recordings:
                recording.finish(text)
    return result


def shown(result: "Result", folder: Path, draw: bool, quiet: bool, svg: bool = False) -> None:
    """Print the table, draw the figures, if they are wanted, write the report, and say what is there."""
    if not quiet:
        _table(result)
    with console.drawing(folder):
        if draw:
            from omni_mj.show import figures

            figures.save_all(result.outcomes[0], folder / "figures", svg)
        from omni_mj.show import report

        report.write([folder], folder / "report.html")
    if not quiet:
        _files(result, folder)


def ended(result: "Result", folder: Path, interrupts: "Interrupts") -> None:
    """End the program as it shall end if a run was stopped, or a row failed."""
    interrupts.end(result.stopped, f"what was recorded until then is in {folder}")
    console.fail_rows({outcome.scenario.name: outcome.failures for outcome in result.outcomes})


def viewers(view: bool, connect: str | None) -> list[str]:
    """The addresses of the viewers in which the run is watched."""
    if not view and connect is None:
        return []
    from omni_mj.show.recording import viewer

    return ([] if connect is None else [viewer.check(connect)]) + ([viewer.open_viewer()] if view else [])


def _recordings(simulation: "Simulation", folder: Path, record: bool, shown_by: Sequence[str]) -> "list[Recording]":
    if not record and not shown_by:
        return []
    from omni_mj.show.recording import Recording

    targets: list[Path | str] = [*shown_by, *[folder / "recording.rrd"] * record]
    return [Recording(target, simulation) for target in targets]


def _drive(
    simulation: "Simulation",
    recordings: "Sequence[Recording]",
    interrupts: "Interrupts",
    quiet: bool,
    watch: Callable[[int], None] | None,
) -> "Outcome":
    """Run to the end, recording in blocks."""
    from omni_mj.studies.outcome import drive, total_frames

    try:
        with console.progress(quiet or watch is not None) as begin:
            show = watch or begin(simulation.scenario.name, total_frames(simulation))

            def after_frame(frame: int) -> None:
                interrupts.check()
                show(frame)
                for recording in recordings:
                    recording.update()

            return drive(simulation, after_frame)
    finally:
        for recording in recordings:
            recording.write()


def _table(result: "Result") -> None:
    """Print the table, and what happened."""
    from omni_mj.measure.table import recovery_table, table, why_table
    from omni_mj.show import tables

    (outcome,) = result.outcomes
    if outcome.entry["results"]:
        summary = result.summary()
        tables.show(table(summary))
        for more in (why_table(summary), recovery_table(summary)):
            if more:
                tables.show(more)
        console.print_events(outcome.entry)


def _files(result: "Result", folder: Path) -> None:
    """Print what is in the folder."""
    (outcome,) = result.outcomes
    by = " by JAX" if outcome.scenario.settings.physics.kernel == "jax" else ""
    print(f"{outcome.entry['simulated_s']:.1f} s simulated in {result.wall_s:.1f} s{by}; results in {folder}/")
    frames, figures, recording = (folder / name for name in ("trajectory.parquet", "figures", "recording.rrd"))
    print(f"  report     {folder / 'report.html'}")
    print(f"  numbers    {folder / 'summary.json'}" + f", {frames}" * frames.exists())
    if figures.exists():
        print(f"  figures    {figures}/")
    again = f"{_program('python')} -m omni_mj.run" if outcome.scenario.plant != "live" else "omni-mj drive"
    print(f"  repeat     {again} {shlex.join(_as_it_was(outcome.scenario, folder))}")
    if recording.exists():
        print(f"  recording  {_program('rerun')} {recording}")


def _as_it_was(scenario: "Scenario", folder: Path) -> list[str]:
    """The options with which a scenario is run again."""
    return [
        "--scenario",
        str(folder / "scenario.toml"),
        *["--allow-code"] * (scenario.has_code and scenario.plant != "live"),
    ]


def _program(name: str) -> str:
    """Return how a user starts a program that is installed beside this Python, whose folder need not be on the PATH."""
    program = Path(sys.executable).with_name(name)
    return name if shutil.which(name) == str(program) else os.path.relpath(program)
