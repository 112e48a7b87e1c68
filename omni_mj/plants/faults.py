"""What faults do to robots on wheels.

What acts starts anew from the robots as they were built whenever a fault begins or ends, so a fault leaves nothing
behind, and a robot's numbers do not depend on what happens to others of its batch. Pushes, payloads, slopes and biases
of several faults add up, factors multiply, and of several values in place of the scenario's the last one counts.
"""

from abc import ABC, abstractmethod
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from omni_control.errors import OmniError
from omni_control.kinematics import Array
from omni_mj.link.noise import Noise, Stream
from omni_mj.link.schedule import Active, Schedule
from omni_mj.robot.carpet import covered
from omni_mj.scenarios import faults
from omni_mj.scenarios.rows import Row

PROCESSORS = faults.FirmwareTimeout, faults.Reboot
ENCODERS = faults.EncoderDropout, faults.EncoderScale
KINDS: tuple[type[faults.Fault], ...] = (
    *(faults.Push, faults.Kidnap, faults.Payload, faults.Tilt, faults.Friction, faults.FrictionPatch),
    *(faults.MotorWeak, faults.MotorDead, faults.MotorBlocked, faults.WheelWorn, faults.WheelRoller),
    *(*ENCODERS, faults.GyroScale, faults.GyroBias, *PROCESSORS, faults.BrownOut),
)


class Faulty(ABC):
    """What faults change of n robots: parameters with the fields `onboard` and `carpet`, and bodies."""

    parameters: Any

    @abstractmethod
    def carry(self, loads: Iterable[tuple[int, float, float]]) -> None:
        """Carry these loads and no others: row, mass in kg, height in m or 0 for that of the centre of mass."""

    @abstractmethod
    def lean(self, along: Array) -> None:
        """Stand on carpets that lean so that gravity has the parts `along` (n, 2) of itself along them."""

    @abstractmethod
    def block(self, stuck: np.ndarray) -> None:
        """Have these wheels stuck, (W, n), and no others."""

    @abstractmethod
    def put(self, robot: int, moved: tuple[float, float, float]) -> None:
        """Put a robot as far from where it is, m, m and rad in the world, at rest."""


class Faults:
    """Faults of n robots with W wheels.

    Args:
        rows: Of the robots, those of one world one after the other.
        plant: That they drive on.

    Attributes:
        push: Forces on the chassis at their centres of mass, world frame, (n, 2) N.
        gyro_bias: (n, 1) rad/s.
        off_current: Currents of motors whose drivers are off, 0 A, (W, n); NaN of others; None if all stay on.
        inputs: Fields of `omni_mj.robot.onboard.FrameInputs` that faults set.

    Raises:
        OmniError: Robots that share a world stand on carpets that lean differently.
    """

    def __init__(self, rows: Sequence[Row], plant: Faulty) -> None:
        self._rows, self._plant, self._base = rows, plant, plant.parameters
        self._schedule, self._frame = Schedule([row.faults for row in rows], *KINDS), 0
        self._shape = plant.parameters.carpet.grip.shape
        self.push, self.gyro_bias = np.zeros((len(rows), 2)), np.zeros((len(rows), 1))
        self.off_current: Array | None = None
        self.inputs: dict[str, Array] = {}
        self._change_inputs(Active([]))
        seeds = [row.noise_seed for row in rows]
        self._chance = Noise(seeds, Stream.ENCODER_FAULTS, lambda rng, count: rng.random((count, self._shape[0])))
        own = [[fault for fault in row.faults if isinstance(fault, faults.FrictionPatch)] for row in rows]
        self._patches = max(len(row.settings.carpet.patches) for row in rows) + max(map(len, own))
        if faults.Tilt in self._schedule.kinds:
            places = 1 + max(row.place for row in rows)
            for first in range(0, len(rows), places):
                check_carpet(rows[first : first + places])

    def begin(self) -> None:
        """Let begin what begins in the next frame, and end what ends."""
        active = self._schedule.at(self._frame)
        self._frame += 1
        if active is not None:
            self._change_parameters(active)
            self._change_bodies(active)
            self._change_inputs(active)
        if self._has(*ENCODERS):
            self.inputs["encoder_scale"] = np.where(self._dropouts > self._chance.next().T, 0.0, self._encoder_scale)

    def _has(self, *kinds: type[faults.Fault]) -> bool:
        return any(kind in self._schedule.kinds for kind in kinds)

    def _change_parameters(self, active: Active) -> None:
        """Change carpet, wheels and magnets."""
        carpet, motors = self._base.carpet, self._base.onboard.motors
        friction, strength = carpet.friction.copy(), np.ones(self._shape)
        grip, gap = np.ones(self._shape), np.zeros(self._shape)
        for row, fault in active.of(faults.Friction):
            friction[row] = fault.to
        for row, weak in active.of(faults.MotorWeak):
            strength[weak.wheel - 1, row] *= weak.to
        for row, worn in active.of(faults.WheelWorn):
            grip[worn.wheel - 1, row] *= worn.to
        for row, lost in active.of(faults.WheelRoller):  # of gaps in one wheel the widest counts
            angle = 2 * np.pi * lost.rollers / self._rows[row].settings.wheels.rollers
            gap[lost.wheel - 1, row] = max(gap[lost.wheel - 1, row], angle)
        patches = [list(row.settings.carpet.patches) for row in self._rows]
        for row, patch in active.of(faults.FrictionPatch):
            patches[row].append((patch.x_m, patch.y_m, patch.radius_m, patch.to))
        changed = carpet._replace(
            friction=friction,
            patches=covered(patches, self._patches),
            grip=carpet.grip * grip,
            gap=gap if self._has(faults.WheelRoller) else None,
        )
        onboard = self._plant.parameters.onboard
        motors = motors._replace(cold_constant=motors.cold_constant * strength)
        self._plant.parameters = self._plant.parameters._replace(
            carpet=changed, onboard=onboard._replace(motors=motors)
        )

    def _change_bodies(self, active: Active) -> None:
        """Load, lean, block and move robots."""
        if self._has(faults.Payload):
            self._plant.carry([(row, load.mass_kg, load.height_m) for row, load in active.of(faults.Payload)])
        if self._has(faults.Tilt):
            along = np.zeros((len(self._rows), 2))
            for row, tilt in active.of(faults.Tilt):
                along[row] += np.sin(np.radians(tilt.angle_deg)) * _direction(tilt.direction_deg)
            self._plant.lean(along)
        if self._has(faults.MotorBlocked):
            stuck = np.zeros(self._shape, bool)
            for row, blocked in active.of(faults.MotorBlocked):
                stuck[blocked.wheel - 1, row] = True
            self._plant.block(stuck)
        for row, hand in active.begun(faults.Kidnap):
            self._plant.put(row, hand.moved)

    def _change_inputs(self, active: Active) -> None:
        """Change pushes, sensors, drivers, processors and supplies."""
        n = len(self._rows)
        self.push[:], self.gyro_bias[:] = 0.0, 0.0
        self._encoder_scale, self._dropouts = np.ones(self._shape), np.zeros(self._shape)
        gyro_scale, power, off = np.ones(n), np.ones(n), np.full(self._shape, np.nan)
        for row, push in active.of(faults.Push):
            self.push[row] += push.force_n * _direction(push.direction_deg)
        for row, bias in active.of(faults.GyroBias):
            self.gyro_bias[row] += bias.rad_s
        for row, scaled in active.of(faults.GyroScale):
            gyro_scale[row] *= scaled.to
        for row, other in active.of(faults.EncoderScale):
            self._encoder_scale[other.wheel - 1, row] *= other.to
        for row, loose in active.of(faults.EncoderDropout):
            remaining = (1 - self._dropouts[loose.wheel - 1, row]) * (1 - loose.probability)
            self._dropouts[loose.wheel - 1, row] = 1 - remaining
        for row, sunk in active.of(faults.BrownOut):
            power[row] *= sunk.to
        for row, dead in active.of(faults.MotorDead):
            off[dead.wheel - 1, row] = 0.0
        is_deaf, is_off = np.zeros((2, n), bool)
        for row, _ in active.of(faults.FirmwareTimeout):
            is_deaf[row] = True
        for row, reboot in active.of(faults.Reboot):
            is_off[row] = True
            if reboot.motors == "coast":
                off[:, row] = 0.0
        self.off_current = off if self._has(faults.MotorDead, faults.Reboot) else None
        self.inputs["power_share"] = power
        if self._has(faults.GyroScale):
            self.inputs["gyro_scale"] = gyro_scale
        if self._has(*PROCESSORS):
            self.inputs |= {"is_deaf": is_deaf, "is_off": is_off}


def check_carpet(rows: Sequence[Row]) -> None:
    """See that robots of a world can stand on one carpet.

    Raises:
        OmniError: Those of some tilt when those of others do not.
    """
    tilts = [[fault for fault in row.faults if isinstance(fault, faults.Tilt)] for row in rows]
    if any(tilt != tilts[0] for tilt in tilts):
        raise OmniError("robots that share a world stand on one carpet: their faults must have the same tilts")


def _direction(degrees: float) -> Array:
    return np.array([np.cos(np.radians(degrees)), np.sin(np.radians(degrees))])
