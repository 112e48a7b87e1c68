"""`omni-mj identify`: a robot's numbers from its logs."""

from pathlib import Path

import click

from omni_mj.cli import console, folders, options

OUTPUTS = ("identify.json", "robot.toml", *folders.PROVENANCE)


@click.command("identify")
@click.argument("logs", metavar="LOG...", nargs=-1, required=True, type=click.Path(path_type=Path))
@click.option(
    "--robot",
    metavar="NAME|FILE.toml",
    help="Which to start from. [tigers-v2016]",
)
@options.MODEL
@click.option("--out", type=options.FOLDER, metavar="DIR", help="[runs/identify-<UTC time>]")
@options.OVERWRITE
@options.QUIET
def command(
    logs: tuple[Path, ...],
    robot: str | None,
    model: str | None,
    out: Path | None,
    overwrite: bool,
    quiet: bool,
) -> None:
    """Identify a robot from logs: CSV or Parquet with named columns (docs/identify.md).

    The scenario identify has moves to drive for them.
    """
    from omni_mj.provenance import record
    from omni_mj.scenarios.robots import DEFAULT
    from omni_mj.studies.identify import identify

    result = identify(logs, robot or DEFAULT, model)
    folder = folders.prepare(out, "identify", OUTPUTS, overwrite)
    with console.writing(folder):
        result.save(folder)
        record.save(folder, "identify", console.command_line(), [result.start], frames=False)
    if not quiet:
        print(result.table())
        print(console.results(folder, OUTPUTS[:2]))
