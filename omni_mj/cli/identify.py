"""`omni-mj identify`: a robot's numbers from its logs; and what to drive for them."""

from pathlib import Path

import click

from omni_control.errors import OmniError
from omni_mj.cli import console, folders, options

OUTPUTS = ("identify.json", "robot.toml", "plan.toml", *folders.PROVENANCE)


@click.command("identify")
@click.argument("logs", metavar="LOG...", nargs=-1, type=click.Path(path_type=Path))
@click.option(
    "--robot",
    metavar="NAME|FILE.toml",
    shell_complete=options.complete("robots"),
    help="Which to start from. [tigers-v2016]",
)
@options.MODEL
@click.option("--team", type=click.Choice(["yellow", "blue"]), help="Whose robot it is, in game logs.")
@click.option("--id", "number", type=click.IntRange(0, 15), help="Its number, in game logs.")
@click.option("--plan", "only_plan", is_flag=True, help="Write a scenario of moves to drive, and print them.")
@click.option(
    "--out",
    type=options.FOLDER,
    metavar="DIR|FILE.toml",
    help="A folder, or the robot's file and a folder beside it. [runs/...]",
)
@options.OVERWRITE
@options.QUIET
def command(
    logs: tuple[Path, ...],
    robot: str | None,
    model: str | None,
    team: str | None,
    number: int | None,
    only_plan: bool,
    out: Path | None,
    overwrite: bool,
    quiet: bool,
) -> None:
    """Identify a robot from logs: CSV or Parquet with named columns, or game logs (docs/identify.md)."""
    from omni_mj.scenarios.robots import DEFAULT

    chosen = robot or DEFAULT
    if only_plan:
        if logs:
            raise OmniError("--plan writes what to drive and takes no logs; give one of both")
        from omni_mj.files import write
        from omni_mj.studies.identify.plan import plan

        moves = plan(chosen, model)
        folder = folders.prepare(out, "identify", OUTPUTS, overwrite)
        with console.writing(folder):
            write(folder / "plan.toml", moves.scenario.to_toml())
        if not quiet:
            print(moves.table())
            print(f"drive it here: omni-mj --scenario {folder / 'plan.toml'}")
        return
    if not logs:
        raise OmniError("name at least one log, .csv, .parquet, .log or .log.gz; or --plan, for what to drive")
    from omni_mj.provenance import record
    from omni_mj.studies.identify.logs import of_robot, read
    from omni_mj.studies.identify.study import of_logs, started

    words, start = [of_robot(log, team, number) for log in logs], started(chosen, model)
    options.tell_model(start, quiet)
    file = out if out is not None and out.suffix == ".toml" and not out.is_dir() else None
    if file and file.exists() and not overwrite:
        raise OmniError(f"--out {file} is there; give another file, or --overwrite to replace it")
    found = of_logs([log for word in words for log in read(word)], start)
    folder = folders.prepare(file.with_suffix("") if file else out, "identify", OUTPUTS, overwrite)
    with console.writing(folder):
        found.save(folder, file)
        record.save(folder, "identify", console.command_line(), [start], frames=False)
    if not quiet:
        print(found.table())
        print(f"results in {folder}/ (identify.json, robot.toml)" + f", the robot in {file}" * (file is not None))
