"""`omni-mj alpha`, `identify`, `limit`, `loop`, `slip`: studies of a robot, of what is possible, of controllers."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from omni_mj.cli import console, options, output_folders
from omni_mj.config.scenario import Scenario

if TYPE_CHECKING:
    from omni_mj.studies.study_runner import StartProgress

WRITTEN = ("summary.json", "scenario.toml", "scenarios", "trajectory.parquet")


def output(study: str) -> Callable[[Any], Any]:
    """Return a decorator that adds the options of a study's results: out, overwrite and quiet."""
    out = click.option(
        "--out", type=options.FOLDER, metavar="DIR", help=f"[runs/{study}-<UTC time>]"
    )
    return lambda command: out(options.OVERWRITE(options.QUIET(command)))


@click.command("alpha")
@options.ROBOT
@options.MODEL
@options.SETTINGS
@output("alpha")
@options.choice
def alpha(choice: options.Choice, **output: Any) -> None:
    """Measure how a robot follows its commands: gain and lag apart, and what takes how much of them."""
    from omni_mj.studies.alpha import alpha_figure, measure_alpha

    chosen = choice.load("rect")
    _run(
        "alpha",
        [chosen],
        lambda begin: measure_alpha(chosen, start_progress=begin),
        alpha_figure.save_alpha_figure,
        **output,
    )


@click.command("identify")
@click.argument("logs", metavar="LOG...", nargs=-1, required=True, type=options.FOLDER)
@options.ROBOT
@options.MODEL
@output("identify")
def identify(
    logs: tuple[Path, ...],
    robot: str | None,
    model: str | None,
    out: Path | None,
    overwrite: bool,
    quiet: bool,
) -> None:
    """Identify a robot from logs: CSV or Parquet with named columns (docs/how-to/identify-a-robot.md).

    --robot is that from which it starts. The scenario identify has moves to drive for logs.
    """
    from omni_mj.config.robot_files import DEFAULT_ROBOT
    from omni_mj.results import provenance
    from omni_mj.studies.identify import identify

    result = identify(logs, robot or DEFAULT_ROBOT, model)
    outputs = ("identify.json", "robot.toml", *output_folders.PROVENANCE)
    folder = output_folders.prepare(out, "identify", outputs, overwrite)
    with console.writing(folder):
        result.save(folder)
        provenance.save_provenance(
            folder, "identify", console.command_line(), [result.start], frames=False
        )
    if not quiet:
        print(result.table())
        print(console.results(folder, outputs))


@click.command("limit")
@click.argument("name", metavar="SCENARIO|FILE.toml")
@options.PLANT
@options.ROBOT
@options.MODEL
@options.SETTINGS
@click.option(
    "--seeds", type=int, metavar="N", default=20, help="How many seeds show what noise costs. [20]"
)
@click.option(
    "--seed", type=int, metavar="S", default=0, help="First seed of the random numbers. [0]"
)
@click.option(
    "--iterations",
    type=int,
    metavar="N",
    default=16,
    help="Attempts to learn from, at the most. [16]",
)
@options.ALLOW_CODE
@output("limit")
@options.choice
def limit(choice: options.Choice, name: str, iterations: int, **output: Any) -> None:
    """Find out what is possible: without noise, by learning the way; with noise, by feedback along it."""
    from omni_mj.studies import limit as study
    from omni_mj.studies.compare.compare_figure import save_comparison_figure

    chosen = choice.load(name)
    study.check_limit(chosen, iterations)

    def draw(result: study.LimitResult, stem: Path) -> None:
        save_comparison_figure(result.summary(), stem)

    _run(
        "limit",
        [chosen],
        lambda begin: study.find_limit(chosen, chosen.seed_list, iterations, start_progress=begin),
        draw,
        **output,
    )


@click.command("loop")
@click.option(
    "--controller", "controllers", metavar="NAME|FILE.py:Class", multiple=True,
    help="May be repeated. [all that come with the program, but for the oracle]",
)  # fmt: skip
@click.option(
    "--scenario", "name", metavar="NAME|FILE.toml", default="rect",
    help="Whose settings count. [rect]",
)  # fmt: skip
@options.PLANT
@options.ROBOT
@options.MODEL
@click.option("--seed", type=int, metavar="S", help="First seed of the random numbers. [0]")
@click.option("--seeds", type=int, metavar="N", help="How many seeds, over which is averaged. [1]")
@options.SETTINGS
@options.ALLOW_CODE
@output("loop")
@options.choice
def loop(choice: options.Choice, name: str, **output: Any) -> None:
    """Measure how control loops answer a step, and their gain, phase and delay margins."""
    from omni_mj.studies.loop import loop_figure, measure_loop
    from omni_mj.studies.study_runner import list_competitors

    controllers = choice.controllers or list_competitors()
    chosen = replace(choice, controllers=controllers).load(name, "wheels.model=two-rollers")
    _run(
        "loop",
        [chosen],
        lambda begin: measure_loop(chosen, chosen.controllers, start_progress=begin),
        loop_figure.save_loop_figure,
        **output,
    )


@click.command("slip")
@click.option(
    "--robot", "robots", metavar="NAME|FILE.toml", multiple=True,
    help="May be repeated. [those that were measured]",
)  # fmt: skip
@options.MODEL
@options.SETTINGS
@output("slip")
@options.choice
def slip(choice: options.Choice, robots: Sequence[str], **output: Any) -> None:
    """Identify gain, slip and drag of robots as TIGERs Mannheim do."""
    from omni_mj.config.robot_files import DEFAULT_ROBOT
    from omni_mj.studies.slip import PUBLISHED, measure_slip, prepare_slip_scenario, slip_figure

    chosen = [
        prepare_slip_scenario(replace(choice, robot=robot).load("rect", "wheels.model=two-rollers"))
        for robot in robots or ([DEFAULT_ROBOT] if choice.model else PUBLISHED)
    ]
    _run(
        "slip",
        chosen,
        lambda begin: measure_slip(chosen, start_progress=begin),
        slip_figure.save_slip_figure,
        **output,
    )


def _run(
    name: str,
    chosen: Sequence[Scenario],
    measure: "Callable[[StartProgress], Any]",
    draw: Callable[[Any, Path], None],
    out: Path | None,
    overwrite: bool,
    quiet: bool,
) -> None:
    """Measure scenarios, save the result, and end the program if the study was stopped or rows failed.

    Args:
        name: Of the command.
        chosen: Scenarios of the study.
        measure: Return the result. Its argument takes a title and the number of frames, and returns
            what is to be called after each frame.
        draw: Save the figure of a result as a file without its suffix.
        out: Folder of the results.
        overwrite: Whether files there may be replaced.
        quiet: Whether nothing is printed.
    """
    outputs = (*WRITTEN, f"{name}.png", f"{name}.svg", *output_folders.PROVENANCE)
    folder = output_folders.prepare(out, name, outputs, overwrite)
    command = console.command_line()
    with (
        console.writing(folder),
        console.Interrupts() as interrupts,
        console.progress(quiet) as begin,
    ):
        output_folders.begin_record(folder, name, command, chosen, frames=name == "limit")
        result = measure(lambda *what: console.checked(interrupts.check, begin(*what)))
        result.repeat_command = command
    with console.writing(folder):
        result.save_files(folder)
        if result.table():
            draw(result, folder / name)
    if not quiet:
        console.tell(result, folder, outputs)
    interrupts.end(result.stopped, f"what there is is in {folder}")
    console.fail_rows(result.outcomes)
