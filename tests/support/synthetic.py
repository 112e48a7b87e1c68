"""Robots whose wheels creep, written apart from the package: logs of known truth for identification.

Newton's law of body and hubs in the world's frame, wheel by wheel, in small steps: hubs implicitly, as they are light.
"""

from dataclasses import dataclass

import numpy as np

from omni_mj.scenarios.settings import Settings

FINE = 960  # steps of a second, about
SLOWEST_M_S = 0.015  # below which creep and drag are those of this speed


@dataclass(frozen=True)
class Truth:
    """Of a robot: latency in s, creep stiffness, drag over load, what a wheel's loop gives way (s), friction (m/s)."""

    late: float = 0.1
    stiffness: float = 2.0
    pile: float = 0.05
    rollers: float = 0.08
    give: float = 0.03
    friction: float = 0.01
    scale: float = 1.0


@dataclass(frozen=True)
class Logs:
    """Of n robots, F lines: times (F,), poses measured (F, n, 3), commands (F, n, 3) world frame, angles (F, n, W)."""

    time: np.ndarray
    pose: np.ndarray
    command: np.ndarray
    angle: np.ndarray


def logs(
    settings: Settings,
    truths: list[Truth],
    seconds: float,
    *,
    rate: float = 60.0,
    seed: int = 0,
    noise: float = 0.0013,
    speed: float = 1.6,
    pull: float = 2.0,
    turn: float = 3.0,
    push: float = 0.0,
    weak: float = 1.0,
    lean: complex = 0.0,
) -> Logs:
    """Drive between random velocities, 3/4 s each, along trapezoids.

    Args:
        settings: the robots' geometry and inertia.
        truths: of each robot.
        seconds: how long.
        rate: lines per second.
        seed: of moves and noise.
        noise: of positions, m; of headings 0.003 rad.
        speed, pull, turn: largest velocity per axis, acceleration, and turn rate; turning speeds up at 15 rad/s^2.
        push: an acceleration that swings along x at 1.1 Hz, m/s^2, and that no law knows.
        weak: share of the first wheel's load that its traction is in proportion to.
        lean: what a slope of the carpet pulls along x, and y as the imaginary part, m/s^2.
    """
    rng, n, lines = np.random.default_rng(seed), len(truths), round(seconds * rate)
    fine = max(1, round(FINE / rate))
    dt, each = 1 / (rate * fine), np.array([list(vars(t).values()) for t in truths])
    late, stiffness, pile, rollers, give, friction, scale = each.T[:, :, None]
    azimuth, arm = np.radians(settings.wheels.azimuths_deg), settings.wheels.arm_m
    radius, mass, height = settings.wheels.radius_m, settings.body.mass_kg, settings.body.centre_height_m
    outward, drive = np.exp(1j * azimuth), 1j * np.exp(1j * azimuth)
    ring = settings.wheels.rollers * 0.0015 * (1 - settings.wheels.roller_radius_m / radius) ** 2
    viscous = settings.drive.roller_damping_nm_s / settings.wheels.roller_radius_m**2
    motor = settings.motor
    hub = motor.rotor_inertia_kg_m2 * motor.gear**2 / radius**2
    softer = motor.commutation_ohm_s * motor.gear / (motor.resistance_ohm * radius)
    places = np.stack([np.ones(len(azimuth)), arm * outward.real, arm * outward.imag], 1)
    spread = places @ np.linalg.inv(places.T @ places)
    rest, shift, share = spread @ [mass * 9.81, 0.0, 0.0], spread[:, 1:].T, np.append(weak, np.ones(len(azimuth) - 1))
    along, across = np.conj(drive), np.conj(outward)
    inertia = np.array([mass, mass, settings.body.yaw_inertia_kg_m2])[:, None] * np.eye(3)
    rows = np.stack([drive.real, drive.imag, np.full(len(azimuth), arm)], 1)
    inverse = np.linalg.inv(inertia + ring * rows.T @ rows)
    command, goal = np.zeros((lines, n, 3)), np.zeros((n, 3))
    steepest = np.array([pull, pull, 15.0]) / rate
    for k in range(1, lines):
        if k % round(0.75 * rate) == 1:
            goal = rng.uniform(-1, 1, (n, 3)) * [speed, speed, turn]
        command[k] = command[k - 1] + np.clip(goal - command[k - 1], -steepest, steepest)
    z, v, heading, w = np.zeros(n, complex), np.zeros(n, complex), np.zeros(n), np.zeros(n)
    rim, angle, pulling = np.zeros((n, len(azimuth))), np.zeros((n, len(azimuth))), np.zeros(n, complex)
    poses, angles = np.zeros((lines, n, 3)), np.zeros((lines, n, len(azimuth)))
    for k in range(lines):
        poses[k], angles[k] = np.stack([z.real, z.imag, heading], 1), angle
        times = (k + (np.arange(fine) + 0.5) / fine) / rate
        line = np.floor((times[:, None] - late[:, 0]) * rate).astype(int)
        sent = np.where((line >= 0)[..., None], command[np.maximum(line, 0), np.arange(n)], 0.0)
        for t, u in zip(times, sent, strict=True):
            ahead = np.exp(1j * heading)
            told = (along * ((u[:, 0] + 1j * u[:, 1]) / ahead)[:, None]).real
            told = told + arm * (u[:, 2] + settings.firmware.turn_gain * (u[:, 2] - w))[:, None]
            body = (v / ahead)[:, None]
            travel = body + 1j * arm * w[:, None] * outward
            load = rest - mass * height * (np.stack([pulling.real, pulling.imag], 1) @ shift)
            ground = (along * travel).real
            size = np.maximum(np.abs(travel), SLOWEST_M_S)
            holds = stiffness * load * share / size
            soft = give / mass * (1 + softer * np.abs(told))
            wanted = scale * told - friction * np.minimum(np.maximum(told / 0.05, -1), 1)
            rim = (hub * rim + dt * (wanted / soft + holds * ground)) / (hub + dt * (1 / soft + holds))
            force = holds * (rim - ground)
            angle = angle + dt * rim / radius
            axle = (across * travel).real
            sideways = rollers * load * axle / np.maximum(np.abs(axle), SLOWEST_M_S) + viscous * axle
            drag = pile * load * travel / size
            whole = (force * drive - drag - sideways * outward).sum(1)
            moment = (arm * force - arm * (along * drag).real).sum(1)
            gained = np.stack([whole.real, whole.imag, moment], 1) @ inverse.T
            pulling = gained[:, 0] + 1j * gained[:, 1]
            world = pulling * ahead + push * np.sin(2 * np.pi * 1.1 * t) + lean
            z, heading = z + dt * (v + dt * world / 2), heading + dt * (w + dt * gained[:, 2] / 2)
            v, w = v + dt * world, w + dt * gained[:, 2]
    measured = poses + rng.normal(size=poses.shape) * [noise, noise, 0.003]
    return Logs(np.arange(lines) / rate, measured, command, angles)
