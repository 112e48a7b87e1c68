"""`omni-mj slip`: how robots slip, beside what was measured on real ones."""

from dataclasses import replace
from pathlib import Path

import click

from omni_mj.cli import folders, options
from omni_mj.cli.study_command import StudyCommand

OUTPUTS = ("summary.json", "scenario.toml", "scenarios", "slip.png", *folders.PROVENANCE)


@click.command("slip")
@click.option(
    "--robot", "robots", metavar="NAME|FILE.toml", multiple=True, shell_complete=options.complete("robots"),
    help="May be repeated. [those that were measured]",
)  # fmt: skip
@options.MODEL
@options.SETTINGS
@click.option("--out", type=options.FOLDER, metavar="DIR", help="[runs/slip-<UTC time>]")
@options.OVERWRITE
@options.QUIET
@options.choice
def command(
    choice: options.Choice,
    robots: tuple[str, ...],
    out: Path | None,
    overwrite: bool,
    quiet: bool,
) -> None:
    """Identify gain, slip, drag and efficiency of robots as TIGERs Mannheim do."""
    from omni_mj.scenarios.robots import DEFAULT
    from omni_mj.show import slip_figure
    from omni_mj.studies.slip.published import PUBLISHED
    from omni_mj.studies.slip.study import named, slip

    chosen = [
        named(replace(choice, robot=robot).load("rect", "wheels.model=two-rollers"))
        for robot in robots or ([DEFAULT] if choice.model else PUBLISHED)
    ]
    study = StudyCommand(
        "slip",
        OUTPUTS,
        lambda chosen, begin: slip(chosen, before_robot=begin),
        lambda result, folder: slip_figure.save(result.robots, folder / "slip.png"),
    )
    study.run(chosen, out, overwrite, quiet)
