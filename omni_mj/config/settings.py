"""Every number a scenario can set: small frozen models whose fields carry unit, bounds and meaning."""

from collections.abc import Iterator, Sequence
from operator import attrgetter
from typing import Any, Literal, Self

import numpy as np
from pydantic import Field, SerializeAsAny, field_validator, model_validator

from omni_control.kinematics import Array
from omni_control.reference.curves import CURVES
from omni_mj.config import CYCLE_RATE_HZ as CYCLE_RATE_HZ
from omni_mj.config import FRAME_RATE_HZ as FRAME_RATE_HZ
from omni_mj.config import PERIOD_S as PERIOD_S
from omni_mj.config import faults, nominal_model, robot_files
from omni_mj.config.motor_settings import MotorSettings
from omni_mj.config.robot_settings import BatterySettings as BatterySettings
from omni_mj.config.robot_settings import (
    BodySettings,
    CarpetSettings,
    DrivetrainSettings,
    FirmwareSettings,
    ModelSettings,
    RandomizationSettings,
    SensorSettings,
    WheelSettings,
    compute_support_margin,
)
from omni_mj.config.validation import Poses, SettingInfo, SettingsModel, merge_sections, setting

FULL_CELL_V = 4.2  # of a LiPo cell


def gather(settings: Sequence[Any], name: str) -> Array:
    """Return a field, such as `body.mass_kg` of all settings, of one object per robot as an array (n,)."""
    field = attrgetter(name)
    return np.array([float(field(each)) for each in settings])


class ReferenceSettings(SettingsModel):
    """The task: where the robot shall be when; way-points or a curve, and the limits of moving along it."""

    shape: Literal["waypoints", "random", *CURVES] = setting(  # type: ignore[valid-type]
        "waypoints",
        "",
        "what to drive: the way-points given, way-points drawn at random, or a curve",
    )
    waypoints: Poses = setting(
        ((0.0, 0.0, 0.0), (1.0, 0.0, 0.0)),
        "m, m, rad",
        "poses [x, y, heading] to visit, from the first on",
        2,
    )
    length_m: float = setting(
        2.0, "m", "curve, random: extent in x about the field's centre", 0.1, 20
    )
    width_m: float = setting(2.0, "m", "curve, random: extent in y", 0.1, 20)
    heading: Literal["fixed", "tangent"] = setting(
        "fixed", "", "curve: fixed: heading 0; tangent: facing along it"
    )
    waypoint_count: int = setting(
        10, "", "random: number of way-points, the start included", 2, 1000
    )
    seed: int = setting(
        0, "", "random: what they are drawn from, the same for all seeds of a run", 0, 1_000_000
    )
    laps: int = setting(
        1, "", "how many times the way-points are visited, or the curve is driven", 1, 1000
    )
    mode: Literal["timed", "iterated"] = setting(
        "timed",
        "",
        "timed: known in advance; iterated: way-points only, planned anew each frame from the pose",
    )
    max_speed_m_s: float = setting(
        3.159, "m/s", "highest speed of the reference (paper, section 2)", 0.01, 10
    )
    max_acceleration_m_s2: float = setting(
        0.826, "m/s^2", "highest acceleration (paper, section 2)", 0.01, 20
    )
    max_sideways_acceleration_m_s2: float = setting(
        0.0, "m/s^2", "same, along the body's y; 0: as along its x", 0, 20
    )
    max_turn_rate_rad_s: float = setting(
        6.0, "rad/s", "highest turn rate of the reference", 0.01, 30
    )
    max_turn_acceleration_rad_s2: float = setting(
        12.0, "rad/s^2", "highest turn acceleration", 0.01, 200
    )
    max_jerk_m_s3: float = setting(
        0.0,
        "m/s^3",
        "highest change of the acceleration; 0: any. Not for iterated: disturbances set its pace",
        0,
        1e4,
    )
    max_turn_jerk_rad_s3: float = setting(
        0.0, "rad/s^3", "highest change of the turn acceleration; same", 0, 1e5
    )
    assumed_friction: float = setting(
        0.8,
        "",
        "believed of the carpet: what wheels cannot do on it is driven slower; 0: wheels not regarded",
        0,
        5,
    )
    wheel_utilization: float = setting(
        0.85,
        "",
        "how much of what wheels can do the reference asks at most; the rest is for the controller",
        0.1,
        1,
    )
    initial_rest_s: float = setting(
        0.25, "s", "rest before the first move; no command acts before the dead time", 0, 60
    )
    dwell_s: float = setting(0.0, "s", "rest at each way-point", 0, 60)
    settle_s: float = setting(1.0, "s", "rest at the end", 0, 60)

    def find_contradictions(self) -> Iterator[str]:
        """Yield what no reference can be, a line each."""
        if self.mode == "iterated" and self.shape in CURVES:
            yield (
                "reference.mode = iterated plans from way-point to way-point, of which a curve has none; "
                f"reference.shape = {self.shape} needs reference.mode = timed"
            )
        if self.mode == "iterated" and (self.max_jerk_m_s3 or self.max_turn_jerk_rad_s3):
            yield (
                "reference.max_jerk_m_s3 and max_turn_jerk_rad_s3 need reference.mode = timed: iterated plans anew in "
                "each frame from where the robot is, which disturbances change at once"
            )


class VisionSettings(SettingsModel):
    """The cameras. Noise and misses: "Realistic" of the ER-Force simulator."""

    position_noise_m: float = setting(
        0.0013, "m", "standard deviation of the position seen, per axis", 0, 1
    )
    heading_noise_rad: float = setting(0.01, "rad", "standard deviation of the heading seen", 0, 1)
    miss_probability: float = setting(
        0.02, "", "probability, per frame, that a robot is not seen from then on", 0, 0.9
    )
    miss_frames: int = setting(1, "frames", "how long it is then not seen", 1, 600)
    rate_hz: float = setting(
        float(FRAME_RATE_HZ), "Hz", "images of a camera per second, by a clock of its own", 10, 960
    )
    delay_s: float = setting(0.0, "s", "from an image to its packet's arrival", 0, 1)
    jitter_s: float = setting(0.0, "s", "a packet takes up to this longer, uniformly", 0, 1)
    loss_probability: float = setting(
        0.0, "", "probability that a packet, of one camera's image, never arrives", 0, 0.95
    )
    cameras: int = setting(
        1,
        "",
        "serve: how many share the field: 2 or 3 side by side along it, 4 a quarter each",
        1,
        4,
    )
    overlap_m: float = setting(0.4, "m", "serve: width of the strips that two cameras see", 0, 4)
    camera_offset_m: float = setting(
        0.0,
        "m",
        "serve: standard deviation, per axis, by which a camera is out of place (seen: 0.02)",
        0,
        0.5,
    )
    clock_offset_s: float = setting(
        0.0, "s", "serve: standard deviation by which a camera's clock is off", 0, 10
    )


class RadioSettings(SettingsModel):
    """The radio link from the team's computer to the robot."""

    delay_frames: int = setting(
        6, "frames", "dead time k_d from command to robot (paper: 0.1 s)", 0, 600
    )
    jitter_frames: int = setting(
        0, "frames", "a packet takes up to this more or less, uniformly; newest wins", 0, 600
    )
    loss_probability: float = setting(0.0, "", "probability that a packet never arrives", 0, 0.95)

    def find_contradictions(self) -> Iterator[str]:
        """Yield what a radio cannot do."""
        if self.jitter_frames > self.delay_frames:
            yield "radio.jitter_frames must not be above radio.delay_frames: no packet arrives before it is sent"


class ControlSettings(SettingsModel):
    """The team's computer: what it believes of the robots, the controllers, and the limits of what they may command.

    What has no default here follows from the robot's numbers.
    """

    delay_error_frames: int = setting(
        0, "frames", "what it believes the dead time to be, less the true", -600, 600
    )
    assumed_lag_s: float = setting(
        None,
        "s",
        "Plants with wheels: what it believes the wheel loops' lag to be; by default that of its gains; 0: not known",
        0,
        1,
    )
    assumed_drag_m_s: float = setting(
        None,
        "m/s",
        "Plants with wheels: what it believes dry friction costs of the speed; by default by its gains; 0: not known",
        0,
        1,
    )
    assumed_creep_s2_m: float = setting(
        None,
        "s^2/m",
        "Plants with wheels: what it believes wheels to creep, forward (TIGERs: 0.038 to 0.06); 0: not known",
        0,
        1,
    )
    assumed_creep_sideways_s2_m: float = setting(
        None, "s^2/m", "the same sideways (TIGERs: 0.082 to 0.155)", 0, 1
    )
    assumed_alpha_forward: float = setting(
        None,
        "",
        "Plants with wheels: what it believes robots to reach of a command ahead; by default by that law; 0: not known",
        0,
        2,
    )
    assumed_alpha_sideways: float = setting(None, "", "the same aside (TIGERs: 0.79 to 0.97)", 0, 2)

    error_range_m: float = setting(
        0.1, "m", "input range of the fuzzy controller (paper, section 4)", 1e-6, 10
    )
    speed_range_m_s: float = setting(
        1.0, "m/s", "output range of the fuzzy controller (paper, section 4)", 1e-6, 10
    )
    heading_gain: float = setting(
        3.0, "1/s", "turn rate per heading error of the heading hold", 0, 60
    )
    alpha_window_frames: int = setting(
        15, "frames", "window n_0 over which alpha is estimated", 1, 600
    )
    max_speed_m_s: float = setting(
        3.7, "m/s", "highest commanded speed (ssl-simulation-setup)", 0.01, 20
    )
    max_acceleration_m_s2: float = setting(
        4.7, "m/s^2", "highest change of it (ssl-simulation-setup)", 0.01, 1e3
    )
    max_turn_rate_rad_s: float = setting(
        26.0, "rad/s", "highest commanded turn rate (same)", 0.01, 100
    )
    max_turn_acceleration_rad_s2: float = setting(
        50.8, "rad/s^2", "highest change of it (same)", 0.01, 1e4
    )


class PhysicsSettings(SettingsModel):
    """The integration."""

    substeps: int = setting(
        1, "", "physics steps per cycle of the wheel loops, which is the model's 1/960 s", 1, 100
    )
    backend: Literal["auto", "numpy", "jax"] = setting(
        "auto",
        "",
        "what computes robots: numpy, or JAX (extra fast), which rounds differently; auto: the faster",
    )


class DisturbanceSettings(SettingsModel):
    """A random disturbance, uniform in plus or minus its amplitude, drawn anew per frame and axis (table 4)."""

    velocity_m_s: float = setting(
        0.0, "m/s", "kinematic plant: amplitude added to equation 7", 0, 10
    )
    force_n: float = setting(
        0.0, "N", "plants with wheels: amplitude of a force on the chassis", 0, 1000
    )


class KinematicSettings(SettingsModel):
    """The paper's own plant, equation 7."""

    alpha_low: float = setting(0.7, "", "alpha is drawn uniformly from here ...", 0, 2)
    alpha_high: float = setting(1.0, "", "... to here, per axis (paper, section 2)", 0, 2)
    alpha_correlation_time_s: float = setting(
        0.0, "s", "time over which alpha forgets its value; 0: new in every frame", 0, 1e6
    )

    def find_contradictions(self) -> Iterator[str]:
        """Yield what alpha cannot be."""
        if self.alpha_low > self.alpha_high:
            yield "kinematic.alpha_low must not be above kinematic.alpha_high"


class WorldSettings(SettingsModel):
    """The world that robots share."""

    start_poses: Poses = setting(
        ((0.0, 0.0, 0.0),),
        "m, m, rad",
        "where its robots stand: each drives the reference displaced by it",
        1,
        12,
    )


class Settings(SettingsModel):
    """All sections; `controller` holds the parameters of controllers by label, `fault` what happens in a run.

    Each is given as a model, or as its fields that differ from the defaults:
    `Settings(radio={"delay_frames": 9})`. Defaults of what depends on the robot, `...` in the
    sections' classes, are those of the default robot's file.
    """

    unknown = "unknown section"

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

    def __hash__(self) -> int:
        return hash((*(getattr(self, name) for name in get_section_classes()), self.fault))

    def __init__(self, /, **given: Any) -> None:
        hardware = {
            name: own
            for name, own in robot_files.read_robot_sections(robot_files.DEFAULT_ROBOT).items()
            if name != "control"
        }
        super().__init__(
            **merge_sections({name: {} for name in get_section_classes()} | hardware, given)
        )

    @field_validator("fault", mode="before")
    @classmethod
    def _faults(cls, value: Any) -> tuple[faults.Fault, ...]:
        return faults.parse_faults(value)

    @model_validator(mode="after")
    def _tell_team(self) -> Self:
        """Set what the team believes of the robot where nothing else is said."""
        missing = [name for name, value in self.control if value is None]
        if missing:
            found = nominal_model.derive_assumptions(self, self.control.assumed_creep_s2_m)
            control = self.control.replace(**{name: found[name] for name in missing})
            object.__setattr__(self, "control", control)
        return self

    def find_contradictions(self) -> Iterator[str]:
        """Yield what no robot can be, a line each: a body that tips over or has no such inertia, a dead battery."""
        yield from faults.find_settings_conflicts(self.fault, self)
        body, placed, battery = self.body, self.wheels, self.battery
        inside = compute_support_margin(placed.azimuths_deg, placed.arm_m, body.com_x_m)
        if inside <= 0:
            yield (
                f"body.com_x_m = {body.com_x_m:g} is {-inside * 1e3:.3g} mm outside the polygon of the wheels' "
                "contacts (wheels.azimuths_deg, wheels.arm_m): the robot would tip over as it stands; it must be inside"
            )
        if body.yaw_inertia_kg_m2 > 2 * body.tilt_inertia_kg_m2:
            yield (
                f"body.yaw_inertia_kg_m2 = {body.yaw_inertia_kg_m2:g} must be at most twice body.tilt_inertia_kg_m2 = "
                f"{body.tilt_inertia_kg_m2:g}, as of a flat disc"
            )
        full = FULL_CELL_V * battery.series_cells
        if battery.cut_off_v >= full:
            yield (
                f"battery.cut_off_v = {battery.cut_off_v:g} is not below the {full:g} V of battery.series_cells = "
                f"{battery.series_cells} when full ({FULL_CELL_V} V a cell): it would never give power"
            )

    @property
    def hub_friction_nm(self) -> float:
        """Dry friction of a motor and its gear, at the wheel."""
        return self.motor.dry_friction_nm * self.motor.gear_ratio + self.drivetrain.gear_friction_nm

    def replace(self, **sections: Any) -> Self:
        """Return a copy with other values: `settings.replace(radio={"delay_frames": 9}, carpet=CarpetSettings())`.

        Raises:
            OmniError: An unknown name, or a value that is not allowed.
        """
        return type(self)(**merge_sections(dict(self), sections))

    def to_dict(self) -> dict[str, Any]:
        """Return all values by section and field, and the faults as a list, as TOML and JSON hold them."""
        return self.model_dump(mode="json", by_alias=True)


def get_section_classes() -> dict[str, type[SettingsModel]]:
    """Return the class of each section by name, without that of controllers' parameters."""
    kinds = {name: field.annotation for name, field in Settings.model_fields.items()}
    return {
        name: kind
        for name, kind in kinds.items()
        if isinstance(kind, type) and issubclass(kind, SettingsModel)
    }


def list_settings() -> list[SettingInfo]:
    """Return the declarations of all settings of all sections, in order."""
    robot = robot_files.read_robot_sections(robot_files.DEFAULT_ROBOT)
    return [
        declared._replace(default=robot.get(name, {}).get(field, declared.default))
        for name, kind in get_section_classes().items()
        for field, declared in kind.describe_fields().items()
    ]


for _name, _kind in get_section_classes().items():
    _kind.section = f"{_name}."
