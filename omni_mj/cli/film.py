"""`omni-mj film DIR`: a run as a film, drawn without a display."""

import os
import re
import sys
from pathlib import Path

import click

from omni_control.errors import OmniError

VIEWS = ("follow", "plan")


def pixels(context: click.Context, parameter: click.Parameter, size: str) -> tuple[int, int]:
    """Return width and height of a size like 960x320.

    Raises:
        OmniError: It is not like that.
    """
    match = re.fullmatch(r"([1-9]\d{1,3})x([1-9]\d{1,3})", size)
    if not match:
        raise OmniError(
            f"--size must be like {parameter.default}, 10 to 9999 pixels each way, not {size}"
        )
    return int(match[1]), int(match[2])


@click.command("film")
@click.argument("folder", metavar="DIR", type=click.Path(path_type=Path))
@click.argument("out", metavar="[OUT]", required=False, type=click.Path(path_type=Path))
@click.option(
    "--controller",
    "controllers",
    multiple=True,
    metavar="NAME",
    help="May be repeated. [all of the run]",
)
@click.option(
    "--view",
    type=click.Choice(VIEWS),
    default="follow",
    help="The robot, or its route from above. [follow]",
)
@click.option(
    "--from",
    "begin_s",
    type=click.FloatRange(0),
    default=0.0,
    metavar="S",
    help="Where it begins. [0]",
)
@click.option(
    "--to", "end_s", type=click.FloatRange(0), metavar="S", help="Where it ends. [the run's end]"
)
@click.option(
    "--speed",
    type=click.FloatRange(0.01, 100),
    default=1.0,
    metavar="X",
    help="2 is twice as fast. [1]",
)
@click.option(
    "--rate",
    type=click.FloatRange(1, 60),
    default=15.0,
    metavar="HZ",
    help="Pictures a second. [15]",
)
@click.option(
    "--size", default="960x320", callback=pixels, metavar="WxH", help="Of the picture. [960x320]"
)
def command(
    folder: Path,
    out: Path | None,
    controllers: tuple[str, ...],
    view: str,
    begin_s: float,
    end_s: float | None,
    speed: float,
    rate: float,
    size: tuple[int, int],
) -> None:
    """Draw the run in DIR as a film: OUT.gif or .webp, DIR/film.webp if none is named.

    Panels show each controller's robot with the run's first seed, its path, and as a white ring
    where it should be. It needs no display, but EGL: Debian's libegl1 and libgl1-mesa-dri will do.
    """
    out = out or folder / "film.webp"
    if sys.platform.startswith(
        "linux"
    ):  # before MuJoCo is imported; elsewhere it draws without a window by itself
        os.environ.setdefault("MUJOCO_GL", "egl")
    import numpy as np

    from omni_mj.config.settings import PERIOD_S
    from omni_mj.viz import film

    if out.suffix not in film.SUFFIXES:
        raise OmniError(f"{out}: a film's name ends in {', '.join(film.SUFFIXES)}")
    settings, tracks = film.load_tracks(folder, controllers)
    last = PERIOD_S * max(len(track.poses) for track in tracks)
    end = min(last if end_s is None else end_s, last)
    if begin_s >= end:
        raise OmniError(f"--from {begin_s:g} must be before the film's end at {end:g} s")
    instants = np.arange(begin_s, end, speed / rate)
    frames = film.FilmRenderer(settings, tracks, view, size).render(instants)
    with click.progressbar(frames, len(instants), file=sys.stderr) as pictures:
        film.write_film(pictures, out, rate)
    print(f"film in {out}: {len(instants) / rate:.1f} s, {out.stat().st_size / 1e6:.1f} MB")
