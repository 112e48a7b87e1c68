"""Colours shared by figures and recordings: Okabe and Ito's, distinct to the colour-blind and in grey."""

REFERENCE = "#7F7F7F"
CONTROLLERS = ("#D55E00", "#0072B2", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#F0E442")
AXES = ("#D55E00", "#0072B2", "#009E73", "#CC79A7")


def controller(index: int) -> str:
    """Colour of a run's index-th controller."""
    return CONTROLLERS[index % len(CONTROLLERS)]


def rgb(colour: str) -> tuple[int, int, int]:
    """A colour like #D55E00 as three bytes."""
    return int(colour[1:3], 16), int(colour[3:5], 16), int(colour[5:7], 16)
