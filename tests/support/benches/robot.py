"""A test bench for what a robot carries: its motors, battery, firmware and wheels, without a body."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from omni_mj.config import robot_files
from omni_mj.config.motor_settings import MotorSettings
from omni_mj.config.robot_files import find_builtin_robots
from omni_mj.config.settings import Settings
from omni_mj.robot import battery, carpet, firmware, firmware_state, motors, onboard
from omni_mj.robot.backends import JaxBackend
from omni_mj.simulation.simulation import Simulation

RPM = 30 / np.pi  # turns per minute in a rad/s
# maxon's catalogue, EC 45 flat 50 W 24 V, as settings of `motor`; behind 60:18, with a quarter of
# its friction dry.
SHEET = {
    "nominal_voltage_v": 24.0,
    "no_load_rpm": 6250.0,
    "no_load_current_a": 0.238,
    "nominal_rpm": 5170.0,
    "nominal_torque_nm": 0.0911,
    "nominal_current_a": 2.52,
    "resistance_ohm": 0.942,
    "torque_constant_nm_a": 0.036,
    "rotor_inertia_kg_m2": 1.35e-5,
    "gear_ratio": 60 / 18,
    "dry_friction_fraction": 0.25,
}
FRAME_S, CYCLES = 1 / 60, 16
Carried = tuple[onboard.OnboardParameters, onboard.OnboardState]


def carried(settings: list[Settings], heading: float = 0.0, restarts: bool = False) -> Carried:
    """What robots carry, switched on at a heading."""
    n, wheels = len(settings), settings[0].wheels.kinematics
    magnet_factor = np.ones((len(wheels.azimuths), n))
    return onboard.make_onboard(settings, wheels, np.full(n, heading), magnet_factor, 30, restarts)


def command(
    x: float = 0.0, y: float = 0.0, turn: float = 0.0, n: int = 1, **more: Any
) -> firmware_state.FirmwareCommand:
    """One command for all robots."""
    values = [np.full(n, each) for each in (x, y, turn)]
    return firmware_state.FirmwareCommand(*values, np.ones(n, bool))._replace(**more)


class Firmware:
    """Firmware of n robots, fed with a gyro and encoders; its duties are recorded."""

    def __init__(
        self, settings: list[Settings], heading: float = 0.0, restarts: bool = False
    ) -> None:
        (self.p, state) = carried(settings, heading, restarts)
        self._p, self._s, self.n, self.cycle, self.frame = (
            self.p.firmware,
            state.firmware,
            len(settings),
            0,
            0,
        )
        self.winding = state.motors.winding

    @property
    def heading(self) -> NDArray:
        """Estimated headings, (n,) rad."""
        return np.array(self._s.heading)

    def hear(self, **values: Any) -> None:
        """Accept a command."""
        self._s = firmware.accept_command(self._p, self._s, self.cycle, command(n=self.n, **values))

    def put_down(self, heading: float) -> None:
        """Tell all robots the heading at which somebody has put them down."""
        self._s = firmware.set_heading(self._s, np.ones(self.n, bool), np.full(self.n, heading))

    def begin(self, seen: ArrayLike = np.nan, age: int = 0, off: bool | None = None) -> None:
        """Begin a frame in which vision's heading arrives, and processors may be off."""
        deaf = np.zeros(self.n, bool)
        if off is not None:
            angle = np.zeros_like(self._s.duty)
            self._s = firmware.switch_processors(
                self._p, self._s, self.cycle, deaf, np.full(self.n, off), angle
            )
        ages = np.full(self.n, age)
        self._s = firmware.correct_heading(
            self._p, self._s, self.frame, np.full(self.n, seen), ages, deaf
        )
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
    """Voltages and currents of one motor at speeds of its wheel."""
    speeds = np.atleast_1d(np.asarray(speed, float))[None]
    p = motors.make_motor_parameters([settings] * speeds.size, np.ones_like(speeds))
    state = motors.make_motor_state(p, np.full_like(speeds, winding), np.full_like(speeds, 25.0))
    volts, amperes, _ = motors.drive_motors(p, state, np.full_like(speeds, voltage), speeds)
    return volts[0], amperes[0]


def heat_motor(settings: Settings, currents: NDArray, speeds: NDArray) -> tuple[NDArray, NDArray]:
    """Temperatures of winding and housing after each frame of a constant current, A, and speed, rad/s."""
    p = motors.make_motor_parameters([settings], np.ones((1, 1)))
    one = np.ones((1, 1))
    state = motors.make_motor_state(
        p, settings.motor.winding_c * one, settings.motor.housing_c * one
    )
    result = []
    for current, speed in zip(currents, speeds, strict=True):
        cycles = np.ones((CYCLES, 1, 1))
        state = motors.update_temperatures(p, state, current * cycles, speed * cycles)
        result.append([state.winding[0, 0], state.housing[0, 0]])
    winding, housing = np.array(result).T
    return winding, housing


class Battery:
    """A battery under motors."""

    def __init__(self, settings: Settings) -> None:
        self._p, self.state = battery.make_battery([settings])

    def load(self, voltage: ArrayLike, current: ArrayLike) -> float:
        """Load it with motors' voltages and currents (W,); return the current drawn, A."""
        volts, amperes = (np.asarray(each, float)[:, None] for each in (voltage, current))
        source = battery.make_source(self._p, self.state, np.ones(1))
        self.state, drawn = battery.apply_motor_load(self.state, source, volts, amperes)
        return float(drawn[0])

    def discharge(self, current: float, frames: int) -> None:
        """Draw a current, A."""
        for _ in range(frames):
            self.state = battery.discharge_battery(self._p, self.state, np.array([current]))


def drag(
    settings: list[Settings], velocity: ArrayLike, heading: float = 0.0, **more: Any
) -> carpet.Drag:
    """Drag of robots at the origin that go at a velocity (2,) in the world, with 1 N on each wheel.

    Args:
        settings: One per robot.
        velocity: m/s.
        heading: rad.
        more: Fields of `CarpetParameters` to replace; `place`, `load` and `angle`.
    """
    n, wheels = len(settings), settings[0].wheels.kinematics
    shape = len(wheels.azimuths), n
    place = np.asarray(more.pop("place", np.zeros(2)), float)
    load = np.broadcast_to(more.pop("load", 1.0), shape).copy()
    angle = np.broadcast_to(more.pop("angle", 0.0), shape).copy()
    p = carpet.make_carpet_parameters(settings, wheels, np.ones(shape), np.zeros(shape))._replace(
        **more
    )
    x, y = np.asarray(velocity, float)
    c, s = np.cos(heading), np.sin(heading)
    values = place[0], place[1], c, s, c * x + s * y, c * y - s * x, 0.0
    return carpet.compute_drag(
        p, carpet.ChassisMotion(*(np.full(n, value) for value in values)), load, angle
    )


def uses_jax(simulation: Simulation) -> bool:
    """Return whether JAX computes a simulation's robots."""
    return isinstance(getattr(simulation.plant, "_backend", None), JaxBackend)


class Motor:
    """A motor by the rows of its sheet; commutation, dry and viscous friction are at its shaft.

    Resistance and back-EMF of the nominal row leave a voltage for commutation; the no-load row's
    torque is friction.
    """

    def __init__(self, rows: Mapping[str, float]) -> None:
        self.constant, self.resistance, self.gear_ratio = (
            rows["torque_constant_nm_a"],
            rows["resistance_ohm"],
            rows["gear_ratio"],
        )
        self.back_emf = self.constant * self.gear_ratio  # V s/rad of the wheel
        speed, current = rows["nominal_rpm"] / RPM, rows["nominal_current_a"]
        left = rows["nominal_voltage_v"] - self.resistance * current - self.constant * speed
        self._commutation = left / (current * speed)
        lost = self.constant * rows["no_load_current_a"]
        self._dry, self._viscous = (
            np.array([rows["dry_friction_fraction"], 1 - rows["dry_friction_fraction"]]) * lost
        )
        self._viscous /= rows["no_load_rpm"] / RPM

    def friction(self, wheel_speed: Any) -> Any:
        """Torque of the motor's own friction at the wheel, N m."""
        return self.gear_ratio * (self._dry + self._viscous * self.gear_ratio * np.abs(wheel_speed))

    def series(self, wheel_speed: Any) -> Any:
        """Resistance with commutation's part, ohm."""
        return self.resistance + self._commutation * self.gear_ratio * np.abs(wheel_speed)

    def outer_loss(self, current: Any, wheel_speed: Any) -> Any:
        """Heat of a housing, W: commutation's X |w| i^2, and the power of dry and viscous friction."""
        drop = self.series(wheel_speed) - self.resistance
        return drop * np.square(current) + self.friction(wheel_speed) * np.abs(wheel_speed)


def sheet(**changes: float) -> MotorSettings:
    """The motor of 24 V, with other values of some fields."""
    return MotorSettings(**SHEET | changes)


MAXON = Motor(SHEET)
ROBOTS = {
    name: Motor(robot_files.read_robot_sections(name)["motor"]) for name in find_builtin_robots()
}
OWN = ROBOTS[robot_files.DEFAULT_ROBOT]
