"""`omni-mj verify DIR`: whether a run gives the same again, here."""

from pathlib import Path

import click

from omni_mj.cli import console, options


@click.command("verify")
@click.argument("folder", metavar="DIR", type=options.FOLDER)
@options.QUIET
def command(folder: Path, quiet: bool) -> None:
    """Run again what a folder holds, wherever it is now, and compare bit for bit."""
    from omni_mj.results import verify

    with console.progress(quiet) as begin:
        found = verify.verify(
            folder, lambda title, count: console.checked(lambda: None, begin(title, count))
        )
    if not found.repeats:
        console.fail(f"{folder} {found}", console.FAILED)
    if not quiet:
        print(found)
