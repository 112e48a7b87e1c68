"""`omni-mj alpha`: gain and lag of a robot's motion, and where they come from."""

from pathlib import Path

import click

from omni_mj.cli import console, folders, options

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
    from omni_mj.cli.interrupts import Interrupts
    from omni_mj.provenance import record
    from omni_mj.studies import alpha

    chosen = choice.load("rect")
    options.tell_model(chosen, quiet)
    folder = folders.prepare(out, "alpha", OUTPUTS, overwrite)
    with console.writing(folder), Interrupts() as interrupts, console.progress(quiet) as begin:
        asked = record.asked([(chosen.name, chosen)])
        record.begin(folder, "alpha", console.command_line(), [chosen], frames=False, given=asked)
        result = alpha.alpha(chosen, begin=lambda *what: console.checked(interrupts.check, begin(*what)))
    with console.writing(folder):
        result.save_files(folder)
        if result.study:
            from omni_mj.show import alpha_figure

            with console.drawing(folder):
                alpha_figure.save(result.study, folder / "alpha.png")
    if not quiet:
        console.tell(result, folder, OUTPUTS)
    interrupts.end(result.stopped, f"nothing was measured; what there is is in {folder}")
    console.fail_rows({outcome.scenario.name: outcome.failures for outcome in result.outcomes})
