"""Every number a scenario can set: small frozen dataclasses whose fields carry unit, bounds and meaning."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from omni_control.kinematics import Array
from omni_control.reference.curves import CURVES
from omni_mj.worlds import robot

FRAME_RATE_HZ = 60  # SSL-Vision's cameras; the clock of everything (paper, section 4)
PERIOD_S = 1 / FRAME_RATE_HZ


def setting(
    default: Any,
    unit: str,
    doc: str,
    low: float | None = None,
    high: float | None = None,
    choices: tuple[str, ...] | None = None,
) -> Any:
    """A dataclass field with its unit, meaning and allowed range; a callable default is read when needed."""
    metadata = {"unit": unit, "doc": doc, "low": low, "high": high, "choices": choices}
    factory: Callable[[], Any] = default if callable(default) else lambda: default
    return field(default_factory=factory, metadata=metadata)


def column(settings: Sequence[Any], name: str) -> Array:
    """A field of one section per robot as an array (n, 1)."""
    return np.array([[float(getattr(s, name))] for s in settings])


@dataclass(frozen=True)
class ReferenceSettings:
    """The task: where the robot shall be when; way-points or a curve, and the limits of moving along it."""

    shape: str = setting(
        "waypoints", "", "what to drive: the way-points given, way-points drawn at random, or a curve",
        choices=("waypoints", "random", *CURVES),
    )  # fmt: skip
    waypoints: list[list[float]] = setting(
        lambda: [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]], "m, m, rad", "poses [x, y, heading] to visit, from the first on"
    )
    length_m: float = setting(2.0, "m", "curve, random: extent in x about the field's centre", 0.1, 20)
    width_m: float = setting(2.0, "m", "curve, random: extent in y", 0.1, 20)
    heading: str = setting(
        "fixed", "", "curve: fixed: heading 0; tangent: facing along the path", choices=("fixed", "tangent")
    )
    count: int = setting(10, "", "random: number of way-points, the start included", 2, 1000)
    seed: int = setting(0, "", "random: what they are drawn from, the same for all seeds of a run", 0, 1_000_000)
    laps: int = setting(1, "", "how many times the way-points are visited, or the curve is driven", 1, 1000)
    mode: str = setting(
        "timed", "", "timed: known in advance; iterated: way-points only, planned anew each frame from the pose",
        choices=("timed", "iterated"),
    )  # fmt: skip
    max_speed_m_s: float = setting(3.159, "m/s", "highest speed of the reference (paper, section 2)", 0.01, 10)
    max_acceleration_m_s2: float = setting(0.826, "m/s^2", "highest acceleration (paper, section 2)", 0.01, 20)
    max_turn_rate_rad_s: float = setting(6.0, "rad/s", "highest turn rate of the reference", 0.01, 30)
    max_turn_acceleration_rad_s2: float = setting(12.0, "rad/s^2", "highest turn acceleration", 0.01, 200)
    lead_s: float = setting(0.25, "s", "rest before the first move; no command acts before the dead time", 0, 60)
    dwell_s: float = setting(0.0, "s", "rest at each way-point", 0, 60)
    settle_s: float = setting(1.0, "s", "rest at the end", 0, 60)


@dataclass(frozen=True)
class VisionSettings:
    """The 60 Hz camera. Noise and misses: "Realistic" of the ER-Force simulator."""

    position_noise_m: float = setting(0.0013, "m", "standard deviation of the position seen, per axis", 0, 1)
    heading_noise_rad: float = setting(0.01, "rad", "standard deviation of the heading seen", 0, 1)
    miss_probability: float = setting(0.02, "", "probability, per frame, that a robot is not seen from then on", 0, 0.9)
    miss_frames: int = setting(1, "frames", "how long it is then not seen", 1, 600)


@dataclass(frozen=True)
class RadioSettings:
    """The radio link from the team's computer to the robot."""

    delay_frames: int = setting(6, "frames", "dead time k_d from command to robot (paper: 0.1 s)", 0, 600)
    jitter_frames: int = setting(0, "frames", "a packet takes up to this more or less, uniformly; newest wins", 0, 600)


@dataclass(frozen=True)
class ControlSettings:
    """The team's computer: what it believes of the robots, the trackers, and the limits of what they may command."""

    delay_error_frames: int = setting(0, "frames", "what it believes the dead time to be, less the true", -600, 600)
    lag_s: float = setting(0.02, "s", "MuJoCo plant: what it believes the lag of the wheel loops to be", 0, 1)
    drag_m_s: float = setting(0.04, "m/s", "MuJoCo plant: what it believes dry friction may cost of the speed", 0, 1)

    error_range_m: float = setting(0.1, "m", "input range of the fuzzy controller (paper, section 4)", 1e-6, 10)
    speed_range_m_s: float = setting(1.0, "m/s", "output range of the fuzzy controller (paper, section 4)", 1e-6, 10)
    heading_gain: float = setting(3.0, "1/s", "turn rate per heading error of the heading hold", 0, 60)
    alpha_window_frames: int = setting(15, "frames", "window n_0 over which alpha is estimated", 1, 600)
    max_speed_m_s: float = setting(3.7, "m/s", "highest commanded speed (ssl-simulation-setup)", 0.01, 20)
    max_acceleration_m_s2: float = setting(4.7, "m/s^2", "highest change of it (ssl-simulation-setup)", 0.01, 1e3)
    max_turn_rate_rad_s: float = setting(26.0, "rad/s", "highest commanded turn rate (same)", 0.01, 100)
    max_turn_acceleration_rad_s2: float = setting(50.8, "rad/s^2", "highest change of it (same)", 0.01, 1e4)


@dataclass(frozen=True)
class FirmwareSettings:
    """What runs on the robot: wheel loops, one PID per wheel at 960 Hz, with gains at the wheel, and heading.

    By default the wheel loops are proportional with feed-forward, as in the firmware of TIGERs (k_i = 0) and
    RoboJackets.
    """

    kp: float = setting(0.3, "V s/rad", "voltage per error of the wheel speed", 0, 100)
    ki: float = setting(0.0, "V/rad", "voltage per integrated error", 0, 1000)
    kd: float = setting(0.0, "V s^2/rad", "voltage per rate of the error", 0, 1)
    feed_forward: float = setting(1.0, "", "share of the wanted speed's back-EMF that is fed forward", 0, 2)
    nominal_voltage_v: float = setting(22.2, "V", "battery voltage that it reckons with (6S LiPo, TIGERs)", 1, 60)
    turn_gain: float = setting(1.0, "", "turn rate added per error of the turn rate that the gyro shows", 0, 10)
    heading_gain: float = setting(2.0, "1/s", "heading corrected per difference to vision's", 0, 30)
    bias_gain: float = setting(0.5, "1/s^2", "gyro bias corrected per difference to vision's heading", 0, 100)
    derate: bool = setting(False, "", "limit the current of a motor that nears its highest winding temperature")


@dataclass(frozen=True)
class SensorSettings:
    """The sensors on the robot."""

    encoder_counts: int = setting(8192, "", "counts per revolution of a motor (TIGERs: 2048 lines)", 1, 1_000_000)
    gyro_noise_rad_s: float = setting(0.005, "rad/s", "standard deviation of the gyro over a frame", 0, 10)
    gyro_bias_rad_s: float = setting(0.01, "rad/s", "standard deviation of its bias, one per seed", 0, 10)


@dataclass(frozen=True)
class MotorSettings:
    """What the model cannot hold of the motors: maxon EC 45 flat 50 W, catalogue page of the 24 V winding."""

    winding_c: float = setting(25.0, "deg C", "temperature of the windings at the start", -20, 200)
    housing_c: float = setting(25.0, "deg C", "temperature of the housings at the start", -20, 200)
    ambient_c: float = setting(25.0, "deg C", "temperature of the air", -20, 60)
    limit_c: float = setting(125.0, "deg C", "highest permissible temperature of the windings", 0, 300)
    winding_housing_k_w: float = setting(8.28, "K/W", "thermal resistance from winding to housing", 0.01, 1e3)
    housing_ambient_k_w: float = setting(1.57, "K/W", "thermal resistance from housing to air", 0.01, 1e3)
    winding_j_k: float = setting(3.48, "J/K", "heat capacity of the winding: 28.8 s / 8.28 K/W", 0.01, 1e4)
    housing_j_k: float = setting(49.9, "J/K", "heat capacity of the housing: 78.3 s / 1.57 K/W", 0.01, 1e5)
    copper_per_k: float = setting(0.00393, "1/K", "rise of the winding's resistance (copper)", 0, 0.1)
    magnet_per_k: float = setting(-0.001, "1/K", "change of the torque constant (NdFeB, typical)", -0.01, 0)
    commutation_ohm_s: float = setting(
        1.27e-3, "ohm s/rad", "commutation's resistance per motor speed; fits the datasheet's nominal point", 0, 1
    )


@dataclass(frozen=True)
class BatterySettings:
    """The battery: 6S LiPo (TIGERs)."""

    charge: float = setting(0.5, "", "state of charge at the start: 1 full (25.2 V), 0.5 nominal (22.2 V)", 0, 1)
    cells: int = setting(6, "", "cells in series", 1, 6)
    capacity_ah: float = setting(1.3, "Ah", "capacity", 0.01, 100)
    resistance_ohm: float = setting(0.08, "ohm", "internal resistance: cells, wires and connectors", 0, 1)
    cut_off_v: float = setting(20.4, "V", "below it, over a second, the battery gives no more power", 0, 60)


@dataclass(frozen=True)
class CarpetSettings:
    """The carpet under the rollers."""

    friction: float = setting(robot.carpet_friction, "", "coefficient of friction, all rollers", 0.01, 5)
    lint: float = setting(
        lambda: robot.numeric("lint"),
        "",
        "rolling resistance in the pile, with lint on the wheels: share of the load",
        0,
        1,
    )


@dataclass(frozen=True)
class PhysicsSettings:
    """The integration."""

    substeps: int = setting(1, "", "physics steps per cycle of the wheel loops, which is the model's 1/960 s", 1, 100)


@dataclass(frozen=True)
class WheelSettings:
    """The wheels."""

    model: str = setting(
        "rollers", "", "rollers: all 16 of each; contact-roller: the one at the carpet, faster",
        choices=("rollers", "contact-roller"),
    )  # fmt: skip


@dataclass(frozen=True)
class DriveSettings:
    """Losses between motor and carpet."""

    gear_friction_nm: float = setting(
        lambda: robot.numeric("gear_friction"), "N m", "dry friction of a gear, at the wheel", 0, 1
    )
    roller_damping_nm_s: float = setting(robot.roller_damping, "N m s/rad", "of a roller's bearing", 0, 2e-5)


@dataclass(frozen=True)
class DisturbanceSettings:
    """A random disturbance, uniform in plus or minus its amplitude, drawn anew per frame and axis (table 4)."""

    velocity_m_s: float = setting(0.0, "m/s", "kinematic plant: amplitude added to equation 7", 0, 10)
    force_n: float = setting(0.0, "N", "MuJoCo plant: amplitude of a force on the chassis", 0, 1000)


@dataclass(frozen=True)
class KinematicSettings:
    """The paper's own plant, equation 7."""

    alpha_low: float = setting(0.7, "", "alpha is drawn uniformly from here ...", 0, 2)
    alpha_high: float = setting(1.0, "", "... to here, per axis (paper, section 2)", 0, 2)
    alpha_time_s: float = setting(0.0, "s", "time over which alpha forgets its value; 0: new in every frame", 0, 1e6)


@dataclass(frozen=True)
class Settings:
    """All sections."""

    reference: ReferenceSettings = field(default_factory=ReferenceSettings)
    vision: VisionSettings = field(default_factory=VisionSettings)
    radio: RadioSettings = field(default_factory=RadioSettings)
    control: ControlSettings = field(default_factory=ControlSettings)
    firmware: FirmwareSettings = field(default_factory=FirmwareSettings)
    sensors: SensorSettings = field(default_factory=SensorSettings)
    motor: MotorSettings = field(default_factory=MotorSettings)
    battery: BatterySettings = field(default_factory=BatterySettings)
    drive: DriveSettings = field(default_factory=DriveSettings)
    physics: PhysicsSettings = field(default_factory=PhysicsSettings)
    wheels: WheelSettings = field(default_factory=WheelSettings)
    carpet: CarpetSettings = field(default_factory=CarpetSettings)
    disturbance: DisturbanceSettings = field(default_factory=DisturbanceSettings)
    kinematic: KinematicSettings = field(default_factory=KinematicSettings)
