"""`omni-mj compare`: every controller on every scenario over many seeds, in one table."""

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import click

from omni_mj.cli import console, options, output_folders

if TYPE_CHECKING:
    from omni_mj.results.result import Outcome, Result

OUTPUTS = ("summary.json", "compare.md", "compare.png", "compare.svg")
KEPT = (
    "scenarios",
    "trajectories",
    "scenario.toml",
    "trajectory.parquet",
    *output_folders.PROVENANCE,
)


@click.command("compare")
@click.option(
    "--scenario", "names", metavar="NAME|FILE.toml", multiple=True,
    help="May be repeated. [all that come with the program, but for hot-motors, fault-all and identify]",
)  # fmt: skip
@options.CONTROLLER
@options.PLANT
@options.ROBOT
@options.MODEL
@click.option(
    "--seeds", type=int, metavar="N", default=10, help="How many seeds, from the first on. [10]"
)
@click.option(
    "--seed", type=int, metavar="S", default=0, help="First seed of the random numbers. [0]"
)
@options.SUBJECT
@options.SETTINGS
@click.option(
    "--trajectories", is_flag=True, help="Keep all frames: DIR/trajectories/<scenario>.parquet."
)
@click.option("--out", type=options.FOLDER, metavar="DIR", help="[runs/compare-<UTC time>]")
@options.OVERWRITE
@options.QUIET
@options.choice
def command(
    choice: options.Choice,
    names: tuple[str, ...],
    subject: str | None,
    trajectories: bool,
    out: Path | None,
    overwrite: bool,
    quiet: bool,
) -> None:
    """Compare controllers on many scenarios: errors, effort, time to settle, and whether differences are by chance.

    Without --controller all that are installed are compared.
    """
    from omni_control.controllers import list_available_controllers
    from omni_mj.files import write_text
    from omni_mj.studies import compare
    from omni_mj.studies.compare import compare_figure, compare_table

    plant = choice.plant or "mujoco"
    choice = replace(
        choice, controllers=choice.controllers or list_available_controllers(), plant=plant
    )
    names = names or compare.default_scenarios(plant)
    chosen = [choice.load(name) for name in names]
    compare.check_scenarios(chosen, subject)
    folder = output_folders.prepare(out, "compare", (*OUTPUTS, *KEPT), overwrite)

    def save(result: "Result") -> None:
        result.repeat_command = console.command_line()
        result.save_summary(folder)
        write_text(folder / "compare.md", compare_table.to_markdown(result.summary()))

    with (
        console.writing(folder),
        console.Interrupts() as interrupts,
        console.progress(quiet) as begin,
    ):
        output_folders.begin_record(folder, "compare", console.command_line(), chosen, trajectories)

        def after(result: "Result", outcome: "Outcome") -> None:
            save(result)
            result.save_outcome(outcome if trajectories else replace(outcome, log=None), folder)

        seeds = chosen[0].seed_list
        result = compare.compare(
            chosen, choice.controllers, seeds, subject,
            start_progress=lambda *what: console.checked(interrupts.check, begin(*what)), after_scenario=after,
        )  # fmt: skip
    with console.writing(folder):
        save(result)
        summary = result.summary()
        compare_figure.save_comparison_figure(summary, folder / "compare")
    if not quiet:
        compare_table.print_comparison(summary)
        print(f"{console.results(folder, (*OUTPUTS, *KEPT))} after {result.wall_s:.0f} s")
    status = [outcome.entry["status"] for outcome in result.outcomes]
    interrupts.end(
        result.stopped, f"{status.count('done')} of {len(chosen)} scenarios are in {folder}"
    )
    errors = [
        f"{o.scenario.name}: {o.entry['reason']}"
        for o in result.outcomes
        if o.entry["status"] == "failed"
    ]
    console.fail_rows(result.outcomes, errors)
