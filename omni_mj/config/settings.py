"""All settings of a scenario, in sections. Each field has a meaning, a unit and a range."""

from collections.abc import Iterator, Mapping, Sequence
from functools import cache
from operator import attrgetter
from typing import Any, Self

import numpy as np
from pydantic import Field, SerializeAsAny, field_validator

from omni_control.errors import OmniError, suggest_names
from omni_control.kinematics import Array
from omni_mj.config import fault_checks, faults, robot_files
from omni_mj.config.motor_settings import MotorSettings
from omni_mj.config.network_settings import RadioSettings, VisionSettings
from omni_mj.config.robot_settings import (
    BatterySettings,
    BodySettings,
    DrivetrainSettings,
    FirmwareSettings,
    Mechanics,
    ModelSettings,
    SensorSettings,
    WheelSettings,
)
from omni_mj.config.team_settings import ControlSettings, ReferenceSettings
from omni_mj.config.validation import SettingInfo, SettingsModel, merge_sections
from omni_mj.config.world_settings import (
    CarpetSettings,
    DisturbanceSettings,
    KinematicSettings,
    PhysicsSettings,
    RandomizationSettings,
    WorldSettings,
)

FULL_CELL_V = 4.2  # voltage of a fully charged LiPo cell


class Settings(SettingsModel):
    """All settings of a scenario with a robot.

    `omni_mj.config.resolve.resolve_settings` builds them, with the robot's values as defaults. Each
    section may be given as an instance of its class, or as a mapping from field to value.

    Attributes:
        controller: Label of a controller -> name of a parameter -> value.
        fault: Faults that occur during a run.
    """

    unknown_name = "unknown section"

    reference: ReferenceSettings
    vision: VisionSettings
    radio: RadioSettings
    control: ControlSettings
    firmware: FirmwareSettings
    sensors: SensorSettings
    motor: MotorSettings
    battery: BatterySettings
    drivetrain: DrivetrainSettings
    physics: PhysicsSettings
    model: ModelSettings
    body: BodySettings
    wheels: WheelSettings
    carpet: CarpetSettings
    randomization: RandomizationSettings
    disturbance: DisturbanceSettings
    kinematic: KinematicSettings
    world: WorldSettings
    controller: dict[str, dict[str, Any]] = Field(default_factory=dict)
    fault: tuple[SerializeAsAny[faults.Fault], ...] = ()

    def __hash__(self) -> int:  # without `controller`: dictionaries are not hashable
        return hash((*(getattr(self, name) for name in get_section_classes()), self.fault))

    @field_validator("fault", mode="before")
    @classmethod
    def _parse_faults(cls, value: Any) -> tuple[faults.Fault, ...]:
        return fault_checks.parse_faults(value)

    def find_contradictions(self) -> Iterator[str]:
        """Yield a message for each contradiction between sections."""
        yield from fault_checks.find_fault_contradictions(self.fault, self)
        body, wheels, battery = self.body, self.wheels, self.battery
        margin = wheels.compute_support_margin(body.com_x_m)
        if margin <= 0:
            yield (
                f"body.com_x_m = {body.com_x_m:g} is {-margin * 1e3:.3g} mm outside the polygon of "
                "the wheel contacts (wheels.azimuths_deg, wheels.arm_m); it must be inside, or the "
                "robot tips over"
            )
        if body.yaw_inertia_kg_m2 > 2 * body.tilt_inertia_kg_m2:
            yield (
                f"body.yaw_inertia_kg_m2 = {body.yaw_inertia_kg_m2:g} must be at most twice "
                f"body.tilt_inertia_kg_m2 = {body.tilt_inertia_kg_m2:g}, as for a flat disc"
            )
        full = FULL_CELL_V * battery.series_cells
        if battery.cut_off_v >= full:
            yield (
                f"battery.cut_off_v = {battery.cut_off_v:g} must be below the {full:g} V of "
                f"battery.series_cells = {battery.series_cells} when full "
                f"({FULL_CELL_V} V a cell), or the battery is always off"
            )

    @property
    def hub_friction_nm(self) -> float:
        """Dry friction torque of a motor and its gear, at the wheel, N m."""
        return self.motor.wheel_dry_friction_nm + self.drivetrain.gear_friction_nm

    @property
    def mechanics(self) -> Mechanics:
        """The settings on which the MJCF model of the robot depends."""
        motor = self.motor
        return Mechanics(
            self.body, self.wheels, motor.gear_ratio, motor.rotor_inertia_kg_m2, self.model.file
        )

    def replace(self, **sections: Any) -> Self:
        """Return a validated copy with other values: `settings.replace(radio={"delay_frames": 9})`.

        Raises:
            OmniError: A name is unknown, or a value is not allowed.
        """
        return type(self)(**merge_sections(dict(self), sections))

    def to_dict(self) -> dict[str, Any]:
        """Return a mapping section -> field -> value, and the list of faults, for TOML and JSON."""
        return self.model_dump(mode="json")


@cache
def get_section_classes() -> Mapping[str, type[SettingsModel]]:
    """Return a mapping from section to its class, without `controller` and `fault`."""
    classes = {name: field.annotation for name, field in Settings.model_fields.items()}
    return {
        name: section_class
        for name, section_class in classes.items()
        if isinstance(section_class, type) and issubclass(section_class, SettingsModel)
    }


def list_settings() -> list[SettingInfo]:
    """Return the declarations of all settings in order, with defaults of the default robot."""
    robot_sections = robot_files.read_robot_sections(robot_files.DEFAULT_ROBOT)
    settings = []
    for section, section_class in get_section_classes().items():
        robot_values = robot_sections.get(section, {})
        for field, info in section_class.describe_fields().items():
            settings.append(info._replace(default=robot_values.get(field, info.default)))
    return settings


def find_setting(name: str) -> SettingInfo:
    """Return the declaration of a setting, given by `section.field`.

    Raises:
        OmniError: There is no such setting.
    """
    settings = {setting.full_name: setting for setting in list_settings()}
    if name not in settings:
        raise OmniError(f"unknown setting {name}; {suggest_names(name, settings)}")
    return settings[name]


def gather(settings: Sequence[Any], name: str) -> Array:
    """Return a field, such as `body.mass_kg`, of the settings of n robots as an array (n,)."""
    get_field = attrgetter(name)
    return np.array([float(get_field(robot_settings)) for robot_settings in settings])


for _section, _class in get_section_classes().items():
    _class.section_prefix = f"{_section}."
