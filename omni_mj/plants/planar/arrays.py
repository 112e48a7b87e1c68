"""What a cycle reads and writes of n robots with W wheels: plain arrays, for numpy and for a compiled loop.

Robots come last, so that the same number of all robots is in one piece (see `omni_mj.onboard.arrays`). Vectors are
along a robot's axes, from its centre of mass, where nothing else is said.
"""

from typing import NamedTuple

import numpy as np

from omni_control.kinematics import Array
from omni_mj.plants import Telemetry


class Robots(NamedTuple):
    """What does not change unless a robot's load does."""

    outward: np.ndarray  # directions of the axles as complex numbers, (W,)
    contacts: Array  # where wheels touch, (2, W, n) m
    corners: Array  # the same, one after the other round the robot, (2, W, n) m
    edges: Array  # from each to the next, (2, W, n) m
    radius: Array  # of wheels, without what they have lost, (W, n) m
    rims: Array  # angular speed of each rim for the body's twist, (W, 3, n) 1/m, 1/m, 1
    squares: Array  # products of these: upper halves of symmetric matrices, (W, 6, n)
    inertia: Array  # of body, rims and rollers over a cycle, such a half, (6, n) kg/s and kg m^2/s
    rows: Array  # all of it, (3, 3, n)
    wheeling: Array  # of rims and rollers alone, its first two columns, (2, 3, n) kg and kg m
    give: Array  # speed per torque that a cycle gives a hub, (n,) rad/s / (N m)
    viscous: Array  # friction of hubs, (n,) N m s/rad
    dry: Array  # the same, (W, n) N m
    contact: Array  # slip over torque of the contacts, (W, n) rad/s / (N m)
    lever: Array  # from axles to the carpet, (W, n) m
    bearing: Array  # and the nine that follow: see `rollers`, (W, n)
    spin_up: Array
    spin_fades: Array
    cost: Array
    cost_fades: Array
    lift: Array
    lift_fades: Array
    ripple: Array
    ripple_grows: Array
    stiffens: Array
    passing: Array  # rollers that come down in a cycle for a rim's speed, (n,) s/rad
    spring: Array  # of wheels, over what they move as the robot sways, (n,) 1/s^2
    damper: Array  # the same, (n,) 1/s
    carried: Array  # share of that which is the robot, (n,)
    middle: Array  # of the robot, (2, n) m
    pushed: Array  # where pushes act, (2, n) m
    height: Array  # of the centre of mass, (n,) m
    pushed_height: Array  # of where pushes act above that, (n,) m
    weight: Array  # load of each wheel at rest, (W, n) N
    even: Array  # share of a load that each wheel takes, (W, n)
    ahead: Array  # load per moment, (W, n) 1/m
    aside: Array


class Motion(NamedTuple):
    """Where robots are and what they do; written in every cycle."""

    place: Array  # of the centre of mass in the world, (2, n) m
    before: Array  # the same, when the frame began
    heading: Array  # (n,) rad
    facing: Array  # its cosine and sine, (2, n)
    twist: Array  # of the centre of mass, (3, n) m/s and rad/s
    angle: Array  # of hubs, (W, n) rad
    speed: Array  # (W, n) rad/s
    torque: Array  # between hubs and rims, (W, n) N m
    rims: Array  # their speed, which rubber lets differ from the hubs', (W, n) rad/s
    drift: Array  # what they turn faster than the carpet goes by: see `laws.drifting`, (W, n) rad/s
    load: Array  # of wheels, (W, n) N
    standing: Array  # part of it that nothing pulls at: weight, and what rollers shift from wheel to wheel, (W, n) N
    ripple: Array  # of load over `laws.passing`, (W, n) N
    turns: Array  # of rims, in rollers that came down, (W, n)
    sway: Array  # up, ahead and aside, on what presses and pulls: see `laws.swaying`, (3, n) N s^2 and N m s^2
    sway_rate: Array  # (3, n) N s and N m s
    seen_angle: Array  # what encoders show: a cycle ago, (W, n) rad
    seen_rate: Array  # what gyros do, (n,) rad/s
    force: Array  # all but the wheels' pull, and its moment, (3, n) N and N m
    tilting: Array  # moments of drag and pushes that tilt the robot back and aside, (2, n) N m
    tilt: Array  # with those of the wheels' pull, summed over the cycles of a frame, (2, n) N m


class Frame(NamedTuple):
    """What acts in a frame, and what is noted of it."""

    gyro: Array  # what gyros show too much, (n,) rad/s
    push: Array  # on chassis, in the world's axes, (2, n) N
    downhill: Array  # on all of a robot, in the world's axes, (2, n) N
    held: Array  # currents that drivers hold, (W, n) A, or not a number
    recorded: Array  # speeds of hubs, voltages and currents of each cycle, (3, cycles, W, n) rad/s, V and A
    supplies: Array  # voltages of batteries in them, (cycles, n) V
    slip: Array  # between hubs and rims, at the carpet, (W, n) m/s
    telemetry: Array  # its columns, (n, 10 W + 4)
    pose: Array  # of the robots' middles, (n, 3)

    @classmethod
    def of(cls, n: int, wheels: int, cycles: int) -> "Frame":
        """Of n robots with as many wheels each, in a frame of so many cycles."""
        each, parts = (wheels, n), Telemetry.empty(n, wheels).columns.shape
        shapes = (n,), (2, n), (2, n), each, (3, cycles, *each), (cycles, n), each, parts, (n, 3)
        return cls(*map(np.zeros, shapes))


class Scratch(NamedTuple):
    """What loops note within a cycle."""

    end: Array  # speed of a hub without rubber, (W, n) rad/s
    give: Array  # speed per torque of the hub, (W, n)
    pull: Array  # torque per slip, (W, n)
    held: Array  # torque of wheels that slide, (W, n) N m; else 0; then `laws.passing`
    momentum: Array  # before, over a cycle, with what acts, (3, n)
    sums: Array  # over wheels: of the matrix (6), and of the right side (3), (9, n)
    twist: Array  # after, of the middle first, (3, n)
    drawn: Array  # from batteries, (n,) A
    gyro: Array  # what gyros show, (n,) rad/s
    heats: Array  # of the motors, (2, n)

    @classmethod
    def of(cls, n: int, wheels: int) -> "Scratch":
        """Of n robots with as many wheels each."""
        shapes = [(wheels, n)] * 4 + [(3, n), (9, n), (3, n), (n,), (n,), (2, n)]
        return cls(*map(np.zeros, shapes))
