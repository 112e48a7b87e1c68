"""What a robot's wheels are called."""

import math
from collections.abc import Iterable

NEAR = 0.1  # sine or cosine below which a wheel is neither before nor behind, left nor right of the middle


def names_of(azimuths: Iterable[float]) -> tuple[str, ...]:
    """A name for each wheel by where it is, as front left; the azimuth too where that alone would not tell them apart.

    Args:
        azimuths: of the wheels about the robot's centre from its front, counter-clockwise, rad.
    """
    given = list(azimuths)
    plain = [_place(azimuth) for azimuth in given]
    return tuple(
        name if plain.count(name) == 1 else f"{name} ({math.degrees(azimuth):.0f}°)"
        for name, azimuth in zip(plain, given, strict=True)
    )


def _place(azimuth: float) -> str:
    along, across = math.cos(azimuth), math.sin(azimuth)
    front = "" if abs(along) < NEAR else "front" if along > 0 else "rear"
    left = "" if abs(across) < NEAR else "left" if across > 0 else "right"
    return " ".join(filter(None, (front, left)))
