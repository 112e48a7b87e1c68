"""`omni-mj slip`: how robots slip, beside what was measured on real ones."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import click

from omni_mj.cli import complete, console, folders, options

OUTPUTS = ("summary.json", "scenario.toml", "scenarios", "slip.png", *folders.PROVENANCE)


@click.command("slip")
@click.option(
    "--robot", "robots", metavar="NAME|FILE.toml", multiple=True, shell_complete=complete.robots,
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
    from omni_mj.cli.interrupts import Interrupts
    from omni_mj.provenance import record
    from omni_mj.scenarios.robots import DEFAULT
    from omni_mj.studies import slip
    from omni_mj.studies.slip.published import PUBLISHED

    chosen = [
        replace(choice, robot=robot).load("rect", "wheels.model=two-rollers")
        for robot in robots or ([DEFAULT] if choice.model else PUBLISHED)
    ]
    for each in chosen:
        options.tell_model(each, quiet)
    folder = folders.prepare(out, "slip", OUTPUTS, overwrite)
    with console.writing(folder):
        record.begin(folder, "slip", console.command_line(), chosen, frames=False)
    with console.writing(folder), Interrupts() as interrupts, console.progress(quiet) as begin:

        def before_robot(name: str, frames: int) -> Callable[[int], None]:
            return console.checked(interrupts.check, begin(name, frames))

        result = slip.slip(chosen, before_robot=before_robot)
    with console.writing(folder):
        driven = [outcome.scenario for outcome in result.outcomes]  # each under the name of its robot
        asked = record.asked((each.name, given) for each, given in zip(driven, chosen, strict=True))
        record.save(folder, "slip", console.command_line(), driven, frames=False, given=asked)
        result.save_files(folder)
        if result.robots:
            from omni_mj.show import slip_figure

            with console.drawing(folder):
                slip_figure.save(result.robots, folder / "slip.png")
    if not quiet:
        console.tell(result, folder, OUTPUTS)
    interrupts.end(result.stopped, f"what there is is in {folder}")
    console.fail_rows({outcome.scenario.name: outcome.failures for outcome in result.outcomes})
