"""`omni-mj run`, or `python -m omni_mj.run`: run a scenario, print the result, save its files."""

from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from omni_control.errors import OmniError
from omni_mj.cli import console, options, output_folders
from omni_mj.cli.interrupts import Interrupts
from omni_mj.io.printable_text import join_words

if TYPE_CHECKING:
    from omni_mj.results.result import Result
    from omni_mj.simulation.simulation import Simulation

OUTPUTS = (
    "summary.json",
    "trajectory.parquet",
    "recording.rrd",
    "scenario.toml",
    "figures",
    "report.html",
    *output_folders.PROVENANCE,
)


@click.command("run")
@options.SCENARIO
@options.CONTROLLER
@options.scenario_options
@options.SEED
@options.SEEDS
@options.out_option("<scenario>")
@options.ALLOW_CODE
@options.OVERWRITE
@options.viewer_options
@options.FIGURES
@options.SVG
@options.QUIET
def run_command(
    scenario_options: options.ScenarioOptions,
    output_options: options.OutputOptions,
    name: str | None,
    out: Path | None,
    overwrite: bool,
    quiet: bool,
) -> None:
    """Run a scenario with one or several controllers, and compare them."""
    from omni_mj.studies import run_scenario

    scenario = scenario_options.load_scenario(require_scenario(name))
    simulation = run_scenario.prepare_simulation(scenario)
    rerun_targets = open_viewers(output_options)
    folder = output_folders.prepare_folder(out, scenario.name, OUTPUTS, overwrite)
    if output_options.record:
        rerun_targets.append(folder / "recording.rrd")
    with console.report_write_errors(folder):
        with Interrupts() as interrupts:
            result = run_and_save(simulation, folder, rerun_targets, interrupts, quiet)
        report_result(result, folder, output_options, quiet)
        exit_unless_complete(result, folder, interrupts)


def require_scenario(name: str | None) -> str:
    """Return the value of --scenario.

    Raises:
        OmniError: The option is missing.
    """
    from omni_mj.config.toml_files import find_builtin_files

    if name is None:
        names = ", ".join(find_builtin_files("scenarios"))
        raise OmniError(f"--scenario is missing; choose from {names}, or a .toml file")
    return name


def run_and_save(
    simulation: "Simulation",
    folder: Path,
    rerun_targets: Sequence[Path | str],
    interrupts: Interrupts,
    quiet: bool,
    study: str = "run",
) -> "Result":
    """Run a simulation, save its results and return them.

    Args:
        simulation: Simulation at its start.
        folder: Folder of the results.
        rerun_targets: Recording files and URLs of rerun viewers to which frames are sent.
        interrupts: Signals, checked after each frame.
        quiet: Whether the progress bar is hidden.
        study: Name of the command.
    """
    from omni_mj.studies import run_scenario

    scenario = simulation.scenario
    output_folders.write_initial_files(folder, study, [scenario])
    with ExitStack() as stack:
        recordings: list[Any] = []
        if rerun_targets:
            from omni_mj.viz.recording import Recording

            recordings = [
                stack.enter_context(Recording(target, simulation)) for target in rerun_targets
            ]
        start_progress = stack.enter_context(console.show_progress(quiet, interrupts.check))
        show_progress = start_progress(scenario.name, run_scenario.count_frames(simulation))

        def after_frame(frame: int) -> None:
            show_progress(frame)
            for recording in recordings:
                recording.update()

        try:
            outcome = run_scenario.run_simulation(simulation, after_frame)
        finally:
            for recording in recordings:
                recording.write()
        result = run_scenario.build_result(outcome)
        allow_code = ["--allow-code"] if scenario.names_user_code else []
        words = ["omni-mj", "run", "--scenario", str(folder / "scenario.toml"), *allow_code]
        result.repeat_command = join_words(words) if study == "run" else console.get_command_line()
        result.save_files(folder)
    return result


def report_result(
    result: "Result", folder: Path, output_options: options.OutputOptions, quiet: bool
) -> None:
    """Draw the figures, write the report, and print the tables and the files."""
    try:
        if output_options.draw:
            from omni_mj.viz import run_figures

            run_figures.save_run_figures(result.outcomes[0], folder / "figures", output_options.svg)
        from omni_mj.report import html_report

        html_report.write_report([folder], folder / "report.html")
    finally:
        if not quiet:  # at the end, because printing fails if the reader of the output has ended
            _print_tables(result)
            _print_files(result, folder)


def exit_unless_complete(result: "Result", folder: Path, interrupts: Interrupts) -> None:
    """Exit with an error if the run was stopped or a row failed.

    The exit code is 128 plus the number of the signal that stopped the run, or 1 for failed rows.
    """
    interrupts.exit_if_stopped(result.stopped, f"the frames so far are in {folder}")
    console.exit_if_failed(result.outcomes)


def open_viewers(output_options: options.OutputOptions) -> list[Path | str]:
    """Open a viewer for --view, and return the URLs of all viewers that show the run live.

    Callers add the file of a recording.
    """
    if not output_options.view and output_options.connect is None:
        return []
    from omni_mj.viz.recording import viewer

    urls: list[Path | str] = []
    if output_options.connect is not None:
        urls.append(viewer.validate_url(output_options.connect))
    if output_options.view:
        urls.append(viewer.open_viewer())
    return urls


def _print_tables(result: "Result") -> None:
    """Print the result in one sentence, then the tables and the events of a run."""
    from omni_mj.results import result_tables, text_table

    summary = result.summary()
    if not result.outcomes[0].entry["results"]:
        return
    console.print_summary_sentence(summary)
    optional_tables = (
        result_tables.results_table(summary),
        result_tables.saturation_table(summary),
        result_tables.recovery_table(summary),
    )
    for result_table in optional_tables:
        if result_table:
            print(text_table.format_table(result_table), end="\n\n")
    console.print_events(result.outcomes[0].entry)


def _print_files(result: "Result", folder: Path) -> None:
    """Print the duration of the run, its files, and the command that repeats it."""
    (outcome,) = result.outcomes
    backend = " by JAX" if outcome.scenario.settings.physics.backend == "jax" else ""
    print(
        f"{outcome.entry['simulated_s']:.1f} s of motion in {result.wall_s:.1f} s of real time"
        f"{backend}; results in {folder}/"
    )
    files = {"numbers": "summary.json", "figures": "figures", "report": "report.html"}
    for label, name in files.items():
        if (folder / name).exists():
            print(f"  {label:10} {folder / name}")
    print(f"  repeat     {result.repeat_command}")
    if (folder / "recording.rrd").exists():
        print(f"  recording  {join_words(['rerun', str(folder / 'recording.rrd')])}")
