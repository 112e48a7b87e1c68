"""`omni-mj report DIR...`: one HTML file about a run, or several."""

from pathlib import Path

import click

from omni_control.errors import OmniError


@click.command("report")
@click.argument("folders", metavar="DIR...", nargs=-1, type=click.Path(path_type=Path))
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    metavar="FILE.html",
    help="[DIR/report.html or comparison.html]",
)
def command(folders: tuple[Path, ...], out: Path | None) -> None:
    """Write a report about a run, or one that compares several."""
    if not folders:
        raise OmniError("report needs the folder of a run, or several: omni-mj report runs/NAME...")
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
