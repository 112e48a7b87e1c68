"""`omni-mj film DIR`: a run as a film, drawn without a display."""

import os
import re
import sys
from pathlib import Path

import click

from omni_control.errors import OmniError
from omni_mj.cli import options

VIEWS = ("follow", "whole", "plan")
LEAST, MOST = 64, 4096  # pixels
PANELS = 960, 320  # of a line of panels


@click.command("film")
@click.argument("folder", metavar="DIR", type=click.Path(path_type=Path))
@click.argument("out", metavar="[OUT]", required=False, type=click.Path(path_type=Path))
@click.option("--controller", "controllers", multiple=True, metavar="NAME", help="May be repeated. [all of the run]")
@click.option("--view", type=click.Choice(VIEWS), default="follow", help="The robot, or all of its route. [follow]")
@click.option("--from", "begin_s", type=click.FloatRange(0), default=0.0, metavar="S", help="Where it begins. [0]")
@click.option("--to", "end_s", type=click.FloatRange(0), metavar="S", help="Where it ends. [the run's end]")
@click.option("--speed", type=click.FloatRange(0.01, 100), default=1.0, metavar="X", help="2 is twice as fast. [1]")
@click.option("--rate", type=click.FloatRange(1, 60), default=15.0, metavar="HZ", help="Pictures a second. [15]")
@click.option("--size", metavar="WxH", help="Of a picture, pixels. [960x320, higher for more than four controllers]")
@options.ALLOW_CODE
def command(
    folder: Path,
    out: Path | None,
    controllers: tuple[str, ...],
    view: str,
    begin_s: float,
    end_s: float | None,
    speed: float,
    rate: float,
    size: str | None,
    allow_code: bool,
) -> None:
    """Draw the run in DIR as a film: OUT.gif, .webp, .mp4 or .webm, DIR/film.webp if none is named.

    Panels show each controller's robot with the run's first seed, its path, and as a white ring where it should be.
    It needs no display, but EGL: Debian's libegl1 and libgl1-mesa-dri will do.
    """
    out = out or folder / "film.webp"
    pixels = None if size is None else _pixels(size)
    if sys.platform.startswith("linux"):  # before MuJoCo is imported; elsewhere it draws without a window by itself
        os.environ.setdefault("MUJOCO_GL", "egl")
    import numpy as np

    from omni_mj.show import film

    run = film.Film.of(folder, controllers, allow_code)
    width, height = PANELS
    pixels = pixels or (width, height * run.grid[0])
    end = min(run.duration_s if end_s is None else end_s, run.duration_s)
    if begin_s >= end:
        raise OmniError(f"--from {begin_s:g} must be before the film's end at {end:g} s")
    instants = np.arange(begin_s, end, speed / rate)
    with click.progressbar(run.pictures(instants, view, pixels), len(instants), file=sys.stderr) as pictures:
        film.write(pictures, out, rate)
    print(f"film in {out}: {len(instants) / rate:.1f} s, {out.stat().st_size / 1e6:.1f} MB")


def _pixels(size: str) -> tuple[int, int]:
    found = re.fullmatch(r"(\d{2,4})x(\d{2,4})", size)
    if not found or not all(LEAST <= int(side) <= MOST for side in found.groups()):
        raise OmniError(f"--size must be like 960x320, {LEAST} to {MOST} pixels each way, not {size}")
    width, height = map(int, found.groups())
    return width, height
