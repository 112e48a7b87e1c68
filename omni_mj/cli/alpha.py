"""`omni-mj alpha`: gain and lag of a robot's motion, and where they come from."""

from pathlib import Path

import click

from omni_mj.cli import folders, options
from omni_mj.cli.study_command import StudyCommand

OUTPUTS = ("summary.json", "scenario.toml", "scenarios", "alpha.png", *folders.PROVENANCE)


@click.command("alpha")
@options.ROBOT
@options.MODEL
@options.SETTINGS
@click.option("--out", type=options.FOLDER, metavar="DIR", help="[runs/alpha-<UTC time>]")
@options.OVERWRITE
@options.QUIET
@options.choice
def command(
    choice: options.Choice,
    out: Path | None,
    overwrite: bool,
    quiet: bool,
) -> None:
    """Measure how a robot follows its commands: gain and lag apart, and what takes how much of them."""
    from omni_mj.show import alpha_figure
    from omni_mj.studies import alpha

    study = StudyCommand(
        "alpha",
        OUTPUTS,
        lambda chosen, begin: alpha.alpha(chosen[0], begin=begin),
        lambda result, folder: alpha_figure.save(result.study, folder / "alpha.png"),
    )
    study.run([choice.load("rect")], out, overwrite, quiet)
