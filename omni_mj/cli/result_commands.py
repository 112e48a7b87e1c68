"""`omni-mj report` and `omni-mj verify`: the report about runs, and the repetition of a run."""

from pathlib import Path

import click

from omni_control.errors import OmniError
from omni_mj.cli import console, options


@click.command("report")
@click.argument("folders", metavar="DIR...", nargs=-1, type=options.FOLDER)
@click.option(
    "--out",
    type=options.FOLDER,
    metavar="FILE.html",
    help="File of the report. Default: DIR/report.html; for several folders, comparison.html.",
)
def report_command(folders: tuple[Path, ...], out: Path | None) -> None:
    """Write a report about a run, or one that compares several runs."""
    if not folders:
        raise OmniError("report needs the folder of at least one run: omni-mj report runs/NAME...")
    if out is None:
        out = folders[0] / "report.html" if len(folders) == 1 else Path("comparison.html")
    if out.suffix.lower() not in (".html", ".htm"):
        raise OmniError(f"--out {out} must be a file whose name ends in .html")
    from omni_mj.viz import report

    try:
        report.write_report(folders, out)
    except OSError as error:
        raise OmniError(f"cannot write --out {out}: {error.strerror}") from None
    print(f"report in {out}")


@click.command("verify")
@click.argument("folder", metavar="DIR", type=options.FOLDER)
@options.QUIET
def verify_command(folder: Path, quiet: bool) -> None:
    """Repeat the run in a folder, and compare the results bit for bit."""
    from omni_mj.results import verify

    with console.show_progress(quiet) as start_progress:
        result = verify.verify(
            folder,
            lambda title, n_frames: console.make_frame_callback(
                lambda: None, start_progress(title, n_frames)
            ),
        )
    if not result.repeats:
        console.exit_with_error(f"{folder} {result}", console.FAILED)
    if not quiet:
        print(result)
