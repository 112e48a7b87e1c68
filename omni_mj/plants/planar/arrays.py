"""What a cycle reads and writes of n robots with W wheels: plain arrays, for numpy and for a compiled loop."""

from typing import NamedTuple

import numpy as np

from omni_control.kinematics import Array

Plane = np.ndarray  # vectors of the plane as complex numbers, x first


class Robots(NamedTuple):
    """What does not change unless a robot's load does. Vectors are along its axes, from its centre of mass."""

    outward: Plane  # directions of the axles, (W,)
    contacts: Plane  # where wheels touch, (n, W) m
    rims: Array  # angular speed of each rim for the body's twist, (n, W, 3) 1/m, 1/m, 1
    squares: Array  # products of these: upper halves of symmetric matrices, (n, W, 6)
    inertia: Array  # of body and rims over a cycle, such a half, (n, 6) kg/s and kg m^2/s
    give: Array  # speed per torque that a cycle gives a hub, (n, 1) rad/s / (N m)
    viscous: Array  # friction of hubs, (n, 1) N m s/rad
    dry: Array  # the same, (n, W) N m
    torque_constant: Array  # torque of a hub per current now, (n, W) N m/A
    contact: Array  # slip over torque of the contacts, (n, W) rad/s / (N m)
    lever: Array  # from axles to the carpet, (n, W) m
    bearing: Array  # and the six that follow: see `rollers`, (n, W)
    spin_up: Array
    cost: Array
    cost_fades: Array
    lift: Array
    lift_fades: Array
    middle: Plane  # of the robot, (n,) m
    pushed: Plane  # where pushes act, (n,) m
    height: Array  # of the centre of mass, (n,) m
    pushed_height: Array  # of where pushes act above that, (n,) m
    weight: Array  # load of each wheel at rest, (n, W) N
    even: Array  # share of a load that each wheel takes, (n, W)
    ahead: Array  # load per moment, (n, W) 1/m
    aside: Array


class Motion(NamedTuple):
    """Where robots are and what they do; written in every cycle."""

    place: Plane  # of the centre of mass in the world, (n,) m
    heading: Array  # (n,) rad
    velocity: Plane  # of the centre of mass in the world, (n,) m/s
    rate: Array  # of turning, (n,) rad/s
    angle: Array  # of hubs, (n, W) rad
    speed: Array  # (n, W) rad/s
    torque: Array  # between hubs and rims, (n, W) N m
    slip: Array  # of hubs against rims, (n, W) rad/s
    load: Array  # of wheels, (n, W) N
    raised: Array  # part of it that rollers shift from wheel to wheel, (n, W) N
    seen_angle: Array  # what encoders show: a cycle ago, (n, W) rad
    seen_rate: Array  # what gyros do, (n,) rad/s
    ground: Plane  # drag at the carpet, robot's axes, (n,) N
    push: Plane  # on the chassis, the same
    force: Plane  # all but the wheels' pull, the same
    moment: Array  # of it, (n,) N m
    tilt: Plane  # moments that tilt the robot back and aside, summed over the cycles of a frame, (n,) N m


class Scratch(NamedTuple):
    """What a compiled loop notes of a robot's wheels within a cycle, (n, W)."""

    end: Array  # speed of the hub without rubber, rad/s
    give: Array  # speed per torque of the hub
    pull: Array  # torque per slip
    held: Array  # torque of wheels that slide, N m; else 0
    rims: Array  # angular speed of the rim, rad/s
