"""`omni-mj alpha`, `identify`, `limit`, `loop`, `slip`: studies of robots and controllers."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from omni_mj.cli import console, options, output_folders
from omni_mj.cli.interrupts import Interrupts

if TYPE_CHECKING:
    from omni_mj.config.scenario import Scenario

OUTPUTS = ("summary.json", "scenario.toml", "scenarios", "trajectory.parquet")
FAST_WHEELS = "wheels.model=two-rollers"  # default of studies that drive many robots


@click.command("alpha")
@options.robot_options
@options.study_output_options("alpha")
def alpha_command(scenario_options: options.ScenarioOptions, output: options.StudyOutput) -> None:
    """Measure gain and lag of a robot's response to commands, and their causes."""
    from omni_mj.studies.alpha import alpha_figure
    from omni_mj.studies.alpha.alpha_study import measure_alpha

    scenario = scenario_options.load_scenario("rect")
    _run_study(
        "alpha",
        [scenario],
        partial(measure_alpha, scenario),
        alpha_figure.save_alpha_figure,
        output,
    )


@click.command("identify")
@click.argument("logs", metavar="LOG...", nargs=-1, required=True, type=options.FOLDER)
@options.ROBOT
@options.MODEL
@options.study_output_options("identify")
def identify_command(
    logs: tuple[Path, ...], robot: str | None, model: str | None, output: options.StudyOutput
) -> None:
    """Identify a robot's parameters from logs of its driving.

    Logs are CSV or Parquet files with named columns, see docs/how-to/identify-a-robot.md. --robot
    and --model give the initial values. The scenario identify contains moves that suit the logs.
    """
    from omni_mj.config.robot_files import DEFAULT_ROBOT
    from omni_mj.results import provenance
    from omni_mj.studies.identify.identify_study import identify

    result = identify(logs, robot or DEFAULT_ROBOT, model)
    outputs = ("identify.json", "robot.toml", "model", *output_folders.PROVENANCE)
    folder = output_folders.prepare_folder(output.out, "identify", outputs, output.overwrite)
    with console.report_write_errors(folder):
        provenance.save_provenance(
            folder, "identify", console.get_command_line(), [result.start], {}
        )
        result.save(folder)
    if not output.quiet:
        print(result.table())
        print(console.describe_outputs(folder, outputs))


@click.command("limit")
@click.argument("name", metavar="SCENARIO|FILE.toml")
@options.scenario_options
@click.option(
    "--seeds",
    metavar="N",
    default=20,
    help="Number of consecutive seeds of the runs with noise. Default: 20.",
)
@options.SEED
@click.option(
    "--iterations",
    metavar="N",
    default=16,
    help="Maximum number of learning iterations. Default: 16.",
)
@options.ALLOW_CODE
@options.study_output_options("limit")
def limit_command(
    scenario_options: options.ScenarioOptions,
    name: str,
    iterations: int,
    output: options.StudyOutput,
) -> None:
    """Find the smallest error that is possible in a scenario.

    Without noise, commands are learned by repetition (iterative learning control). With noise, a
    linear quadratic regulator follows the learned run.
    """
    from omni_mj.studies.compare_figure import save_comparison_figure
    from omni_mj.studies.limit.limit_study import check_limit, find_limit

    scenario = scenario_options.load_scenario(name)
    check_limit(scenario, iterations)

    _run_study(
        "limit",
        [scenario],
        partial(find_limit, scenario, scenario.seed_list, iterations),
        lambda result, stem: save_comparison_figure(result.summary(), stem),
        output,
    )


@click.command("loop")
@click.option(
    "--controller",
    "controllers",
    metavar="NAME|FILE.py:Class",
    multiple=True,
    help="Controller to measure; may be repeated. Default: all built-in ones that do not know the "
    "true state.",
)
@click.option(
    "--scenario",
    "name",
    metavar="NAME|FILE.toml",
    default="rect",
    help="Scenario whose settings apply. Default: rect.",
)
@options.scenario_options
@options.SEED
@options.SEEDS
@options.ALLOW_CODE
@options.study_output_options("loop")
def loop_command(
    scenario_options: options.ScenarioOptions, name: str, output: options.StudyOutput
) -> None:
    """Measure step responses and the gain, phase and delay margins of control loops."""
    from omni_mj.studies.loop import loop_figure
    from omni_mj.studies.loop.loop_study import measure_loop
    from omni_mj.studies.run_scenario import list_competitors

    controllers = scenario_options.controllers or list_competitors()
    scenario = replace(scenario_options, controllers=controllers).load_scenario(name, FAST_WHEELS)
    _run_study(
        "loop",
        [scenario],
        partial(measure_loop, scenario, scenario.controllers),
        loop_figure.save_loop_figure,
        output,
    )


@click.command("slip")
@click.option(
    "--robot",
    "robots",
    metavar="NAME|FILE.toml",
    multiple=True,
    help="Robot to measure; may be repeated. Default: those with published measurements.",
)
@options.model_options
@options.study_output_options("slip")
def slip_command(
    scenario_options: options.ScenarioOptions, robots: Sequence[str], output: options.StudyOutput
) -> None:
    """Identify gain, slip and drag of robots by the method of TIGERs Mannheim."""
    from omni_mj.config.robot_files import DEFAULT_ROBOT
    from omni_mj.studies.slip import slip_figure
    from omni_mj.studies.slip.slip_study import PUBLISHED, measure_slip, prepare_slip_scenario

    scenarios = [
        prepare_slip_scenario(
            replace(scenario_options, robot=robot).load_scenario("rect", FAST_WHEELS)
        )
        for robot in robots or ([DEFAULT_ROBOT] if scenario_options.model else PUBLISHED)
    ]
    _run_study(
        "slip",
        scenarios,
        partial(measure_slip, scenarios),
        slip_figure.save_slip_figure,
        output,
    )


def _run_study(
    name: str,
    scenarios: "Sequence[Scenario]",
    measure: Callable[..., Any],
    draw: Callable[[Any, Path], None],
    output: options.StudyOutput,
) -> None:
    """Run a study, save and print its result, and exit with an error if it is not complete.

    Args:
        name: Name of the command.
        scenarios: Scenarios of the study.
        measure: Returns the result. Its argument `start_progress` takes a title and the number of
            frames, and returns a function to call after each frame.
        draw: Saves the figure of a result, given the path without its suffix.
        output: Options for the results.
    """
    outputs = (*OUTPUTS, f"{name}.png", f"{name}.svg", *output_folders.PROVENANCE)
    folder = output_folders.prepare_folder(output.out, name, outputs, output.overwrite)
    with (
        console.report_write_errors(folder),
        Interrupts() as interrupts,
        console.show_progress(output.quiet, interrupts.check) as start_progress,
    ):
        output_folders.write_initial_files(folder, name, scenarios, frames=name == "limit")
        result = measure(start_progress=start_progress)
        result.repeat_command = console.get_command_line()
    with console.report_write_errors(folder):
        result.save_files(folder)
        text = result.table()
        if text:
            draw(result, folder / name)
    if not output.quiet:
        print(text)
        print(f"{console.describe_outputs(folder, outputs)} after {result.wall_s:.0f} s")
    interrupts.exit_if_stopped(result.stopped, f"the results so far are in {folder}")
    console.exit_if_failed(result.outcomes)
