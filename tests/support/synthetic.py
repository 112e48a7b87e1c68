"""Logs of a robot on creeping wheels, of known truth, by a law that is written apart from the package.

Newton's law of body and hubs in the world frame, wheel by wheel, in small steps; hubs implicitly, as they are light.
"""

from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np

import omni_mj as om

FINE = 960  # steps of a second, about
SLOWEST_M_S = 0.015  # below which creep and drag are those of this speed
POSE = ("x_m", "y_m", "heading_rad")
COMMAND = ("vx_cmd_world_m_s", "vy_cmd_world_m_s", "w_cmd_rad_s")
WHEELS = ("wheel_1_rad", "wheel_2_rad", "wheel_3_rad", "wheel_4_rad")
SETTINGS = om.scenario("rect").settings
Columns = dict[str, np.ndarray]


@dataclass(frozen=True)
class Truth:
    """Of a robot: latency in s, creep stiffness, drag over load, what a wheel's loop gives way (s), friction (m/s)."""

    late: float = 0.1
    stiffness: float = 2.0
    pile: float = 0.05
    rollers: float = 0.08
    give: float = 0.03
    friction: float = 0.01


@dataclass(frozen=True)
class Drive:
    """Random velocities, 3/4 s each, along trapezoids.

    Attributes:
        seconds: how long; rate: lines per second; seed: of moves and noise.
        speed, pull: largest velocity per axis, m/s, and acceleration, m/s^2.
        push: an acceleration that swings along x at 1.1 Hz, m/s^2, and that no law knows.
        lean: what a slope of the carpet pulls along x, and y as the imaginary part, m/s^2.
    """

    seconds: float = 6.5
    rate: float = 60.0
    seed: int = 1
    speed: float = 2.2
    pull: float = 2.0
    push: float = 0.0
    lean: complex = 0.0


@cache
def _driven(truth: Truth, drive: Drive) -> Columns:
    rng, settings = np.random.default_rng(drive.seed), SETTINGS
    lines, fine = round(drive.seconds * drive.rate), max(1, round(FINE / drive.rate))
    dt = 1 / (drive.rate * fine)
    azimuth, arm, radius = np.radians(settings.wheels.azimuths_deg), settings.wheels.arm_m, settings.wheels.radius_m
    mass, height, motor = settings.body.mass_kg, settings.body.centre_height_m, settings.motor
    outward, along = np.exp(1j * azimuth), 1j * np.exp(1j * azimuth)
    ring = settings.wheels.rollers * 0.0015 * (1 - settings.wheels.roller_radius_m / radius) ** 2
    viscous = settings.drive.roller_damping_nm_s / settings.wheels.roller_radius_m**2
    hub = motor.rotor_inertia_kg_m2 * motor.gear**2 / radius**2
    softer = motor.commutation_ohm_s * motor.gear / (motor.resistance_ohm * radius)
    places = np.stack([np.ones(len(azimuth)), arm * outward.real, arm * outward.imag], 1)
    spread = places @ np.linalg.inv(places.T @ places)
    rows = np.stack([along.real, along.imag, np.full(len(azimuth), arm)], 1)
    inverse = np.linalg.inv(np.diag([mass, mass, settings.body.yaw_inertia_kg_m2]) + ring * rows.T @ rows)
    command, goal, steepest = np.zeros((lines, 3)), np.zeros(3), np.array([drive.pull, drive.pull, 15.0]) / drive.rate
    for k in range(1, lines):
        if k % round(0.75 * drive.rate) == 1:
            goal = rng.uniform(-1, 1, 3) * [drive.speed, drive.speed, 3.0]
        command[k] = command[k - 1] + np.clip(goal - command[k - 1], -steepest, steepest)
    z, v, heading, w, pulling = 0j, 0j, 0.0, 0.0, 0j
    rim, angle = np.zeros((2, len(azimuth)))
    poses, angles = np.zeros((lines, 3)), np.zeros((lines, len(azimuth)))
    for k in range(lines):
        poses[k], angles[k] = (z.real, z.imag, heading), angle
        for t in (k + (np.arange(fine) + 0.5) / fine) / drive.rate:
            line = int(np.floor((t - truth.late) * drive.rate))
            u = command[line] if line >= 0 else np.zeros(3)
            ahead = np.exp(1j * heading)
            turn = u[2] + settings.firmware.turn_gain * (u[2] - w)
            told = (along.conj() * complex(u[0], u[1]) / ahead).real + arm * turn
            travel = v / ahead + 1j * arm * w * outward
            load = mass * (9.81 * spread[:, 0] - height * (spread[:, 1:] @ [pulling.real, pulling.imag]))
            ground, size = (along.conj() * travel).real, np.maximum(np.abs(travel), SLOWEST_M_S)
            holds = truth.stiffness * load / size
            soft = truth.give / mass * (1 + softer * np.abs(told))
            wanted = told - truth.friction * np.clip(told / 0.05, -1, 1)
            rim = (hub * rim + dt * (wanted / soft + holds * ground)) / (hub + dt * (1 / soft + holds))
            force, angle = holds * (rim - ground), angle + dt * rim / radius
            axle = (outward.conj() * travel).real
            sideways = truth.rollers * load * axle / np.maximum(np.abs(axle), SLOWEST_M_S) + viscous * axle
            drag = truth.pile * load * travel / size
            whole = (force * along - drag - sideways * outward).sum()
            moment = arm * (force - (along.conj() * drag).real).sum()
            gained = inverse @ [whole.real, whole.imag, moment]
            pulling = complex(gained[0], gained[1])
            world = pulling * ahead + drive.push * np.sin(2 * np.pi * 1.1 * t) + drive.lean
            z, heading = z + dt * (v + dt * world / 2), heading + dt * (w + dt * gained[2] / 2)
            v, w = v + dt * world, w + dt * gained[2]
    poses += rng.normal(size=poses.shape) * [0.0013, 0.0013, 0.003]
    names = ("time_s", *POSE, *COMMAND, *WHEELS)
    return dict(zip(names, [np.arange(lines) / drive.rate, *poses.T, *command.T, *angles.T], strict=True))


def driven(truth: Truth = Truth(), drive: Drive = Drive(), *, wheels: bool = True, commands: bool = True) -> Columns:
    """The columns of a log, with noise of 1.3 mm and 3 mrad."""
    left = () if commands else COMMAND
    left += () if wheels else WHEELS
    return {name: values.copy() for name, values in _driven(truth, drive).items() if name not in left}


def write(path: Path, columns: Columns) -> Path:
    """A log as CSV; what is not a number is empty."""
    body = np.stack(list(columns.values()), 1)
    np.savetxt(path, body, fmt="%.9g", delimiter=",", header=",".join(columns), comments="")
    path.write_text(path.read_text().replace("nan", ""))
    return path
