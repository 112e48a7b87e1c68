"""`omni-mj limit`: what is possible on a plant, which no controller can be better than."""

import shlex
from pathlib import Path

import click

from omni_mj.cli import complete, console, folders, options

OUTPUTS = ("summary.json", "scenario.toml", "trajectory.parquet", "limit.png", *folders.PROVENANCE)


@click.command("limit")
@click.argument("name", metavar="SCENARIO|FILE.toml", shell_complete=complete.scenarios)
@click.option(
    "--plant", metavar="NAME|FILE.py:Class", shell_complete=complete.plants, help="What is driven. [the scenario's]"
)
@click.option(
    "--robot", metavar="NAME|FILE.toml", shell_complete=complete.robots, help="Which robot it is. [the scenario's]"
)
@options.MODEL
@options.SETTINGS
@click.option("--seeds", type=int, metavar="N", default=20, help="How many seeds show what noise costs. [20]")
@click.option("--seed", type=int, metavar="S", default=0, help="First seed of the random numbers. [0]")
@click.option("--iterations", type=int, metavar="N", default=16, help="Attempts to learn from, at the most. [16]")
@click.option("--out", type=options.FOLDER, metavar="DIR", help="[runs/limit-<scenario>-<UTC time>]")
@options.ALLOW_CODE
@options.OVERWRITE
@options.QUIET
def command(
    name: str,
    plant: str | None,
    robot: str | None,
    model: str | None,
    overrides: tuple[str, ...],
    seeds: int,
    seed: int,
    iterations: int,
    out: Path | None,
    allow_code: bool,
    overwrite: bool,
    quiet: bool,
) -> None:
    """Find out what is possible: without noise, by learning the way; with noise, by feedback along it."""
    from omni_mj.cli.interrupts import Interrupts
    from omni_mj.provenance import record
    from omni_mj.scenarios import scenario
    from omni_mj.studies import limit

    overrides = options.with_model(overrides, model)
    head = {"plant": plant, "robot": robot, "seed": seed, "seeds": seeds}
    given = {key: value for key, value in head.items() if value is not None}
    chosen = scenario.load(name, overrides, given, allow_code)
    options.tell_model(chosen, quiet)
    limit.check(chosen, iterations)
    folder = folders.prepare(out, f"limit-{chosen.name}", OUTPUTS, overwrite)
    with console.writing(folder), Interrupts() as interrupts, console.progress(quiet) as begin:
        record.begin(folder, "limit", console.command_line(), [chosen], given={"iterations": iterations})
        result = limit.limit(
            chosen,
            chosen.seed_list,
            iterations,
            begin=lambda title, frames: console.checked(interrupts.check, begin(title, frames)),
        )
    words = [name, "--seeds", str(seeds), "--seed", str(seed), "--iterations", str(iterations)]
    words += [word for option, value in (("--plant", plant), ("--robot", robot)) if value for word in (option, value)]
    words += [word for override in overrides for word in ("--set", override)]
    words += ["--allow-code"] * allow_code
    result.repeat = shlex.join(["omni-mj", "limit", *words])
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
