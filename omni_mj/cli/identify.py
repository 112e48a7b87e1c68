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
    help="Which to start from. [tigers-v2016]",
)
@options.MODEL
@click.option("--plan", "only_plan", is_flag=True, help="Write a scenario of moves to drive; takes no logs.")
@click.option("--out", type=options.FOLDER, metavar="DIR", help="[runs/identify-<UTC time>]")
@options.OVERWRITE
@options.QUIET
def command(
    logs: tuple[Path, ...],
    robot: str | None,
    model: str | None,
    only_plan: bool,
    out: Path | None,
    overwrite: bool,
    quiet: bool,
) -> None:
    """Identify a robot from logs: CSV or Parquet with named columns (docs/identify.md)."""
    from omni_mj.files import write
    from omni_mj.provenance import record
    from omni_mj.scenarios.robots import DEFAULT
    from omni_mj.studies import identify
    from omni_mj.studies.identify.logs import read

    chosen = robot or DEFAULT
    if bool(logs) == only_plan:
        raise OmniError("name at least one log, .csv or .parquet; or --plan, for what to drive")
    if only_plan:
        moves = identify.plan(chosen, model)
        folder = folders.prepare(out, "identify", OUTPUTS, overwrite)
        with console.writing(folder):
            write(folder / "plan.toml", moves.to_toml())
        if not quiet:
            print(f"moves on 2 x 2 m of carpet; drive them here: omni-mj --scenario {folder / 'plan.toml'}")
        return
    start = identify.start_scenario(chosen, model)
    result = identify.identify_logs([log for word in logs for log in read(word)], start)
    folder = folders.prepare(out, "identify", OUTPUTS, overwrite)
    with console.writing(folder):
        result.save(folder)
        record.save(folder, "identify", console.command_line(), [start], frames=False)
    if not quiet:
        print(result.table())
        print(console.results(folder, OUTPUTS[:2]))
