"""Whether numbers of a log can be in the units that its columns' names say."""

from typing import TYPE_CHECKING

import numpy as np

from omni_control.errors import OmniError
from omni_control.kinematics import Array

if TYPE_CHECKING:
    from omni_mj.studies.identify.logs import Log

SHORTEST_S, LONGEST_S = 5e-4, 0.5  # from line to line
FARTHEST_M = 1e5  # of a position, in whatever frame of the surroundings
CLOCKS = {"ms": 1e-3, "us": 1e-6, "ns": 1e-9, "minutes": 60.0}


def check(log: "Log", least: int) -> None:
    """Raise where numbers cannot be in the units that the columns' names say.

    Args:
        log: as read.
        least: how many lines with a pose there must be.

    Raises:
        OmniError: they cannot; a line says which units it may be.
    """
    seen = np.isfinite(log.pose).all(1)
    if seen.sum() < least:
        raise OmniError(f"{log.name}: {seen.sum()} lines with a pose are too few; at least {least}")
    if not SHORTEST_S <= log.period <= LONGEST_S:
        fits = [unit for unit, size in CLOCKS.items() if SHORTEST_S <= log.period * size <= LONGEST_S]
        unit = fits[0] if fits else "another unit than s"
        unit += ", or of frames" * (log.period == 1)
        raise OmniError(f"{log.name}: {log.period:g} s from line to line; is time_s in {unit}?")
    far: Array = np.where(seen, np.abs(log.pose[:, :2]).max(1), 0.0)
    if far.max() > FARTHEST_M:
        raise OmniError(
            f"{log.name}: a position of {far.max():.4g} m in line {int(far.argmax()) + 1} is off any field; are x_m "
            "and y_m in mm?"
        )
    heading, steps = log.pose[seen, 2], np.diff(log.time[seen])
    jumps = np.abs(np.diff(heading))
    turned = np.minimum(jumps, np.abs(jumps - 2 * np.pi))  # a robot that faces backwards goes from pi to -pi
    if np.abs(heading[0]) > 2.1 * np.pi or (np.abs(jumps - 360) < 20).any() or _fast(turned / steps, 45):
        raise OmniError(f"{log.name}: headings of up to {np.abs(heading).max():.0f} rad; is heading_rad in degrees?")
    moved = np.hypot(*np.diff(log.pose[seen, :2], axis=0).T) / steps
    if _fast(moved, 10):
        fast = np.quantile(moved, 0.95)
        unit = "mm" if fast > 400 else "cm or mm"
        raise OmniError(f"{log.name}: speeds of {fast:.0f} m/s; are x_m and y_m in {unit}?")
    if log.command is None:
        return
    if not np.isfinite(log.command).all():
        raise OmniError(f"{log.name}: commands are missing in line {np.argmin(np.isfinite(log.command).all(1)) + 1}")
    if _fast(np.hypot(*log.command[:, :2].T), 10):
        fast = np.abs(log.command[:, :2]).max()
        raise OmniError(f"{log.name}: commands of {fast:.0f} m/s; are they in cm/s or mm/s?")
    if _fast(np.abs(log.command[:, 2]), 60):
        raise OmniError(
            f"{log.name}: turn rates of {np.abs(log.command[:, 2]).max():.0f} rad/s; are they in degrees/s?"
        )


def _fast(values: Array, limit: float) -> bool:
    """Whether more than one in twenty is above a limit: single jumps are not a matter of units."""
    return bool(np.quantile(values, 0.95) > limit)
