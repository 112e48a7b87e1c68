"""`omni-mj compare`: every controller on every scenario over many seeds, in one table."""

import shlex
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import click

from omni_mj.cli import console, folders, options

if TYPE_CHECKING:
    from omni_mj.measure.result import Outcome, Result
    from omni_mj.simulate.simulation import Simulation
    from omni_mj.studies.outcome import AfterFrame

OUTPUTS = ("summary.json", "compare.md", "compare.png", "compare.svg")
KEPT = ("scenarios", "trajectories", "scenario.toml", "trajectory.parquet")  # the latter two of a single scenario


@click.command("compare")
@click.option(
    "--scenario", "names", metavar="NAME|FILE.toml", multiple=True,
    help="May be repeated. [all that come with the program, but for the long heat]",
)  # fmt: skip
@click.option("--controller", "controllers", metavar="NAME|FILE.py:Class", multiple=True, help="May be repeated. [all]")
@click.option("--plant", metavar="NAME", default="mujoco", help="What is driven. [mujoco]")
@click.option("--seeds", type=int, metavar="N", default=5, help="How many seeds, counting up from the first. [5]")
@click.option("--seed", type=int, metavar="S", default=0, help="First seed of the random numbers. [0]")
@options.SUBJECT
@options.SETTINGS
@click.option("--trajectories", is_flag=True, help="Keep all frames: DIR/trajectories/<scenario>.parquet.")
@click.option("--out", type=options.FOLDER, metavar="DIR", help="[runs/compare-<UTC time>]")
@options.OVERWRITE
@options.QUIET
def command(
    names: tuple[str, ...],
    controllers: tuple[str, ...],
    plant: str,
    seeds: int,
    seed: int,
    subject: str | None,
    overrides: tuple[str, ...],
    trajectories: bool,
    out: Path | None,
    overwrite: bool,
    quiet: bool,
) -> None:
    """Compare controllers on many scenarios and seeds: errors, effort, time to settle."""
    from omni_control.registry import CONTROLLERS
    from omni_mj.cli.interrupts import Interrupts
    from omni_mj.measure.result import write
    from omni_mj.scenarios import scenario
    from omni_mj.show import compare_table
    from omni_mj.studies import compare
    from omni_mj.studies.outcome import total_frames

    controllers = controllers or tuple(CONTROLLERS)
    names = names or compare.usual(plant)
    head = {"controllers": controllers, "plant": plant, "seed": seed, "seeds": seeds}
    chosen = [scenario.load(name, overrides, head) for name in names]
    compare.check(chosen, subject)
    repeat = ["--plant", plant, "--seeds", str(seeds), "--seed", str(seed)]
    for option, values in (("--scenario", names), ("--controller", controllers), ("--set", overrides)):
        repeat += [word for value in values for word in (option, value)]
    repeat += ["--subject", subject] if subject else []
    folder = folders.prepare(out, "compare", (*OUTPUTS, *KEPT), overwrite)

    def save(result: "Result") -> None:
        result.repeat = shlex.join(["omni-mj", "compare", *repeat])
        result.save_summary(folder)
        write(folder / "compare.md", compare_table.markdown(result.summary()))

    with console.writing(folder), Interrupts() as interrupts, console.progress(quiet) as begin:
        count = 0

        def before_scenario(simulation: "Simulation") -> "AfterFrame":
            nonlocal count
            count += 1
            console.quiet_mujoco()
            title = f"{simulation.scenario.name} ({count} of {len(chosen)})"
            return console.checked(interrupts.check, begin(title, total_frames(simulation)))

        def after_scenario(result: "Result", outcome: "Outcome") -> None:
            save(result)
            result.save_outcome(outcome if trajectories else replace(outcome, log=None), folder)

        result = compare.compare(
            chosen, controllers, range(seed, seed + seeds), subject,
            before_scenario=before_scenario, after_scenario=after_scenario,
        )  # fmt: skip
    with console.writing(folder):
        save(result)
        from omni_mj.show import figures

        figures.save_comparison(result.summary(), folder / "compare")
    summary = result.summary()
    if not quiet:
        compare_table.show(summary)
        files = ", ".join(str(folder / output) for output in (*OUTPUTS, *KEPT) if (folder / output).exists())
        print(f"{result.wall_s:.1f} s; results in {files}")
    status = [outcome.entry["status"] for outcome in result.outcomes]
    interrupts.end(result.stopped, f"{status.count('done')} of {len(chosen)} scenarios are in {folder}")
    errors = [f"{o.scenario.name}: {o.entry['reason']}" for o in result.outcomes if o.entry["status"] == "failed"]
    console.fail_rows({o.scenario.name: o.failures for o in result.outcomes}, errors)
