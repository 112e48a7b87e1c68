"""Whether inputs and measured motion are of the same axes, and how late motion follows: a first look, by regression.

With velocities of the body as complex numbers, motion that follows inputs u is a u + b conj(u): a turns and stretches,
b mirrors. Axes that are right give a near 1 and b near 0.
"""

from dataclasses import dataclass

import numpy as np

from omni_control.errors import OmniError
from omni_control.kinematics import Array
from omni_mj.studies.identify.logs import Log

SMOOTHED = np.array([1.0, 2.0, 3.0, 2.0, 1.0]) / 9
TURNED_RAD = 0.5  # from which axes are taken for wrong
MOVES_M_S, TURNS_RAD_S = 0.05, 0.2  # root mean square, below which nothing is looked at
LATEST_S = 0.5
ONE_LINE = 0.04  # mean square across a line over that along it, below which inputs keep to it
SIZES = {"wheels": (0.5, 2.0), "commands": (0.25, 2.5)}  # of motion over inputs, beyond which units are others
FOLLOWS = 0.3  # share of the motion's variance below which inputs are not what moved the robot


@dataclass(frozen=True)
class Look:
    """A first look.

    Attributes:
        delay: after which inputs fit best, s.
        follows: share of the motion's variance that they then explain.
        turning: rad/s of turn rate per rad/s of input; not a number where nothing turns.
    """

    delay: float
    follows: float
    turning: float


def look(log: Log, inputs: Array, in_body: bool, what: str, earliest: float = 0.0) -> Look:
    """Look at inputs (F, 3) of a log and what came of them.

    Args:
        log: of the motion.
        inputs: twists that act until the next line.
        in_body: whether along the body's axes.
        what: they are, for messages: commands or wheels.
        earliest: delay that is tried, s; below 0 for clocks that differ.

    Raises:
        OmniError: axes are swapped, mirrored or turned, or in another frame; or motion does not follow at all.
    """
    seen = np.flatnonzero(np.isfinite(log.pose).all(1))
    time, pose = log.time[seen], log.pose[seen]
    step = np.diff(time)
    middle, heading = (time[1:] + time[:-1]) / 2, (pose[1:, 2] + pose[:-1, 2]) / 2
    twist = np.stack([_smooth(column) for column in (np.diff(pose, axis=0) / step[:, None]).T], 1)
    ahead = np.exp(1j * heading)
    motion = (twist[:, 0] + 1j * twist[:, 1]) * ahead.conj()
    said, rate = inputs[:, 0] + 1j * inputs[:, 1], inputs[:, 2]
    turning, late = float("nan"), 0.0
    delays = np.arange(earliest, LATEST_S, max(log.period / 2, 1 / 120))

    def at(delay: float) -> np.ndarray:
        return np.clip(np.searchsorted(log.time, middle - delay, side="right") - 1, 0, len(log.time) - 1)

    if np.sqrt((rate**2).mean()) > TURNS_RAD_S:
        fits = [_real(_smooth(rate[at(delay)]), twist[:, 2]) for delay in delays]
        late, (turning, _) = delays[int(np.argmax([share for _, share in fits]))], max(fits, key=lambda f: f[1])
        if turning < 0:
            raise OmniError(f"{log.name}: headings turn against the turn rate of the {what}; is one clockwise?")
        if turning > 15:
            raise OmniError(
                f"{log.name}: headings turn {turning:.0f} times what the {what} say; is heading_rad in degrees?"
            )
    if np.sqrt((np.abs(said) ** 2).mean()) < MOVES_M_S:
        return Look(float(late), float("nan"), turning)

    def best(body: bool, mirrored: bool = False) -> tuple[float, float, complex, complex]:
        world = motion * ahead
        moved = world.conj() if mirrored else world
        moved = moved * ahead.conj() if body else moved  # in the axes that inputs are said to be in
        tried = [(*_complex(_smooth(said[at(delay)]), moved), float(delay)) for delay in delays]
        a, b, share, delay = max(tried, key=lambda t: t[2])
        return delay, share, a, b

    delay, share, a, b = best(in_body)
    other = best(not in_body)
    if in_body:  # such axes turn in the field's, in which poses may be mirrored
        _, of_mirrored, mirror, _ = best(True, mirrored=True)
        if of_mirrored > max(share, other[1]) + 0.1 and of_mirrored > 0.6:
            raise OmniError(f"{log.name}: of pose and {what} one has other axes: {_kind(mirror.conjugate())}")
    if other[1] > share + 0.1 and other[1] > 0.6 and abs(np.angle(other[2])) < TURNED_RAD:
        right, wrong = ("field's", "robot's") if in_body else ("robot's", "field's")
        raise OmniError(
            f"{log.name}: the {what} explain {100 * other[1]:.0f} % of the motion along the {right} axes, "
            f"{100 * max(share, 0):.0f} % along the {wrong}, as said; name their columns for the {right} axes"
        )
    if share < FOLLOWS:
        raise OmniError(
            f"{log.name}: the {what} explain {100 * max(share, 0):.0f} % of the motion at any delay up to "
            f"{LATEST_S:g} s; are they this robot's?"
        )
    if abs(b) > abs(a):
        order = "; or are wheels in another order than the file's?" if what == "wheels" else ""
        raise OmniError(f"{log.name}: of pose and {what} one has other axes: {_kind(b)}{order}")
    if abs(np.angle(a)) > TURNED_RAD:
        raise OmniError(
            f"{log.name}: motion is turned by {np.degrees(np.angle(a)):.0f} degrees from the {what}; "
            "x is forward, y to the left, heading counter-clockwise"
        )
    least, most = SIZES[what]
    if not least < abs(a) < most:
        units = "are wheels behind the gear, in rad, of this radius?" if what == "wheels" else "are these in m/s?"
        raise OmniError(
            f"{log.name}: the robot goes {abs(a):.2g} times as far as the {what} say; are x_m and y_m in m, and {units}"
        )
    return Look(delay, share, turning)


def _kind(mirror: complex) -> str:
    """What makes motion `mirror` times the conjugate of inputs."""
    turn = round(float(np.angle(mirror)) / (np.pi / 2))
    return ("y is mirrored", "x and y are swapped", "x is mirrored", "x and y are swapped")[turn]


def _smooth(values: np.ndarray) -> np.ndarray:
    return np.convolve(np.pad(values, 2, "edge"), SMOOTHED, "valid")


def _real(u: Array, v: Array) -> tuple[float, float]:
    gain = float((u * v).sum() / max((u * u).sum(), 1e-12))
    return gain, 1 - float(((v - gain * u) ** 2).sum() / max((v**2).sum(), 1e-12))


def _complex(u: np.ndarray, v: np.ndarray) -> tuple[complex, complex, float]:
    """a, b, and the share of v that a u + b conj(u) explains; b = 0 where motion along one line cannot tell them."""
    power, mirror = float((np.abs(u) ** 2).sum()), complex((u * u).sum())
    along, across = complex((u.conj() * v).sum()), complex((u * v).sum())  # of v
    first, second = along / max(power, 1e-12), 0j
    if power - abs(mirror) > ONE_LINE * (power + abs(mirror)):  # normal equations; else u keeps to one line
        size = power**2 - abs(mirror) ** 2
        first = (power * along - mirror.conjugate() * across) / size
        second = (power * across - mirror * along) / size
    left = v - first * u - second * u.conj()
    share = 1 - float((np.abs(left) ** 2).sum() / max((np.abs(v) ** 2).sum(), 1e-12))
    return first, second, share
