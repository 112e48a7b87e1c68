"""`omni-mj run`, or `python -m omni_mj.run`: run a scenario, show its result, leave its files."""

import shlex
import textwrap
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from omni_control.errors import OmniError
from omni_mj.cli import console, options, output_folders

if TYPE_CHECKING:
    from omni_mj.results.result import Result
    from omni_mj.simulation.simulation import Simulation

RESULTS = (
    "summary.json",
    "trajectory.parquet",
    "recording.rrd",
    "scenario.toml",
    "figures",
    "report.html",
)
OUTPUTS = (*RESULTS, *output_folders.PROVENANCE)


@click.command("run")
@options.SCENARIO
@options.CONTROLLER
@options.PLANT
@options.ROBOT
@options.MODEL
@click.option("--seed", type=int, metavar="S", help="First seed of the random numbers. [0]")
@click.option(
    "--seeds", type=int, metavar="N", help="How many seeds, counting up from the first. [1]"
)
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
@options.choice
@options.outputs
def command(
    choice: options.Choice,
    outputs: options.Outputs,
    name: str | None,
    out: Path | None,
    overwrite: bool,
    quiet: bool,
) -> None:
    """Run a scenario with one or several controllers and compare them."""
    from omni_mj.config.toml_files import find_builtin_scenarios
    from omni_mj.studies import run_scenario

    if name is None:
        raise OmniError(
            f"--scenario is missing; choose from {', '.join(find_builtin_scenarios())}, or a .toml file"
        )
    chosen = choice.load(name)
    simulation = run_scenario.prepare_simulation(chosen)
    shown_by = viewers(outputs.view, outputs.connect)
    folder = output_folders.prepare(out, chosen.name, OUTPUTS, overwrite)
    with console.writing(folder):
        with console.Interrupts() as interrupts:  # Ctrl-C and SIGTERM end it between two frames
            result = recorded(simulation, folder, outputs.record, shown_by, interrupts, quiet)
        shown(result, folder, outputs.draw, quiet, outputs.svg)
        ended(result, folder, interrupts)


def recorded(
    simulation: "Simulation",
    folder: Path,
    record: bool,
    shown_by: Sequence[str],
    interrupts: console.Interrupts,
    quiet: bool,
    study: str = "run",
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
    """
    from omni_mj.files import write_text
    from omni_mj.studies import run_scenario
    from omni_mj.studies.study_runner import count_frames, run_simulation

    console.quiet_mujoco()
    scenario = simulation.scenario
    output_folders.begin_record(folder, study, console.command_line(), [scenario])
    write_text(folder / "scenario.toml", scenario.to_toml())
    targets: list[Path | str] = [*shown_by, *[folder / "recording.rrd"] * record]
    with ExitStack() as stack:
        recordings: list[Any] = []
        if targets:
            from omni_mj.viz.recording import Recording

            recordings = [stack.enter_context(Recording(target, simulation)) for target in targets]
        begin = stack.enter_context(console.progress(quiet))
        show = begin(scenario.name, count_frames(simulation))

        def after_frame(frame: int) -> None:
            interrupts.check()
            show(frame)
            for recording in recordings:
                recording.update()

        try:
            outcome = run_simulation(simulation, after_frame)
        finally:
            for recording in recordings:
                recording.write()
        result = run_scenario.build_result(simulation, outcome)
        allow_code = ["--allow-code"] * scenario.references_code
        words = ["omni-mj", "run", "--scenario", str(folder / "scenario.toml"), *allow_code]
        result.repeat_command = shlex.join(words) if study == "run" else console.command_line()
        result.save_files(folder)
    return result


def shown(result: "Result", folder: Path, draw: bool, quiet: bool, svg: bool = False) -> None:
    """Draw the figures, if they are wanted, write the report, print the tables and what is there."""
    try:
        if draw:
            from omni_mj.viz import figures

            figures.save_run_figures(result.outcomes[0], folder / "figures", svg)
        from omni_mj.viz import report

        report.write_report([folder], folder / "report.html")
    finally:
        if not quiet:  # last, since the reader may go
            _print_tables(result)
            _print_files(result, folder)


def ended(result: "Result", folder: Path, interrupts: console.Interrupts) -> None:
    """End the program as it shall end if a run was stopped, or a row failed."""
    interrupts.end(result.stopped, f"what was recorded until then is in {folder}")
    console.fail_rows(result.outcomes)


def viewers(view: bool, connect: str | None) -> list[str]:
    """The addresses of the viewers in which the run is watched."""
    if not view and connect is None:
        return []
    from omni_mj.viz.recording import viewer

    return ([] if connect is None else [viewer.validate_url(connect)]) + (
        [viewer.open_viewer()] if view else []
    )


def _print_tables(result: "Result") -> None:
    """Print the result in one sentence, then the tables and the events of a run."""
    from omni_mj.results import result_tables
    from omni_mj.results.summary_sentence import summary_sentence

    summary = result.summary()
    if not result.outcomes[0].entry["results"]:
        return
    print(textwrap.fill(summary_sentence(summary), result_tables.TERMINAL_WIDTH), end="\n\n")
    tables = (
        result_tables.results_table(summary),
        result_tables.saturation_table(summary),
        result_tables.recovery_table(summary),
    )
    for table in tables:
        if table:
            print(result_tables.format_table(table), end="\n\n")
    console.print_events(result.outcomes[0].entry)


def _print_files(result: "Result", folder: Path) -> None:
    """Print what is in the folder."""
    (outcome,) = result.outcomes
    by = " by JAX" if outcome.scenario.settings.physics.backend == "jax" else ""
    print(
        f"{outcome.entry['simulated_s']:.1f} s simulated in {result.wall_s:.1f} s{by}; results in {folder}/"
    )
    for what, name in (
        ("numbers", "summary.json"),
        ("figures", "figures"),
        ("report", "report.html"),
    ):
        if (folder / name).exists():
            print(f"  {what:10} {folder / name}")
    print(f"  repeat     {result.repeat_command}")
    if (folder / "recording.rrd").exists():
        print(f"  recording  rerun {folder / 'recording.rrd'}")
