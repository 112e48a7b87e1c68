"""`omni-mj sweep`: how often does it fail, and where; one scenario under many settings and seeds."""

from contextlib import nullcontext
from itertools import count
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from omni_control.errors import OmniError
from omni_mj.cli import console, options, output_folders

if TYPE_CHECKING:
    from omni_mj.studies.study_runner import AfterFrame
    from omni_mj.studies.sweep.sweep_plan import Shard, SweepPlan

OUTPUTS = (
    "sweep.json",
    "scenario.toml",
    "rows.parquet",
    "summary.json",
    "sweep.md",
    "sweep.png",
    "shards",
)


@click.command("sweep")
@options.SCENARIO
@click.option(
    "--vary",
    "varied",
    multiple=True,
    metavar="SECTION.FIELD=VALUES",
    help="LOW:HIGH:N, or A,B,C; repeatable.",
)
@options.CONTROLLER
@options.PLANT
@options.ROBOT
@options.MODEL
@click.option("--seed", type=int, metavar="S", help="First seed of the random numbers. [0]")
@click.option(
    "--seeds", type=int, metavar="N", help="How many seeds at each point. [the scenario's]"
)
@options.SETTINGS
@click.option(
    "--batch-size",
    type=int,
    default=128,
    metavar="N",
    help="Robots simulated at once; memory grows with them. [128]",
)
@click.option(
    "--jobs", type=int, default=1, metavar="N", help="Processes of this machine that run it. [1]"
)
@click.option(
    "--cluster", metavar="tcp://HOST:PORT", help="Scheduler of a Dask cluster whose workers run it."
)
@click.option(
    "--out",
    type=options.FOLDER,
    metavar="DIR",
    help="Where it goes, and goes on. [runs/sweep-<UTC time>]",
)
@options.QUIET
@options.choice
def command(
    choice: options.Choice,
    name: str | None,
    varied: tuple[str, ...],
    batch_size: int,
    out: Path | None,
    quiet: bool,
    jobs: int,
    cluster: str | None,
) -> None:
    """Run a scenario under all combinations of settings: failure rates and errors with confidence, as table and map.

    Of whole numbers, LOW:HIGH:STEP. A sweep that was stopped or killed goes on if the same is typed
    again, with its folder as --out, and computes nothing twice. Numbers that are drawn (--set
    carpet.friction='{uniform = [0.4, 0.9]}') are drawn for each seed.
    """
    from omni_mj.studies.sweep import workers
    from omni_mj.studies.sweep.sweep_plan import SweepPlan, check_axes, parse_axis

    if name is None:
        raise OmniError(
            "--scenario is missing: omni-mj sweep --scenario rect --vary carpet.friction=0.3:1.0:8"
        )
    plan = SweepPlan(choice.load(name), check_axes(map(parse_axis, varied)), batch_size)
    plan.check(jobs)  # before there is a folder
    if cluster and jobs > 1:
        raise OmniError("give --jobs, which are processes of this machine, or a --cluster")
    if out is None or not (out / OUTPUTS[0]).exists():
        out = output_folders.prepare(out, "sweep", OUTPUTS, overwrite=False)
    with workers.cluster(cluster) if cluster else nullcontext() as executor:
        _run(plan, out, quiet, jobs=jobs, executor=executor)


def _run(plan: "SweepPlan", folder: Path, quiet: bool, **how: Any) -> None:
    from omni_mj.studies.sweep import sweep_figure, sweep_study, sweep_table

    with console.writing(folder):
        with console.Interrupts() as interrupts, console.progress(quiet) as begin:
            console.quiet_mujoco()
            show, shards = (
                begin("sweep", plan.frames * len(sweep_study.remaining_shards(plan, folder))),
                count(),
            )

            def before_shard(_: "Shard") -> "AfterFrame":
                done = next(shards) * plan.frames
                return console.checked(interrupts.check, lambda frame: show(done + frame))

            result = sweep_study.run_sweep(
                plan, folder, before_shard=before_shard, check=interrupts.check, **how
            )
        done = f"{result.n_done} of {len(plan.shards)} shards are"
        if result.n_done:
            sweep_table.save_sweep_table(result, folder / "sweep.md")
            sweep_figure.save_sweep_figure(result, folder / "sweep.png")
            if not quiet:
                print(sweep_table.format_sweep_tables(result))
                print(f"repeat the worst: {result.summary['worst'][0]['repeat_command']}")
                print(f"{done} done; {console.results(folder, OUTPUTS)}")
    interrupts.end(result.stopped, f"{done} in {folder}; the same with --out {folder} goes on")
