"""Helpers to test firmware, motors, battery and carpet of a robot without a body."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from omni_mj.config import robot_files
from omni_mj.config.motor_settings import MotorSettings
from omni_mj.config.settings import Settings
from omni_mj.config.toml_files import find_builtin_files
from omni_mj.robot import (
    battery,
    electronics,
    firmware,
    firmware_state,
    motors_and_drivers,
    wheel_carpet_forces,
)
from omni_mj.robot.numpy_and_jax_backends import JaxBackend
from omni_mj.simulation.simulation import Simulation

RPM = 30 / np.pi  # revolutions per minute per rad/s
# maxon's catalogue, EC 45 flat 50 W 24 V, as settings of `motor`, with a gear of 60:18 and a
# quarter of its friction dry
SHEET = {
    "nominal_voltage_v": 24.0,
    "no_load_rpm": 6250.0,
    "no_load_current_a": 0.238,
    "nominal_rpm": 5170.0,
    "nominal_torque_nm": 0.0911,
    "nominal_current_a": 2.52,
    "resistance_ohm": 0.942,
    "torque_constant_nm_a": 0.036,
    "torque_factor": 1.0,
    "rotor_inertia_kg_m2": 1.35e-5,
    "gear_ratio": 60 / 18,
    "dry_friction_fraction": 0.25,
}
FRAME_S, CYCLES = 1 / 60, 16


def make_command(
    x: float = 0.0, y: float = 0.0, turn: float = 0.0, n: int = 1, **fields: Any
) -> firmware_state.FirmwareCommand:
    """Return one command for n robots, with other fields of `FirmwareCommand` by name."""
    velocity = np.array([[x], [y], [turn]]) * np.ones(n)
    return firmware_state.FirmwareCommand(velocity, np.ones(n, bool))._replace(**fields)


class Firmware:
    """Firmware of n robots, with the gyro and encoders as inputs."""

    def __init__(
        self, settings: list[Settings], heading: float = 0.0, has_faults: bool = False
    ) -> None:
        self.n, self.cycle, self.frame = len(settings), 0, 0
        wheels = settings[0].wheels.kinematics
        magnet_factor = np.ones((len(wheels.azimuths), self.n))
        headings = np.full(self.n, heading)
        p, state = electronics.make_electronics(
            settings, wheels, headings, magnet_factor, 30, has_faults
        )
        self._p, self._s = p.firmware, state.firmware
        self.winding = state.motors.winding

    @property
    def heading(self) -> NDArray:
        """Estimated headings, (n,) rad."""
        return np.array(self._s.heading)

    def accept(self, **values: Any) -> None:
        """Accept a command; arguments as for `make_command`."""
        command = make_command(n=self.n, **values)
        self._s = firmware.accept_command(self._p, self._s, self.cycle, command)

    def set_heading(self, heading: float) -> None:
        """Set the headings of all robots."""
        self._s = firmware.set_heading(self._s, np.ones(self.n, bool), np.full(self.n, heading))

    def begin_frame(
        self,
        vision_heading: ArrayLike = np.nan,
        age: int = 0,
        off: bool | None = None,
        angle: ArrayLike = 0.0,
    ) -> None:
        """Begin a frame with a heading of vision, and with processors on or off.

        Args:
            vision_heading: Heading of vision, rad.
            age: Frames since that heading was sent.
            off: Whether processors are off; None if they cannot fail.
            angle: Angles of the wheels, (W,) rad.
        """
        inputs = firmware_state.make_undisturbed_inputs(self.n)._replace(
            vision_heading=np.full(self.n, vision_heading),
            heading_age=np.full(self.n, age),
            ignores_commands=np.zeros(self.n, bool),
            processor_is_off=np.full(self.n, off),
        )
        if off is not None:
            angles = np.zeros_like(self._s.duty) + np.reshape(angle, (-1, 1))
            self._s = firmware.switch_processors(self._p, self._s, self.cycle, inputs, angles)
        self._s = firmware.correct_heading(self._p, self._s, self.frame, inputs)
        self._s = firmware.derate_motors(self._p, self._s, self.winding)
        self.frame += 1

    def run(self, gyro: float, angle: ArrayLike) -> NDArray:
        """Run a cycle; return duties, (W, n)."""
        angles = np.broadcast_to(np.asarray(angle, float), self._s.duty.shape).copy()
        self._s = firmware.run_wheel_loops(
            self._p, self._s, self.cycle, np.full(self.n, gyro), angles
        )
        self.cycle += 1
        return np.array(self._s.duty)


def drive_motor(
    settings: Settings, voltage: float, speed: ArrayLike, winding: float = 25.0
) -> tuple[NDArray, NDArray]:
    """Return voltages and currents of one motor at speeds of its wheel."""
    speeds = np.atleast_1d(np.asarray(speed, float))[None]
    p = motors_and_drivers.make_motor_parameters([settings] * speeds.size, np.ones_like(speeds))
    state = motors_and_drivers.make_motor_state(
        p, np.full_like(speeds, winding), np.full_like(speeds, 25.0)
    )
    volts, amperes, _ = motors_and_drivers.drive_motors(
        p, state, np.full_like(speeds, voltage), speeds, np.full(speeds.shape[1], True)
    )
    return volts[0], amperes[0]


def heat_motor(settings: Settings, currents: NDArray, speeds: NDArray) -> tuple[NDArray, NDArray]:
    """Return temperatures of winding and housing after each frame.

    Currents, A, and speeds, rad/s, are constant in a frame.
    """
    ones = np.ones((1, 1))
    p = motors_and_drivers.make_motor_parameters([settings], ones)
    sheet = settings.motor
    state = motors_and_drivers.make_motor_state(p, sheet.winding_c * ones, sheet.housing_c * ones)
    temperatures = []
    for current, speed in zip(currents, speeds, strict=True):
        cycles = np.ones((CYCLES, 1, 1))
        state = motors_and_drivers.update_temperatures(p, state, current * cycles, speed * cycles)
        temperatures.append([state.winding[0, 0], state.housing[0, 0]])
    winding, housing = np.array(temperatures).T
    return winding, housing


class Battery:
    """A battery under motors."""

    def __init__(self, settings: Settings) -> None:
        self._p, self.state = battery.make_battery([settings])

    def load(self, voltage: ArrayLike, current: ArrayLike) -> float:
        """Apply motor voltages and currents, (W,); return the battery's current, A."""
        volts, amperes = (np.asarray(values, float)[:, None] for values in (voltage, current))
        source = battery.make_battery_source(self._p, self.state, np.ones(1))
        self.state, current = battery.apply_motor_load(self.state, source, volts, amperes)
        return float(current[0])

    def discharge(self, current: float, frames: int) -> None:
        """Discharge with a current, A."""
        for _ in range(frames):
            self.state = battery.discharge_battery(self._p, self.state, np.array([current]))


def compute_drag(
    settings: list[Settings], velocity: ArrayLike, heading: float = 0.0, **options: Any
) -> wheel_carpet_forces.Drag:
    """Return the drag of robots that translate.

    Args:
        settings: One per robot.
        velocity: World frame, (2,) m/s.
        heading: rad.
        options: `position`, (2,) m. Default: the origin. `load`, N per wheel. Default: 1. `angle`,
            rad. Default: 0. `slip_speed`, rad/s. Default: 0. Fields of `CarpetParameters` to
            replace.
    """
    n, wheels = len(settings), settings[0].wheels.kinematics
    shape = len(wheels.azimuths), n
    position = np.asarray(options.pop("position", np.zeros(2)), float)
    load = np.broadcast_to(options.pop("load", 1.0), shape).copy()
    angle = np.broadcast_to(options.pop("angle", 0.0), shape).copy()
    slip_speed = np.broadcast_to(options.pop("slip_speed", 0.0), shape).copy()
    p = wheel_carpet_forces.make_carpet_parameters(
        settings, wheels, np.ones(shape), np.zeros(shape)
    )
    x, y = np.asarray(velocity, float)
    c, s = np.cos(heading), np.sin(heading)
    values = *position, c, s, c * x + s * y, c * y - s * x, 0.0
    *pose, forward, sideways, turn_rate = (np.full(n, value) for value in values)
    motion = wheel_carpet_forces.ChassisMotion(*pose, (forward, sideways), turn_rate)
    return wheel_carpet_forces.compute_drag(p._replace(**options), motion, load, angle, slip_speed)


def uses_jax(simulation: Simulation) -> bool:
    """Return whether JAX computes a simulation's robots."""
    return isinstance(getattr(simulation.plant, "_backend", None), JaxBackend)


class Motor:
    """A motor by the rows of its datasheet.

    Commutation is the voltage of the nominal row less that of resistance and back-EMF. The torque
    of the no-load row is friction.
    """

    def __init__(self, rows: Mapping[str, float]) -> None:
        self.constant, self.resistance = rows["torque_constant_nm_a"], rows["resistance_ohm"]
        self.gear_ratio = rows["gear_ratio"]
        # V s/rad of the wheel
        self.back_emf = rows.get("torque_factor", 1.0) * self.constant * self.gear_ratio
        speed, current = rows["nominal_rpm"] / RPM, rows["nominal_current_a"]
        drop = rows["nominal_voltage_v"] - self.resistance * current - self.constant * speed
        self._commutation = drop / (current * speed)
        torque, dry = self.constant * rows["no_load_current_a"], rows["dry_friction_fraction"]
        self._dry = dry * torque
        self._viscous = (1 - dry) * torque / (rows["no_load_rpm"] / RPM)

    def friction(self, wheel_speed: Any) -> Any:
        """Return the torque of the motor's friction at the wheel, N m."""
        return self.gear_ratio * (self._dry + self._viscous * self.gear_ratio * np.abs(wheel_speed))

    def series_resistance(self, wheel_speed: Any) -> Any:
        """Return the resistance with that of commutation, ohm."""
        return self.resistance + self._commutation * self.gear_ratio * np.abs(wheel_speed)

    def housing_heat(self, current: Any, wheel_speed: Any) -> Any:
        """Return the heat into the housing, W: X |w| I^2, and the power of friction."""
        drop = self.series_resistance(wheel_speed) - self.resistance
        return drop * np.square(current) + self.friction(wheel_speed) * np.abs(wheel_speed)


def motor_settings(**changes: float) -> MotorSettings:
    """Return settings of the motor `SHEET`, with some fields replaced."""
    return MotorSettings(**SHEET | changes)


MAXON = Motor(SHEET)
ROBOT_MOTORS = {
    name: Motor(robot_files.read_robot_sections(name)["motor"])
    for name in find_builtin_files("robots")
}
DEFAULT_MOTOR = ROBOT_MOTORS[robot_files.DEFAULT_ROBOT]
