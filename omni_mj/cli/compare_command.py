"""`omni-mj compare`: run all controllers on all scenarios over many seeds."""

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import click

from omni_mj.cli import console, options, output_folders
from omni_mj.cli.interrupts import Interrupts
from omni_mj.io.atomic_files import write_text
from omni_mj.io.printable_text import format_count

if TYPE_CHECKING:
    from omni_mj.results.result import Outcome, Result

OUTPUTS = (
    "summary.json",
    "compare.md",
    "compare.png",
    "compare.svg",
    "scenarios",
    "trajectories",
    "scenario.toml",
    "trajectory.parquet",
    *output_folders.PROVENANCE,
)


@click.command("compare")
@click.option(
    "--scenario",
    "names",
    metavar="NAME|FILE.toml",
    multiple=True,
    help="Scenario to run; may be repeated. Default: all built-in ones except hot-motors, "
    "fault-all and identify.",
)
@options.CONTROLLER
@options.scenario_options
@click.option(
    "--seeds",
    metavar="N",
    default=10,
    help="Number of consecutive seeds. Default: 10.",
)
@click.option(
    "--seed",
    metavar="N",
    default=0,
    help="First seed of the random numbers. Default: 0.",
)
@options.SUBJECT
@click.option(
    "--trajectories",
    is_flag=True,
    help="Save all frames as DIR/trajectories/<scenario>.parquet.",
)
@options.study_output_options("compare")
def compare_command(
    scenario_options: options.ScenarioOptions,
    names: tuple[str, ...],
    subject: str | None,
    trajectories: bool,
    output: options.StudyOutput,
) -> None:
    """Compare controllers on many scenarios and seeds.

    Prints and saves position errors and settling times. With --subject, it also tests whether the
    differences between that controller and the others are significant. Without --controller, all
    installed controllers are compared.
    """
    from omni_control.controllers.registry import list_available_controllers
    from omni_mj.studies import compare_figure, compare_study, compare_table

    plant = scenario_options.plant or "mujoco"
    controllers = scenario_options.controllers or list_available_controllers()
    scenario_options = replace(scenario_options, controllers=controllers, plant=plant)
    scenarios = [
        compare_study.fix_backend(scenario_options.load_scenario(name))
        for name in names or compare_study.default_scenarios(plant)
    ]
    compare_study.check_scenarios(scenarios, subject)
    folder = output_folders.prepare_folder(output.out, "compare", OUTPUTS, output.overwrite)

    def save_tables(result: "Result") -> dict[str, Any]:
        result.repeat_command = console.get_command_line()
        summary = result.save_summary(folder)
        write_text(folder / "compare.md", compare_table.to_markdown(summary))
        return summary

    def after_scenario(result: "Result", outcome: "Outcome") -> None:
        save_tables(result)
        result.save_outcome(outcome if trajectories else replace(outcome, log=None), folder)

    with (
        console.report_write_errors(folder),
        Interrupts() as interrupts,
        console.show_progress(output.quiet, interrupts.check) as start_progress,
    ):
        output_folders.write_initial_files(folder, "compare", scenarios, trajectories, subject)
        result = compare_study.compare(
            scenarios,
            controllers,
            scenarios[0].seed_list,
            subject,
            start_progress=start_progress,
            after_scenario=after_scenario,
        )
    with console.report_write_errors(folder):
        summary = save_tables(result)
        compare_figure.save_comparison_figure(summary, folder / "compare")
    if not output.quiet:
        console.print_summary_sentence(summary)
        compare_table.print_comparison(summary)
        print(f"{console.describe_outputs(folder, OUTPUTS)} after {result.wall_s:.0f} s")
    n_done = [outcome.entry["status"] for outcome in result.outcomes].count("done")
    interrupts.exit_if_stopped(
        result.stopped, f"{n_done} of {format_count(len(scenarios), 'scenario')} in {folder}"
    )
    console.exit_if_failed(result.outcomes)
