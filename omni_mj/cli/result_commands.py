"""`omni-mj report`, `film`, `screenshot`, `verify`: commands for the results of earlier runs."""

import re
import sys
from pathlib import Path
from typing import Any

import click

from omni_control.errors import OmniError
from omni_mj.cli import console, options

VIEWS = ("follow", "plan")  # of a film


def _parse_size(context: click.Context, parameter: click.Parameter, size: str) -> tuple[int, int]:
    """Return width and height in pixels from an option such as 960x320.

    Raises:
        OmniError: The value is not two numbers of 10 to 9999 with an x between them.
    """
    match = re.fullmatch(r"([1-9]\d{1,3})x([1-9]\d{1,3})", size)
    if not match:
        raise OmniError(
            f"--size must be WIDTHxHEIGHT with 10 to 9999 pixels each, such as "
            f"{parameter.default}, got {size}"
        )
    return int(match[1]), int(match[2])


@click.command("report")
@click.argument("folders", metavar="DIR...", nargs=-1, required=True, type=options.FOLDER)
@click.option(
    "--out",
    type=options.FOLDER,
    metavar="FILE.html",
    help="File of the report. Default: DIR/report.html; for several folders, comparison.html.",
)
def report_command(folders: tuple[Path, ...], out: Path | None) -> None:
    """Write a report about a run, or one that compares several runs."""
    if out is None:
        out = folders[0] / "report.html" if len(folders) == 1 else Path("comparison.html")
    if out.suffix != ".html":
        raise OmniError(f"--out {out} must be a file whose name ends in .html")
    from omni_mj.report import html_report

    html_report.write_report(folders, out)
    print(f"report in {out}")


@click.command("film")
@click.argument("folder", metavar="DIR", type=options.FOLDER)
@click.argument("out", metavar="[OUT]", required=False, type=options.FOLDER)
@click.option(
    "--controller",
    "controllers",
    multiple=True,
    metavar="NAME",
    help="Controller to show; may be repeated. Default: all of the run.",
)
@click.option(
    "--view",
    type=click.Choice(VIEWS),
    default="follow",
    help="Camera: one that follows the robot, or one above the whole path. Default: follow.",
)
@click.option(
    "--from",
    "start_s",
    type=click.FloatRange(0),
    default=0.0,
    metavar="S",
    help="Simulated time at which the film starts, s. Default: 0.",
)
@click.option(
    "--to",
    "end_s",
    type=click.FloatRange(0),
    metavar="S",
    help="Simulated time at which the film ends, s. Default: the end of the run.",
)
@click.option(
    "--speed",
    type=click.FloatRange(0.01, 100),
    default=1.0,
    metavar="X",
    help="Playback speed; 2 is twice as fast. Default: 1.",
)
@click.option(
    "--fps",
    type=click.FloatRange(1, 60),
    default=15.0,
    metavar="HZ",
    help="Images per second of the film. Default: 15.",
)
@click.option(
    "--size",
    default="960x320",
    callback=_parse_size,
    metavar="WxH",
    help="Width and height, pixels. Default: 960x320.",
)
def film_command(
    folder: Path,
    out: Path | None,
    controllers: tuple[str, ...],
    start_s: float,
    end_s: float | None,
    speed: float,
    fps: float,
    **view_and_size: Any,
) -> None:
    """Render the run in DIR as a film: OUT.gif or OUT.webp. Default: DIR/film.webp.

    Panels show each controller's robot with the run's first seed and its path. A white ring marks
    the reference. No display is needed, but EGL is: Debian's libegl1 and libgl1-mesa-dri suffice.
    """
    out = out or folder / "film.webp"
    import numpy as np

    from omni_mj.config import PERIOD_S
    from omni_mj.viz import film

    if out.suffix not in film.SUFFIXES:
        raise OmniError(f"the name of a film must end in {', '.join(film.SUFFIXES)}, got {out}")
    settings, tracks = film.load_tracks(folder, controllers)
    run_end_s = PERIOD_S * max(len(track.poses) for track in tracks)
    film_end_s = min(run_end_s if end_s is None else end_s, run_end_s)
    if start_s >= film_end_s:
        raise OmniError(f"--from {start_s:g} must be before the film's end at {film_end_s:g} s")
    times_s = np.arange(start_s, film_end_s, speed / fps)
    renderer = film.FilmRenderer(settings, tracks, **view_and_size)
    with click.progressbar(renderer.render(times_s), len(times_s), file=sys.stderr) as images:
        film.write_film(images, out, fps)
    print(f"film in {out}: {len(times_s) / fps:.1f} s, {out.stat().st_size / 1e6:.1f} MB")


@click.command("screenshot")
@click.argument("recording", type=click.Path(exists=True, dir_okay=False, path_type=Path))
@click.argument("out", type=options.FOLDER)
@click.option(
    "--time",
    "time_s",
    default=0.0,
    metavar="S",
    help="Simulated time to show, s. Default: 0.",
)
@click.option(
    "--tab",
    "tabs",
    multiple=True,
    metavar="NAME",
    help="Tab to open, such as wheels; may be repeated. Default: those of the recording.",
)
@click.option(
    "--size",
    default="1600x900",
    callback=_parse_size,
    metavar="WxH",
    help="Width and height of the window, pixels. Default: 1600x900.",
)
def screenshot_command(
    recording: Path, out: Path, time_s: float, tabs: tuple[str, ...], size: tuple[int, int]
) -> None:
    """Save how the rerun viewer shows RECORDING.rrd as OUT.png.

    No display is needed, but a Vulkan driver is: Debian's mesa-vulkan-drivers suffices.
    """
    from omni_mj.viz.recording import viewer

    viewer.save_screenshot(recording, out, size, time_s, tabs)


@click.command("verify")
@click.argument("folder", metavar="DIR", type=options.FOLDER)
@click.option(
    "--allow-code",
    is_flag=True,
    help="Allow the folder's copies of controllers and plants to be run.",
)
@options.QUIET
def verify_command(folder: Path, allow_code: bool, quiet: bool) -> None:
    """Repeat the run or sweep in a folder, and compare the results bit for bit."""
    from omni_mj.studies import verify_run

    with console.show_progress(quiet) as start_progress:
        result = verify_run.verify(folder, start_progress, allow_code)
    if not result.repeats:
        console.exit_with_error(f"{folder} {result}", console.FAILED)
    if not quiet:
        print(result)
