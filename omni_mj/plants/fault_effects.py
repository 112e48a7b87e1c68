"""What faults do to robots on wheels.

What acts starts anew from the robots as they were built whenever a fault begins or ends, so a fault leaves nothing
behind, and a robot's numbers do not depend on what happens to others of its batch. Pushes, payloads, slopes and biases
of several faults add up, factors multiply, and of several values in place of the scenario's the last one counts.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Sequence
from operator import add, attrgetter, mul
from typing import Any

import numpy as np

from omni_control.kinematics import Array
from omni_mj.config import faults
from omni_mj.config.rows import Row
from omni_mj.network.fault_schedule import ActiveFaults, FaultSchedule
from omni_mj.network.random_streams import Noise, Stream
from omni_mj.robot.carpet import covered

STUCK_NM = 100.0  # dry friction of a hub that is stuck: more than motor and carpet can turn
FACTOR, NONE = attrgetter("factor"), lambda fault: 0.0  # factors by which faults of a kind multiply


class Faulty(ABC):
    """Bodies of n robots, which faults change."""

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
        rows: Of the robots.
        plant: That they drive on; it has `parameters` with the fields `onboard` and `carpet`.
        bodies: Of the robots.

    Attributes:
        push: Forces on the chassis at their centres of mass, world frame, (n, 2) N.
        gyro_bias: (n, 1) rad/s.
        off_current: Currents of motors whose drivers are off, 0 A, (W, n); NaN of others.
        inputs: Fields of `omni_mj.robot.onboard.FrameInputs` that faults set.
    """

    def __init__(self, rows: Sequence[Row], plant: Any, bodies: Faulty) -> None:
        self._rows, self._plant, self._base, self._bodies = rows, plant, plant.parameters, bodies
        self._kinds = {type(fault) for row in rows for fault in row.faults}
        self._schedule, self._frame = (
            FaultSchedule([row.faults for row in rows], faults.OnWheels, faults.Kidnap),
            0,
        )
        self._robots, self._wheels = np.ones(len(rows)), np.ones(plant.parameters.carpet.grip.shape)
        self._none = np.zeros((len(rows), 2))
        self._change_inputs(ActiveFaults([]))
        seeds = [row.noise_seed for row in rows]
        self._chance = Noise(
            seeds, Stream.ENCODER_FAULTS, lambda rng, count: rng.random((count, len(self._wheels)))
        )
        self._patches = max(
            len(row.settings.carpet.patches)
            + sum(isinstance(fault, faults.FrictionPatch) for fault in row.faults)
            for row in rows
        )

    def begin(self) -> None:
        """Let begin what begins in the next frame, and end what ends."""
        active = self._schedule.update(self._frame)
        self._frame += 1
        if active is not None:
            self._change_parameters(active)
            self._change_bodies(active)
            self._change_inputs(active)
        self.inputs["encoder_scale"] = np.where(
            self._dropouts > self._chance.next().T, 0.0, self._encoder_scale
        )

    def _change_parameters(self, active: ActiveFaults) -> None:
        """Change carpet, wheels and magnets."""
        carpet, motors = self._base.carpet, self._base.onboard.motors
        patches = [list(row.settings.carpet.patches) for row in self._rows]
        for row, patch in active.of_kind(faults.FrictionPatch):
            patches[row].append((patch.x_m, patch.y_m, patch.radius_m, patch.friction))
        lost = _join(
            active, faults.WheelMissingRollers, 0 * self._wheels, attrgetter("rollers"), max
        )
        rollers = np.array([row.settings.wheels.rollers for row in self._rows])
        changed = carpet._replace(
            friction=_join(
                active,
                faults.Friction,
                carpet.friction,
                attrgetter("friction"),
                lambda _, last: last,
            ),
            patches=covered(patches, self._patches),
            grip=carpet.grip * _join(active, faults.WheelWorn, self._wheels),
            gap=2 * np.pi * lost / rollers,
        )
        motors = motors._replace(
            cold_constant=motors.cold_constant
            * _join(active, faults.MotorDemagnetized, self._wheels)
        )
        onboard = self._base.onboard._replace(motors=motors)
        self._plant.parameters = self._plant.parameters._replace(carpet=changed, onboard=onboard)

    def _change_bodies(self, active: ActiveFaults) -> None:
        """Load, lean, block and move robots."""
        if faults.Payload in self._kinds:
            self._bodies.carry(
                [(row, load.mass_kg, load.height_m) for row, load in active.of_kind(faults.Payload)]
            )
        if faults.Tilt in self._kinds:
            self._bodies.lean(_join(active, faults.Tilt, self._none, _slope, add))
        if faults.MotorBlocked in self._kinds:
            self._bodies.block(_join(active, faults.MotorBlocked, self._wheels, NONE) == 0)
        for row, hand in active.started(faults.Kidnap):
            self._bodies.put(row, hand.moved)

    def _change_inputs(self, active: ActiveFaults) -> None:
        """Change pushes, sensors, drivers, processors and supplies."""
        robots, wheels = self._robots, self._wheels
        self.push = _join(
            active, faults.Push, self._none, lambda push: push.force_n * _direction(push), add
        )
        self.gyro_bias = _join(
            active, faults.GyroBias, 0 * robots[:, None], attrgetter("bias_rad_s"), add
        )
        self._encoder_scale = _join(active, faults.EncoderScale, wheels)
        self._dropouts = 1 - _join(
            active, faults.EncoderDropout, wheels, lambda loose: 1 - loose.probability
        )
        self.inputs = {
            "power_share": _join(active, faults.BrownOut, robots),
            "gyro_scale": _join(active, faults.GyroScale, robots),
            "is_deaf": _join(active, faults.FirmwareTimeout, robots, NONE) == 0,
            "is_off": _join(active, faults.Reboot, robots, NONE) == 0,
        }
        driven = _join(active, faults.MotorDead, wheels, NONE)
        driven *= _join(active, faults.Reboot, robots, lambda reboot: reboot.motors == "brake")
        self.off_current = np.where(driven, np.nan, 0.0)


def _join(
    active: ActiveFaults,
    kind: type[faults.Fault],
    start: Array,
    value: Callable[[Any], Any] = FACTOR,
    by: Callable[[Any, Any], Any] = mul,
) -> Array:
    """Return what faults of a kind make of numbers of each robot (n, ...), or of each wheel (W, n).

    Args:
        active: The faults that go on.
        kind: Of those that count.
        start: The numbers without any.
        value: The number of a fault.
        by: Joins the number so far and that of a fault.
    """
    result = start.copy()
    for row, fault in active.of_kind(kind):
        at = (fault.wheel - 1, row) if isinstance(fault, faults.OnOneWheel) else row
        result[at] = by(result[at], value(fault))
    return result


def _direction(fault: Any) -> Array:
    angle = np.radians(fault.direction_deg)
    return np.array([np.cos(angle), np.sin(angle)])


def _slope(tilt: faults.Tilt) -> Array:
    return np.sin(np.radians(tilt.angle_deg)) * _direction(tilt)
