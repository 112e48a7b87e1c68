"""`omni-mj sweep`: how often does it fail, and where; one scenario under many settings and seeds."""

import time
from itertools import count
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from omni_control.errors import OmniError
from omni_mj.cli import console, folders, options

if TYPE_CHECKING:
    from omni_mj.studies.outcome import AfterFrame
    from omni_mj.studies.sweep import Plan, Sweep
    from omni_mj.studies.sweep.plan import Job

OUTPUTS = (
    "sweep.json", "scenario.toml", "rows.parquet", "summary.json", "sweep.md", "sweep.png", "sensitivity.md",
    "sensitivity.png", "shards", "kept",
)  # fmt: skip
TRIAL_FRAMES = 20  # of the first shard, from which the time is estimated


@click.command("sweep")
@options.SCENARIO
@click.option(
    "--vary", "varied", multiple=True, metavar="SECTION.FIELD=VALUES", help="LOW:HIGH:N, or A,B,C; repeatable."
)
@options.CONTROLLER
@options.PLANT
@options.ROBOT
@options.MODEL
@click.option("--seed", type=int, metavar="S", help="First seed of the random numbers. [0]")
@click.option("--seeds", type=int, metavar="N", help="How many seeds at each point. [the scenario's]")
@options.SETTINGS
@click.option("--at-once", type=int, metavar="N", help="Robots simulated at once; memory grows with them. [128]")
@click.option("--keep", multiple=True, metavar="worst:N|median:N|sample:N", help="Trajectories of robots.")
@click.option("--sensitivity", metavar="sobol|morris", help="Of what is drawn, what matters? In place of --vary.")
@click.option("--samples", type=int, default=64, metavar="N", help="For it; runs are N times settings and more. [64]")
@click.option("--jobs", type=int, default=1, metavar="N", help="Processes of this machine that run it. [1]")
@click.option("--cluster", metavar="tcp://HOST:PORT", help="Scheduler of a Dask cluster whose workers run it.")
@click.option("--out", type=options.FOLDER, metavar="DIR", help="[runs/sweep-<UTC time>]")
@click.option("--resume", type=options.FOLDER, metavar="DIR", help="Go on with a sweep that was stopped or killed.")
@options.QUIET
@options.choice
def command(
    choice: options.Choice,
    name: str | None,
    varied: tuple[str, ...],
    at_once: int | None,
    sensitivity: str | None,
    samples: int,
    out: Path | None,
    resume: Path | None,
    quiet: bool,
    **how: Any,
) -> None:
    """Run a scenario under all combinations of settings: failure rates and errors with confidence, as table and map.

    Of whole numbers, LOW:HIGH:STEP. A sweep that was stopped or killed goes on with --resume DIR, and computes nothing
    twice. Numbers that are drawn (--set carpet.friction='{uniform = [0.4, 0.9]}') are drawn for each seed.
    """
    from omni_mj.studies.sweep import sensitivity as sensitivities
    from omni_mj.studies.sweep.plan import AT_ONCE, Axis, Plan, axes
    from omni_mj.studies.sweep.study import parse_keep
    from omni_mj.studies.sweep.workers import Workers

    Workers(how["jobs"], how["cluster"])  # before there is a folder, as all that is checked here
    for text in how["keep"]:
        parse_keep(text)
    if resume is not None:
        if name or varied or out or sensitivity:
            raise OmniError("--resume says it all: the folder knows its scenario and what is varied")
        plan, folder = Plan.read(resume), resume
    else:
        if sensitivity and varied:
            raise OmniError("give --vary, or --sensitivity, which samples what is drawn (--set)")
        if name is None or not (varied or sensitivity):
            missing = "--scenario" if name is None else "--vary"
            raise OmniError(f"{missing} is missing: omni-mj sweep --scenario rect --vary carpet.friction=0.3:1.0:8")
        chosen = choice.load(name)
        options.tell_model(chosen, quiet)
        size = AT_ONCE if at_once is None else at_once
        if sensitivity:
            plan = sensitivities.plan(chosen, sensitivities.Design(sensitivity, samples), at_once=size)
        else:
            plan = Plan(chosen, axes([Axis.parse(text) for text in varied]), size)
        plan.check_memory(how["jobs"])
        folder = folders.prepare(out, "sweep", OUTPUTS, overwrite=False)
    _run(plan, folder, quiet, **how)


def _run(plan: "Plan", folder: Path, quiet: bool, **how: Any) -> None:
    from omni_mj.cli.console import Interrupts
    from omni_mj.studies.sweep import study

    left = study.left(plan, folder)
    with console.writing(folder), Interrupts() as interrupts, console.progress(quiet) as begin:
        console.quiet_mujoco()
        if left and not quiet:
            print(_estimate(plan, left))
        show, shards = begin("sweep", plan.frames * len(left)), count()

        def before_shard(_: "Job") -> "AfterFrame":
            done = next(shards) * plan.frames
            return console.checked(interrupts.check, lambda frame: show(done + frame))

        found = study.run(plan, folder, before_shard=before_shard, check=interrupts.check, **how)
    with console.writing(folder):
        _show(found, quiet)
    interrupts.end(
        found.stopped, f"{found.done} of {_shards(len(plan.jobs))} are in {folder}; --resume {folder} goes on"
    )


def _estimate(plan: "Plan", jobs: "list[Job]") -> str:
    """How much there is to do, and how long one process takes about, from the first frames of a shard."""
    from omni_mj.studies.cost import duration
    from omni_mj.studies.sweep.study import simulation

    trial = simulation(plan, jobs[0])
    started = time.perf_counter()
    for _ in range(min(TRIAL_FRAMES, plan.frames)):
        trial.observe()
        trial.step()
    total_s = (time.perf_counter() - started) * plan.frames / TRIAL_FRAMES * len(jobs)
    runs, controllers = sum(len(job.runs) for job in jobs), len(plan.scenario.controllers)
    what = f"{runs} runs of {controllers} controller{'s' * (controllers > 1)} in {_shards(len(jobs))}"
    return f"{what}: about {duration(total_s)} and {plan.bytes / 1e9:.1f} GB of memory for one process"


def _shards(count: int) -> str:
    return f"{count} shard{'s' * (count > 1)}"


def _show(found: "Sweep", quiet: bool) -> None:
    """Write tables and figures of what is there, and print the table."""
    from omni_mj.show import sensitivity, sweep_figure, sweep_table, tables
    from omni_mj.studies.sweep.sensitivity import indices

    folder, shown = found.folder, None
    if found.plan.design and found.complete:
        lines = indices(found)
        sensitivity.save(found, lines, folder)
        shown = sensitivity.table(found, lines)
    elif found.done and not found.plan.design:
        sweep_table.save(found, folder / "sweep.md")
        sweep_figure.save(found, folder / "sweep.png")
        shown = sweep_table.shown(found)
    if shown and not quiet:
        tables.show(shown)
        print(f"{found.done} of {_shards(len(found.plan.jobs))}; {console.results(folder, OUTPUTS)}")
