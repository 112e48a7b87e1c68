"""Colours of a recording: those of `style`, and paler ones for what a robot is compared with."""

from omni_mj.show import style

Rgb = tuple[int, int, int]
CARPET: Rgb = (33, 66, 45)
LINES: Rgb = (150, 175, 158)
GOALS: Rgb = (190, 190, 190)
REFERENCE: Rgb = (240, 240, 240)


def of(slot: int) -> Rgb:
    """Colour of a controller's slot (`style.slots`); of a wheel of that number where a plot shows one robot alone."""
    return style.rgb(style.colour(slot))


def pale(colour: Rgb, share: float = 0.5) -> Rgb:
    """A colour with a `share` of white."""
    red, green, blue = (round(c + share * (255 - c)) for c in colour)
    return red, green, blue
