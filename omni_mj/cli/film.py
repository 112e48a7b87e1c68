"""`omni-mj film`: render a run as a film, without a display."""

import os
import re
import sys
from pathlib import Path

import click

from omni_control.errors import OmniError
from omni_mj.cli import options

VIEWS = ("follow", "plan")


def parse_size(context: click.Context, parameter: click.Parameter, size: str) -> tuple[int, int]:
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
    callback=parse_size,
    metavar="WxH",
    help="Width and height, pixels. Default: 960x320.",
)
def command(
    folder: Path,
    out: Path | None,
    controllers: tuple[str, ...],
    view: str,
    start_s: float,
    end_s: float | None,
    speed: float,
    fps: float,
    size: tuple[int, int],
) -> None:
    """Render the run in DIR as a film: OUT.gif or OUT.webp. Default: DIR/film.webp.

    Panels show each controller's robot with the run's first seed and its path. A white ring marks
    the reference. No display is needed, but EGL is: Debian's libegl1 and libgl1-mesa-dri suffice.
    """
    out = out or folder / "film.webp"
    # Must be set before MuJoCo is imported. Other systems render without a window by default.
    if sys.platform.startswith("linux"):
        os.environ.setdefault("MUJOCO_GL", "egl")
    import numpy as np

    from omni_mj.config.settings import PERIOD_S
    from omni_mj.viz import film

    if out.suffix not in film.SUFFIXES:
        raise OmniError(f"the name of a film must end in {', '.join(film.SUFFIXES)}, got {out}")
    settings, tracks = film.load_tracks(folder, controllers)
    run_end_s = PERIOD_S * max(len(trajectory.poses) for trajectory in tracks)
    film_end_s = min(run_end_s if end_s is None else end_s, run_end_s)
    if start_s >= film_end_s:
        raise OmniError(f"--from {start_s:g} must be before the film's end at {film_end_s:g} s")
    times_s = np.arange(start_s, film_end_s, speed / fps)
    renderer = film.FilmRenderer(settings, tracks, view, size)
    with click.progressbar(renderer.render(times_s), len(times_s), file=sys.stderr) as images:
        film.write_film(images, out, fps)
    print(f"film in {out}: {len(times_s) / fps:.1f} s, {out.stat().st_size / 1e6:.1f} MB")
