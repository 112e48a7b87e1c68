"""`omni-mj limit`: what is possible on a plant, which no controller can be better than."""

import shlex
from pathlib import Path

import click

from omni_mj.cli import console, folders, options

OUTPUTS = ("summary.json", "scenario.toml", "trajectory.parquet", "limit.png", *folders.PROVENANCE)


@click.command("limit")
@click.argument("name", metavar="SCENARIO|FILE.toml", shell_complete=options.complete("scenarios"))
@options.PLANT
@options.ROBOT
@options.MODEL
@options.SETTINGS
@click.option("--seeds", type=int, metavar="N", default=20, help="How many seeds show what noise costs. [20]")
@click.option("--seed", type=int, metavar="S", default=0, help="First seed of the random numbers. [0]")
@click.option("--iterations", type=int, metavar="N", default=16, help="Attempts to learn from, at the most. [16]")
@click.option("--out", type=options.FOLDER, metavar="DIR", help="[runs/limit-<scenario>-<UTC time>]")
@options.ALLOW_CODE
@options.OVERWRITE
@options.QUIET
@options.choice
def command(
    choice: options.Choice,
    name: str,
    iterations: int,
    out: Path | None,
    overwrite: bool,
    quiet: bool,
) -> None:
    """Find out what is possible: without noise, by learning the way; with noise, by feedback along it."""
    from omni_mj.cli.console import Interrupts
    from omni_mj.studies import limit

    chosen = choice.load(name)
    options.tell_model(chosen, quiet)
    limit.check(chosen, iterations)
    folder = folders.prepare(out, f"limit-{chosen.name}", OUTPUTS, overwrite)
    with console.writing(folder), Interrupts() as interrupts, console.progress(quiet) as begin:
        folders.begin_record(folder, "limit", console.command_line(), [chosen])
        result = limit.limit(
            chosen,
            chosen.seed_list,
            iterations,
            begin=lambda title, frames: console.checked(interrupts.check, begin(title, frames)),
        )
    result.repeat = shlex.join(["omni-mj", "limit", name, *choice.words, "--iterations", str(iterations)])
    with console.writing(folder):
        result.save_files(folder)
        if result.complete:
            from omni_mj.show import limit_figure

            with console.drawing(folder):
                limit_figure.save(result, folder / "limit.png")
    if not quiet:
        console.tell(result, folder, OUTPUTS)
    interrupts.end(result.stopped, f"no limit was found; what there is is in {folder}")
    console.fail_rows({outcome.scenario.name: outcome.failures for outcome in result.outcomes})
