r"""How a robot on wheels that creep answers to the velocities that it is commanded: the law, a step of it, its inverse.

Per axis i of the body (forward, to the left), with u the command that acts, in the body's axes, and v the velocity:

    (tau_i + g_i^2 T_i |v|) v'_i = u_i + b_i - c_i n_i - g_i v_i

g = 1 / alpha   command per speed, the inverse of the motor correction factor: drag must be pulled, and pulling creeps
T               creep: rubber that pulls slides in proportion to its travel. In the convention of those who measured it
                on robots, v = u / g - T |u| v', in s^2/m (TIGERs Mannheim: 0.04 to 0.06 forward, 0.08 to 0.16 sideways)
tau             lag of the wheel loops, s
c               speed that dry friction costs, m/s, against the direction of motion n
b               whatever else pushes, as a velocity: a slope, a push, a wheel that is weak

The robot turns commands into its body by its own compass, which differs by an angle delta from the heading that vision
sees: u arrives turned by -delta. A command acts `latency` frames after it was sent.

Wheels share a force more easily forward than sideways: with direction cosines d_k of the wheels' drive along an axis,
creep, lag, and what drag costs through the lag, are in proportion to 1 / sum d_k^2.

Vectors of the plane are complex numbers here, x + iy; components along the body's axes are pairs.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from omni_control.kinematics import Array, Kinematics, Number

Plane = NDArray[np.complex128]

NAMES = ("compass", "effort", "effort", "creep", "creep", "friction", "latency", "lag")
COMPASS, EFFORT, CREEP, FRICTION, LATENCY, LAG = 0, slice(1, 3), slice(3, 5), slice(5, 6), 6, slice(7, 8)
COUNT = len(NAMES)

RUBBED_M_S = 0.05  # speed from which dry friction is all there
STARTING_M_S = 0.01  # same, of a motion that is asked for: it must be overcome before there is any
_ONE = np.ones(())  # numpy would have to convert Python's in each step


def pairs(vector: Plane) -> Array:
    """Vectors (...) as pairs of components (..., 2)."""
    return vector[..., None].view(float)


def plane(components: Array) -> Plane:
    """Pairs of components (..., 2), one beside the other in memory, as vectors (...)."""
    return components.view(complex)[..., 0]


class Step(NamedTuple):
    """What n robots do in a time with a command, in the axes of the body that they have in the middle of it.

    Attributes:
        before: velocity at the beginning, (n, 2), m/s.
        moved: displacement (n, 2), m.
        velocity: at the end, (n, 2), m/s.
        decay: of a velocity, to its share at the end (n, 2).
        carried: way made of a velocity in that decay, (n, 2), s.
        rubbing: what dry friction of 1 costs, along the direction in which it acts, (n, 2).
    """

    before: Array
    moved: Array
    velocity: Array
    decay: Array
    carried: Array
    rubbing: Array


class Motion:
    """The law for n robots, each with parameters of its own.

    Args:
        parameters: (n, 8), in the order of `NAMES`: compass error in rad; effort g, forward and sideways; creep T the
            same, s^2/m; friction c, forward, m/s; latency beyond what is known, frames; lag tau, forward, s.
        geometry: of the wheels; None: that of most robots of the league.

    Attributes:
        effort: command per speed g, forward and sideways, (n, 2).
        lags: tau of the wheel loops, the same, s.
    """

    def __init__(self, parameters: Array, geometry: Kinematics | None = None) -> None:
        self._gives = np.array([1.0, softness(geometry)])
        self.parameters = parameters

    @property
    def parameters(self) -> Array:
        """As given."""
        return self._parameters

    @parameters.setter
    def parameters(self, parameters: Array) -> None:
        self._parameters, self.effort = parameters, parameters[:, EFFORT]
        self.lags = parameters[:, LAG] * self._gives
        self._still, self._slower = self.lags / self.effort, self.effort * parameters[:, CREEP]
        self._rubbed = parameters[:, FRICTION] * self._gives / self.effort  # of the speed, at most

    def late(self, speed: Array) -> Array:
        """Time constants of robots (n, 2) that drive at `speed` (..., n), axes before as that: tau / g + g T |v|, s."""
        return self._still + self._slower * speed[..., None]

    def step(self, velocity: Plane, command: Plane, heading: Plane, duration: float | Array) -> Step:
        """Go on for a while.

        Args:
            velocity: (n,) m/s, world frame.
            command: the one that acts, (n,) m/s, world frame, as sent; what else pushes is added to it.
            heading: unit vectors (n,), in the middle of the step.
            duration: s, one or (n, 1).
        """
        back = heading.conj()
        before, towards = pairs(velocity * back), pairs(command * back) / self.effort
        late = self.late(np.abs(velocity))
        decay = np.exp(-duration / late)
        rest = 1 - decay
        along = _along(before + rest * (towards - before), rest * self._rubbed)
        final = towards - self._rubbed * along
        excess, carried = before - final, rest * late
        moved = duration * final + excess * carried
        return Step(before, moved, final + excess * decay, decay, carried, self._gives * along)

    def follow(self, velocity: Plane, commands: Plane, headings: Plane, durations: Array) -> tuple[Plane, Plane]:
        """Displacements and velocities (n,), world frame, after one command and its duration after another.

        As by `step` after `step`, but all that does not depend on velocities is done for all steps at once. Commands
        that act for no time change nothing, not even by rounding.

        Args:
            velocity: (n,) m/s.
            commands: (count, n) m/s, as for `step`.
            headings: unit vectors (count, n), in the middle of each.
            durations: (count, n) s.
        """
        period = durations[..., None]
        ahead = np.where(period > 0, headings[..., None], 1.0)  # (count, n, 1), of which a view as real is a pair
        into = ahead.conj()
        towards = (commands[..., None] * into).view(float) / self.effort  # where commands lead without friction
        into[1:] *= ahead[:-1]  # from one step's axes into the next one's
        still, slower, most = self._still, self._slower, self._rubbed
        steps, reached = np.empty((len(commands), 4, *velocity.shape, 2)), velocity[:, None]
        for turn, target, until, (before, late, along, after) in zip(into, towards, -period, steps, strict=True):
            np.multiply(reached, turn, out=before.view(complex))
            np.add(still, slower * np.abs(reached), out=late)
            rest = _ONE - np.exp(until / late)
            free, rubbed = before + rest * (target - before), rest * most
            np.subtract(free, rubbed * _along(free, rubbed, along), out=after)
            reached = after.view(complex)
        if not len(steps):
            return np.zeros_like(velocity), velocity
        before, late, along, after = steps.swapaxes(0, 1)
        moved = (period * (towards - most * along) + late * (before - after)).view(complex) * ahead
        return np.add.accumulate(moved)[-1, :, 0], (reached * ahead[-1])[:, 0]

    def ask(self, before: Plane, after: Plane, heading: Plane, duration: float) -> Plane:
        """Commands (..., n), world frame, that lead from velocities `before` to `after`, (..., n), in a `duration`.

        The inverse of `step`, with `heading` (..., n) as there; compass and what else pushes are left to the caller.
        """
        back = heading.conj()
        v, later, mean = pairs(before * back), pairs(after * back), (before + after) / 2
        decay = np.exp(-duration / self.late(np.abs(before)))
        towards = pairs(mean * back) / starting(np.abs(mean))[..., None]
        return plane(((later - decay * v) / (1 - decay) + self._rubbed * towards) * self.effort) * heading


def _along(free: Array, rubbed: Array, out: Array | None = None) -> Array:
    """Of which direction dry friction takes up to `rubbed` m/s, (n, 2), from velocities `free` (n, 2) that are without.

    It stops them, but does not turn them back.
    """
    return np.divide(free, fading(np.abs(free.view(complex)), rubbed), out=out)


def fading(speed: Number, rubbed: Number) -> Number:
    """Speed over which dry friction of up to `rubbed` m/s fades, of robots that drive at `speed`."""
    return np.maximum(speed, np.maximum(RUBBED_M_S, rubbed))


def starting(speed: Number) -> Number:
    """Speed over which that friction is made up for, of a motion that is asked for."""
    return np.maximum(speed, STARTING_M_S)


def softness(geometry: Kinematics | None) -> float:
    """How many times more than forward a robot gives way sideways."""
    if geometry is None:
        return 5 / 3  # wheels at 60, 135, 225 and 300 degrees
    forward, sideways = (geometry.matrix[:, :2] ** 2).sum(0)
    return float(forward / sideways)
