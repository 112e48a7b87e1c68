"""`omni-mj sweep`: run a scenario under many settings and seeds, and report failure rates."""

from pathlib import Path

import click

from omni_control.errors import OmniError
from omni_mj.cli import console, options, output_folders, run_command
from omni_mj.cli.interrupts import Interrupts
from omni_mj.io.atomic_files import write_text
from omni_mj.io.printable_text import format_count, join_words

OUTPUTS = (
    "sweep.json",
    "scenario.toml",
    "rows.parquet",
    "summary.json",
    "sweep.md",
    "sweep.png",
    "shards",
    *output_folders.PROVENANCE,
)


@click.command("sweep")
@options.SCENARIO
@click.option(
    "--vary",
    "axes",
    multiple=True,
    metavar="SECTION.FIELD=VALUES",
    help="Setting and its values: LOW:HIGH:N for N values, or A,B,C; may be repeated.",
)
@options.CONTROLLER
@options.scenario_options
@options.SEED
@options.SEEDS
@click.option(
    "--batch-size",
    type=int,
    default=128,
    metavar="N",
    help="Largest number of robots simulated together; more need more memory. Default: 128.",
)
@click.option(
    "--jobs", type=int, default=1, metavar="N", help="Processes on this machine. Default: 1."
)
@click.option(
    "--cluster",
    metavar="tcp://HOST:PORT",
    help="Scheduler of a Dask cluster that runs the sweep. Default: this machine.",
)
@click.option(
    "--out",
    type=options.FOLDER,
    metavar="DIR",
    help="Folder of the results, or of a sweep to resume. Default: runs/sweep-<UTC time>.",
)
@options.ALLOW_CODE
@options.QUIET
def sweep_command(
    scenario_options: options.ScenarioOptions,
    name: str | None,
    axes: tuple[str, ...],
    batch_size: int,
    out: Path | None,
    quiet: bool,
    jobs: int,
    cluster: str | None,
) -> None:
    """Run a scenario under all combinations of settings.

    Prints and draws failure rates and errors with confidence intervals. To resume a sweep that was
    stopped or killed, repeat its command with its folder as --out. Settings can be random: --set
    carpet.friction='{uniform = [0.4, 0.9]}' draws a value for each seed.
    """
    from omni_mj.studies.sweep import sweep_figure, sweep_statistics, sweep_study, workers
    from omni_mj.studies.sweep.sweep_plan import SWEEP_FILE, SweepPlan, check_axes, parse_axis

    scenario = scenario_options.load_scenario(run_command.require_scenario(name))
    plan = SweepPlan(scenario, check_axes(map(parse_axis, axes)), batch_size)
    plan.check(jobs)  # before the folder is created
    if cluster and jobs > 1:
        raise OmniError("--jobs are processes on this machine; it cannot be used with --cluster")
    context = click.get_current_context()
    executor = context.with_resource(workers.cluster(cluster)) if cluster else None
    if out is None or not (out / SWEEP_FILE).exists():
        out = output_folders.prepare_folder(out, "sweep", OUTPUTS, overwrite=False)
    else:
        output_folders.reserve_folder(out)
    with (
        console.report_write_errors(out),
        Interrupts() as interrupts,
        console.show_progress(quiet, interrupts.check) as start_progress,
    ):
        result = sweep_study.run_sweep(
            plan,
            out,
            command=console.get_command_line(),
            jobs=jobs,
            executor=executor,
            start_progress=start_progress,
        )
    progress_text = f"{result.n_done} of {format_count(len(plan.shards), 'shard')}"
    with console.report_write_errors(out):
        if result.n_done:
            table = sweep_statistics.format_sweep_markdown(plan, result.summary)
            write_text(out / "sweep.md", table)
            sweep_figure.save_sweep_figure(result, out / "sweep.png")
            if not quiet:
                print(sweep_statistics.format_sweep_tables(plan, result.summary))
                print(f"repeat the worst run: {result.summary['worst'][0]['repeat_command']}")
                print(f"{progress_text} done; {console.describe_outputs(out, OUTPUTS)}")
    interrupts.exit_if_stopped(
        result.stopped,
        f"{progress_text} are in {out}; to resume, repeat with --out {join_words([str(out)])}",
    )
