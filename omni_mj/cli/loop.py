"""`omni-mj loop`: step responses and margins of controllers, measured on the plant."""

from dataclasses import replace
from pathlib import Path

import click

from omni_mj.cli import folders, options
from omni_mj.cli.study_command import StudyCommand

OUTPUTS = ("summary.json", "scenario.toml", "loop.png", "loop.svg", *folders.PROVENANCE)


@click.command("loop")
@click.option(
    "--controller", "controllers", metavar="NAME|FILE.py:Class", multiple=True,
    shell_complete=options.complete("controllers"),
    help="May be repeated. [all that come with the program, but for the oracle]",
)  # fmt: skip
@click.option(
    "--scenario", "name", metavar="NAME|FILE.toml", default="rect", shell_complete=options.complete("scenarios"),
    help="Whose settings count. [rect]",
)  # fmt: skip
@options.PLANT
@options.ROBOT
@options.MODEL
@click.option("--seed", type=int, metavar="S", help="First seed of the random numbers. [0]")
@click.option("--seeds", type=int, metavar="N", help="How many seeds, over which is averaged. [1]")
@options.SETTINGS
@click.option("--out", type=options.FOLDER, metavar="DIR", help="[runs/loop-<UTC time>]")
@options.ALLOW_CODE
@options.OVERWRITE
@options.QUIET
@options.choice
def command(
    choice: options.Choice,
    name: str,
    out: Path | None,
    overwrite: bool,
    quiet: bool,
) -> None:
    """Measure how control loops answer a step, and their gain, phase and delay margins."""
    from omni_mj.show import loop_figure
    from omni_mj.studies.loop import loop, study
    from omni_mj.studies.loop.drive import FRAMES

    chosen = replace(choice, controllers=choice.controllers or study.usual()).load(name, "wheels.model=two-rollers")
    measured = StudyCommand(
        "loop",
        OUTPUTS,
        lambda chosen, begin: loop(chosen[0], chosen[0].controllers, after_frame=begin("loop", FRAMES)),
        lambda result, folder: loop_figure.save(result.findings, folder / "loop"),
    )
    measured.run([chosen], out, overwrite, quiet)
