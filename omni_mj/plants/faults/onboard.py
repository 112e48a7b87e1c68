"""What breaks on a robot: motors, wheels, sensors, the processor and its supply."""

import numpy as np

from omni_mj.link.noise import Noise, Stream
from omni_mj.link.schedule import Active
from omni_mj.plants.faults.robots import Act, Robots
from omni_mj.scenarios import faults


def weaken(robots: Robots) -> Act:
    """Motors whose magnets are weaker."""

    def act(active: Active) -> None:
        share = np.ones_like(robots.motors.constant)
        for row, weak in active.of(faults.MotorWeak):
            share[row, weak.wheel - 1] *= weak.to
        robots.motors.weaken(share)

    return act


def release(robots: Robots) -> Act:
    """Drivers that are off: of dead motors, and of robots that start anew and let their wheels roll."""

    def act(active: Active) -> None:
        robots.off[:] = np.nan
        for row, dead in active.of(faults.MotorDead):
            robots.off[row, dead.wheel - 1] = 0.0
        for row, reboot in active.of(faults.Reboot):
            if reboot.motors == "coast":
                robots.off[row] = 0.0

    return act


def block(robots: Robots) -> Act:
    """Motors that are stuck."""

    def act(active: Active) -> None:
        stuck = np.zeros(robots.off.shape, bool)
        for row, blocked in active.of(faults.MotorBlocked):
            stuck[row, blocked.wheel - 1] = True
        robots.bodies.block(stuck)

    return act


def wear(robots: Robots) -> Act:
    """Wheels that grip less, always or where rollers are missing; of gaps in one wheel the widest counts."""

    def act(active: Active) -> None:
        grip, gap = np.ones(robots.off.shape), np.zeros(robots.off.shape)
        for row, worn in active.of(faults.WheelWorn):
            grip[row, worn.wheel - 1] *= worn.to
        for row, lost in active.of(faults.WheelRoller):
            wide = 2 * np.pi * lost.rollers / robots.rows[row].settings.wheels.rollers
            gap[row, lost.wheel - 1] = max(gap[row, lost.wheel - 1], wide)
        robots.traction.become(grip, gap)

    return act


def mislead(robots: Robots) -> Act:
    """Sensors that show something else: factors multiply, of gyros and of encoders.

    An encoder that counts nothing does not know afterwards how far its wheel has turned.
    """
    n, wheels = robots.off.shape
    gyro, scale, drops = np.ones(n), np.ones((n, wheels)), np.zeros((n, wheels))
    seeds = [row.noise_seed for row in robots.rows]
    chance = Noise(seeds, Stream.ENCODER_FAULTS, lambda rng, count: rng.random((count, wheels)))

    def act(active: Active) -> None:
        gyro[:], scale[:], drops[:] = 1.0, 1.0, 0.0
        for row, one in active.of(faults.GyroScale):
            gyro[row] *= one.to
        for row, other in active.of(faults.EncoderScale):
            scale[row, other.wheel - 1] *= other.to
        for row, loose in active.of(faults.EncoderDropout):
            kept = 1 - drops[row, loose.wheel - 1]
            drops[row, loose.wheel - 1] = 1 - kept * (1 - loose.probability)

    def each_frame() -> None:
        counts = np.where(chance.next() < drops, 0.0, scale)
        robots.firmware.mislead(gyro, counts, robots.encoders)

    robots.each_frame.append(each_frame)
    return act


def shift(robots: Robots) -> Act:
    """Gyros that show too much."""

    def act(active: Active) -> None:
        robots.gyro[:] = 0.0
        for row, bias in active.of(faults.GyroBias):
            robots.gyro[row] += bias.rad_s

    return act


def silence(robots: Robots) -> Act:
    """Processors that stop listening, or start anew."""

    def act(active: Active) -> None:
        deaf, off = np.zeros((2, len(robots.rows)), bool)
        deaf[[row for row, _ in active.of(faults.FirmwareTimeout)]] = True
        off[[row for row, _ in active.of(faults.Reboot)]] = True
        robots.firmware.hear(deaf, off, robots.encoders)

    return act


def starve(robots: Robots) -> Act:
    """Supplies that sink."""

    def act(active: Active) -> None:
        robots.battery.share[:] = 1.0
        for row, sunk in active.of(faults.BrownOut):
            robots.battery.share[row] *= sunk.to

    return act
