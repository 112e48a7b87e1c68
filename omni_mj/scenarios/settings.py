"""Every number a scenario can set: small frozen models whose fields carry unit, bounds and meaning."""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Literal, Self

import numpy as np
from pydantic import ConfigDict, Field, ValidationInfo, field_validator, model_validator

from omni_control.kinematics import Array
from omni_control.reference.curves import CURVES
from omni_mj.scenarios import faults, robot_checks
from omni_mj.scenarios.checking import Checked, Poses, Setting, in_one, setting, shown
from omni_mj.scenarios.clock import CYCLE_RATE_HZ as CYCLE_RATE_HZ
from omni_mj.scenarios.clock import FRAME_RATE_HZ as FRAME_RATE_HZ
from omni_mj.scenarios.clock import PERIOD_S as PERIOD_S
from omni_mj.scenarios.firmware_settings import FirmwareSettings
from omni_mj.scenarios.link_settings import RadioSettings as RadioSettings
from omni_mj.scenarios.link_settings import VisionSettings as VisionSettings
from omni_mj.scenarios.motor_settings import MotorSettings
from omni_mj.scenarios.nested import merged, plain
from omni_mj.scenarios.parameters import Parameters
from omni_mj.scenarios.robot_settings import (
    BodySettings,
    CarpetSettings,
    DriveSettings,
    ModelSettings,
    VariationSettings,
    WheelSettings,
)
from omni_mj.scenarios.robots import follows, of_robot


def column(settings: Sequence[Any], name: str) -> Array:
    """A field of one section per robot as an array (n, 1)."""
    first = settings[0]
    if all(each is first for each in settings):
        return np.full((len(settings), 1), float(getattr(first, name)))
    return np.array([[float(getattr(each, name))] for each in settings])


class ReferenceSettings(Checked):
    """The task: where the robot shall be when; way-points or a curve, and the limits of moving along it."""

    shape: Literal["waypoints", "random", *CURVES] = setting(  # type: ignore[valid-type]
        "waypoints", "", "what to drive: the way-points given, way-points drawn at random, or a curve"
    )
    waypoints: Poses = setting(
        ((0.0, 0.0, 0.0), (1.0, 0.0, 0.0)), "m, m, rad", "poses [x, y, heading] to visit, from the first on", 2
    )
    length_m: float = setting(2.0, "m", "curve, random: extent in x about the field's centre", 0.1, 20)
    width_m: float = setting(2.0, "m", "curve, random: extent in y", 0.1, 20)
    heading: Literal["fixed", "tangent"] = setting("fixed", "", "curve: fixed: heading 0; tangent: facing along it")
    count: int = setting(10, "", "random: number of way-points, the start included", 2, 1000)
    seed: int = setting(0, "", "random: what they are drawn from, the same for all seeds of a run", 0, 1_000_000)
    laps: int = setting(1, "", "how many times the way-points are visited, or the curve is driven", 1, 1000)
    mode: Literal["timed", "iterated"] = setting(
        "timed", "", "timed: known in advance; iterated: way-points only, planned anew each frame from the pose"
    )
    max_speed_m_s: float = setting(3.159, "m/s", "highest speed of the reference (paper, section 2)", 0.01, 10)
    max_acceleration_m_s2: float = setting(0.826, "m/s^2", "highest acceleration (paper, section 2)", 0.01, 20)
    max_side_acceleration_m_s2: float = setting(0.0, "m/s^2", "same, along the body's y; 0: as along its x", 0, 20)
    max_turn_rate_rad_s: float = setting(6.0, "rad/s", "highest turn rate of the reference", 0.01, 30)
    max_turn_acceleration_rad_s2: float = setting(12.0, "rad/s^2", "highest turn acceleration", 0.01, 200)
    max_jerk_m_s3: float = setting(
        0.0, "m/s^3", "highest change of the acceleration; 0: any. Not for iterated: disturbances set its pace", 0, 1e4
    )
    max_turn_jerk_rad_s3: float = setting(0.0, "rad/s^3", "highest change of the turn acceleration; same", 0, 1e5)
    friction: float = setting(
        0.8, "", "believed of the carpet: what wheels cannot do on it is driven slower; 0: wheels not regarded", 0, 5
    )
    wheel_share: float = setting(
        0.85, "", "how much of what wheels can do the reference asks at most; the rest is for the controller", 0.1, 1
    )
    lead_s: float = setting(0.25, "s", "rest before the first move; no command acts before the dead time", 0, 60)
    dwell_s: float = setting(0.0, "s", "rest at each way-point", 0, 60)
    settle_s: float = setting(1.0, "s", "rest at the end", 0, 60)

    @model_validator(mode="after")
    def _plannable(self) -> Self:
        if wrong := "\n".join(self._contradictions()):
            raise ValueError(wrong)
        return self

    def _contradictions(self) -> Iterator[str]:
        """What no reference can be, a line each."""
        if self.mode == "iterated" and self.shape in CURVES:
            yield (
                "reference.mode = iterated plans from way-point to way-point, of which a curve has none; "
                f"reference.shape = {self.shape} needs reference.mode = timed"
            )
        if 0 < self.max_side_acceleration_m_s2 < 0.01:
            yield "reference.max_side_acceleration_m_s2 must be 0, for the same as ahead, or at least 0.01"
        for name in ("max_jerk_m_s3", "max_turn_jerk_rad_s3"):
            if 0 < (jerk := getattr(self, name)) < 0.1:
                yield f"reference.{name} must be 0, for none, or at least 0.1"
            if jerk and self.mode == "iterated":
                yield (
                    f"reference.{name} needs reference.mode = timed: iterated plans anew in each frame from where the "
                    "robot is, which disturbances change at once"
                )


class ControlSettings(Checked):
    """The team's computer: what it believes of the robots, the controllers, and the limits of what they may command."""

    delay_error_frames: int = setting(0, "frames", "what it believes the dead time to be, less the true", -600, 600)
    lag_s: float = setting(
        follows("lag_s"),
        "s",
        "MuJoCo plant: what it believes the lag of the wheel loops to be; by default that of the robot's gains",
        0,
        1,
    )
    drag_m_s: float = setting(
        follows("drag_m_s"),
        "m/s",
        "MuJoCo plant: what it believes dry friction may cost of the speed; by default what it costs by these gains",
        0,
        1,
    )
    creep_s2_m: float = setting(
        follows("creep_s2_m"),
        "s^2/m",
        "MuJoCo plant: what it believes wheels to creep, forward (TIGERs: 0.038 to 0.06); by default by their law",
        0,
        1,
    )
    creep_sideways_s2_m: float = setting(
        follows("creep_sideways_s2_m"), "s^2/m", "the same sideways (TIGERs: 0.082 to 0.155)", 0, 1
    )
    alpha_forward: float = setting(
        follows("alpha_forward"),
        "",
        "MuJoCo plant: what it believes robots to reach of a command ahead; by default by that law; 0: not known",
        0,
        2,
    )
    alpha_sideways: float = setting(follows("alpha_sideways"), "", "the same aside (TIGERs: 0.79 to 0.97)", 0, 2)

    error_range_m: float = setting(0.1, "m", "input range of the fuzzy controller (paper, section 4)", 1e-6, 10)
    speed_range_m_s: float = setting(1.0, "m/s", "output range of the fuzzy controller (paper, section 4)", 1e-6, 10)
    heading_gain: float = setting(3.0, "1/s", "turn rate per heading error of the heading hold", 0, 60)
    alpha_window_frames: int = setting(15, "frames", "window n_0 over which alpha is estimated", 1, 600)
    max_speed_m_s: float = setting(3.7, "m/s", "highest commanded speed (ssl-simulation-setup)", 0.01, 20)
    max_acceleration_m_s2: float = setting(4.7, "m/s^2", "highest change of it (ssl-simulation-setup)", 0.01, 1e3)
    max_turn_rate_rad_s: float = setting(26.0, "rad/s", "highest commanded turn rate (same)", 0.01, 100)
    max_turn_acceleration_rad_s2: float = setting(50.8, "rad/s^2", "highest change of it (same)", 0.01, 1e4)


class SensorSettings(Checked):
    """The sensors on the robot."""

    encoder_counts: int = setting(
        of_robot("sensors.encoder_counts"), "", "counts per revolution of a motor", 1, 1_000_000
    )
    gyro_noise_rad_s: float = setting(0.005, "rad/s", "standard deviation of the gyro over a frame", 0, 10)
    gyro_bias_rad_s: float = setting(0.01, "rad/s", "standard deviation of its bias, one per seed", 0, 10)


class BatterySettings(Checked):
    """The battery: LiPo."""

    charge: float = setting(0.5, "", "state of charge at the start: 1 full (4.2 V a cell), 0.5 nominal (3.7 V)", 0, 1)
    cells: int = setting(of_robot("battery.cells"), "", "cells in series", 1, 6)
    capacity_ah: float = setting(of_robot("battery.capacity_ah"), "Ah", "capacity", 0.01, 100)
    resistance_ohm: float = setting(
        of_robot("battery.resistance_ohm"), "ohm", "internal resistance: cells, wires and connectors", 0, 1
    )
    cut_off_v: float = setting(
        of_robot("battery.cut_off_v"), "V", "below it, over a second, the battery gives no more power", 0, 60
    )


class PhysicsSettings(Checked):
    """The integration."""

    substeps: int = setting(1, "", "physics steps per cycle of the wheel loops, which is the model's 1/960 s", 1, 100)
    kernel: Literal["numpy", "numba"] = setting(
        "numpy", "", "what reckons between the steps; numba is faster, needs the extra fast, and rounds otherwise"
    )


class DisturbanceSettings(Checked):
    """A random disturbance, uniform in plus or minus its amplitude, drawn anew per frame and axis (table 4)."""

    velocity_m_s: float = setting(0.0, "m/s", "kinematic plant: amplitude added to equation 7", 0, 10)
    force_n: float = setting(0.0, "N", "plants with wheels: amplitude of a force on the chassis", 0, 1000)


class KinematicSettings(Checked):
    """The paper's own plant, equation 7."""

    alpha_low: float = setting(0.7, "", "alpha is drawn uniformly from here ...", 0, 2)
    alpha_high: float = setting(1.0, "", "... to here, per axis (paper, section 2)", 0, 2)
    alpha_time_s: float = setting(0.0, "s", "time over which alpha forgets its value; 0: new in every frame", 0, 1e6)

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        if self.alpha_low > self.alpha_high:
            raise ValueError("kinematic.alpha_low must not be above kinematic.alpha_high")
        return self


class WorldSettings(Checked):
    """The world that robots share."""

    places: Poses = setting(
        ((0.0, 0.0, 0.0),), "m, m, rad", "where its robots stand: each drives the reference displaced by it", 1, 12
    )


class Settings(Checked):
    """All sections; `controller` holds those of controllers' parameters, `fault` what happens in a run.

    Each is given as a model, or as its fields that differ from the defaults: `Settings(radio={"delay_frames": 9})`.
    """

    model_config = ConfigDict(arbitrary_types_allowed=True)
    unknown = "unknown section"

    reference: ReferenceSettings = Field(default_factory=ReferenceSettings)
    vision: VisionSettings = Field(default_factory=VisionSettings)
    radio: RadioSettings = Field(default_factory=RadioSettings)
    control: ControlSettings = Field(default_factory=ControlSettings)
    firmware: FirmwareSettings = Field(default_factory=FirmwareSettings)
    sensors: SensorSettings = Field(default_factory=SensorSettings)
    motor: MotorSettings = Field(default_factory=MotorSettings)
    battery: BatterySettings = Field(default_factory=BatterySettings)
    drive: DriveSettings = Field(default_factory=DriveSettings)
    physics: PhysicsSettings = Field(default_factory=PhysicsSettings)
    model: ModelSettings = Field(default_factory=ModelSettings)
    body: BodySettings = Field(default_factory=BodySettings)
    wheels: WheelSettings = Field(default_factory=WheelSettings)
    carpet: CarpetSettings = Field(default_factory=CarpetSettings)
    variation: VariationSettings = Field(default_factory=VariationSettings)
    disturbance: DisturbanceSettings = Field(default_factory=DisturbanceSettings)
    kinematic: KinematicSettings = Field(default_factory=KinematicSettings)
    world: WorldSettings = Field(default_factory=WorldSettings)
    controller: Parameters = Field(default_factory=Parameters)
    fault: tuple[faults.Fault, ...] = ()

    @field_validator("*", mode="before")
    @classmethod
    def _section(cls, value: Any, info: ValidationInfo) -> Any:
        name = str(info.field_name)
        if name == "fault":
            return faults.made(value)
        kind: Any = cls.model_fields[name].annotation
        if isinstance(value, kind):
            return value
        if name == "model" and isinstance(value, (str, Path)):  # in short
            value = {"file": str(value)}
        if not isinstance(value, Mapping):
            raise ValueError(f"{name} is a section: write [{name}] and its fields below, not {shown(value)}")
        return kind(**value)

    @model_validator(mode="after")
    def _can_happen(self) -> Self:
        in_one([*faults.misfits(self.fault, self), *robot_checks.robot(self)])
        return self

    def replace(self, **sections: Any) -> Self:
        """A copy with other values: `settings.replace(radio={"delay_frames": 9}, carpet=CarpetSettings())`.

        Raises:
            OmniError: an unknown name, or a value that is not allowed.
        """
        return type(self)(**merged(dict(self), sections))

    def plain(self) -> dict[str, Any]:
        """All values by section and field, and the faults as a list, as TOML and JSON hold them."""
        sections = {name: plain(dict(section)) for name, section in self if name != "fault"}
        return sections | {"fault": [plain(each.values()) for each in self.fault]}

    def items(self) -> Iterator[tuple[Setting, Any]]:
        """Every setting's declaration and value, but for the parameters of controllers."""
        for _, section in self:
            if isinstance(section, Checked):
                yield from ((declared, getattr(section, declared.name)) for declared in section.declared())


def _sections() -> dict[str, type[Checked]]:
    """The class of each section, by name, but for the parameters of controllers."""
    kinds = {name: field.annotation for name, field in Settings.model_fields.items()}
    return {name: kind for name, kind in kinds.items() if isinstance(kind, type) and issubclass(kind, Checked)}


def every_setting() -> list[Setting]:
    """What is declared of every setting of every section, in order."""
    return [declared for kind in _sections().values() for declared in kind.declared()]


for _name, _kind in _sections().items():
    _kind.section = _name
