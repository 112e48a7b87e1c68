"""Every number a scenario can set: small frozen models whose fields carry unit, bounds and meaning."""

import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import Field, field_validator, model_validator
from pydantic_core import ErrorDetails

from omni_control.errors import choose
from omni_control.kinematics import Array
from omni_control.reference.curves import CURVES
from omni_mj.scenarios import CYCLE_RATE_HZ as CYCLE_RATE_HZ
from omni_mj.scenarios import FRAME_RATE_HZ as FRAME_RATE_HZ
from omni_mj.scenarios import PERIOD_S as PERIOD_S
from omni_mj.scenarios import faults, told
from omni_mj.scenarios.checking import Checked, Poses, Setting, in_one, merged, setting, shown
from omni_mj.scenarios.motor_settings import MotorSettings
from omni_mj.scenarios.robot_settings import BatterySettings as BatterySettings
from omni_mj.scenarios.robot_settings import (
    BodySettings,
    CarpetSettings,
    DriveSettings,
    FirmwareSettings,
    ModelSettings,
    SensorSettings,
    VariationSettings,
    WheelSettings,
    support,
)

FULL_CELL_V = 4.2  # of a LiPo cell
ENVELOPE_M, HEIGHT_M = 0.09, 0.15  # radius and height that the league's rules allow


def column(settings: Sequence[Any], name: str) -> Array:
    """Return a field of one section per robot as an array (n, 1)."""
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
        in_one(self._contradictions())
        return self

    def _contradictions(self) -> Iterator[str]:
        """Yield what no reference can be, a line each."""
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


class VisionSettings(Checked):
    """The cameras. Noise and misses: "Realistic" of the ER-Force simulator."""

    position_noise_m: float = setting(0.0013, "m", "standard deviation of the position seen, per axis", 0, 1)
    heading_noise_rad: float = setting(0.01, "rad", "standard deviation of the heading seen", 0, 1)
    miss_probability: float = setting(0.02, "", "probability, per frame, that a robot is not seen from then on", 0, 0.9)
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
        1, "", "serve: how many share the field: 2 or 3 side by side along it, 4 a quarter each", 1, 4
    )
    overlap_m: float = setting(0.4, "m", "serve: width of the strips that two cameras see", 0, 4)
    camera_offset_m: float = setting(
        0.0, "m", "serve: standard deviation, per axis, by which a camera is out of place (seen: 0.02)", 0, 0.5
    )
    clock_offset_s: float = setting(0.0, "s", "serve: standard deviation by which a camera's clock is off", 0, 10)


class RadioSettings(Checked):
    """The radio link from the team's computer to the robot."""

    delay_frames: int = setting(6, "frames", "dead time k_d from command to robot (paper: 0.1 s)", 0, 600)
    jitter_frames: int = setting(0, "frames", "a packet takes up to this more or less, uniformly; newest wins", 0, 600)
    loss_probability: float = setting(0.0, "", "probability that a packet never arrives", 0, 0.95)

    @model_validator(mode="after")
    def _causal(self) -> Self:
        if self.jitter_frames > self.delay_frames:
            raise ValueError(
                "radio.jitter_frames must not be above radio.delay_frames: no packet arrives before it is sent"
            )
        return self


class ControlSettings(Checked):
    """The team's computer: what it believes of the robots, the controllers, and the limits of what they may command.

    What has no default here follows from the robot's numbers.
    """

    delay_error_frames: int = setting(0, "frames", "what it believes the dead time to be, less the true", -600, 600)
    lag_s: float = setting(
        None,
        "s",
        "MuJoCo plant: what it believes the wheel loops' lag to be; by default that of its gains; 0: not known",
        0,
        1,
    )
    drag_m_s: float = setting(
        None,
        "m/s",
        "MuJoCo plant: what it believes dry friction costs of the speed; by default by its gains; 0: not known",
        0,
        1,
    )
    creep_s2_m: float = setting(
        None,
        "s^2/m",
        "MuJoCo plant: what it believes wheels to creep, forward (TIGERs: 0.038 to 0.06); 0: not known",
        0,
        1,
    )
    creep_sideways_s2_m: float = setting(None, "s^2/m", "the same sideways (TIGERs: 0.082 to 0.155)", 0, 1)
    alpha_forward: float = setting(
        None,
        "",
        "MuJoCo plant: what it believes robots to reach of a command ahead; by default by that law; 0: not known",
        0,
        2,
    )
    alpha_sideways: float = setting(None, "", "the same aside (TIGERs: 0.79 to 0.97)", 0, 2)

    error_range_m: float = setting(0.1, "m", "input range of the fuzzy controller (paper, section 4)", 1e-6, 10)
    speed_range_m_s: float = setting(1.0, "m/s", "output range of the fuzzy controller (paper, section 4)", 1e-6, 10)
    heading_gain: float = setting(3.0, "1/s", "turn rate per heading error of the heading hold", 0, 60)
    alpha_window_frames: int = setting(15, "frames", "window n_0 over which alpha is estimated", 1, 600)
    max_speed_m_s: float = setting(3.7, "m/s", "highest commanded speed (ssl-simulation-setup)", 0.01, 20)
    max_acceleration_m_s2: float = setting(4.7, "m/s^2", "highest change of it (ssl-simulation-setup)", 0.01, 1e3)
    max_turn_rate_rad_s: float = setting(26.0, "rad/s", "highest commanded turn rate (same)", 0.01, 100)
    max_turn_acceleration_rad_s2: float = setting(50.8, "rad/s^2", "highest change of it (same)", 0.01, 1e4)


class PhysicsSettings(Checked):
    """The integration."""

    substeps: int = setting(1, "", "physics steps per cycle of the wheel loops, which is the model's 1/960 s", 1, 100)
    kernel: Literal["auto", "numpy", "jax"] = setting(
        "auto", "", "what computes robots: numpy, or JAX (extra fast), which rounds differently; auto: the faster"
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
    """All sections; `controller` holds the parameters of controllers by label, `fault` what happens in a run.

    Each is given as a model, or as its fields that differ from the defaults: `Settings(radio={"delay_frames": 9})`.
    """

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
    controller: dict[str, dict[str, Any]] = Field(default_factory=dict)
    fault: Annotated[tuple[faults.AnyFault, ...], Field(strict=False)] = ()

    def __hash__(self) -> int:
        return hash((*(getattr(self, name) for name in _sections()), self.fault))

    @field_validator("model", mode="before")
    @classmethod
    def _from_path(cls, value: Any) -> Any:
        return {"file": str(value)} if isinstance(value, (str, Path)) else value

    @field_validator("controller")
    @classmethod
    def _parameters(cls, controllers: dict[str, dict[str, Any]]) -> dict[str, dict[str, Any]]:
        plain = {
            label: {name: value.item() if isinstance(value, np.generic) else value for name, value in values.items()}
            for label, values in controllers.items()
        }
        in_one(
            f"controller.{label}.{name} must be a finite number, true or false, or a string, not {shown(value)}"
            for label, values in plain.items()
            for name, value in values.items()
            if not (isinstance(value, str) or (isinstance(value, (int, float)) and abs(value) < math.inf))
        )
        return plain

    @model_validator(mode="after")
    def _can_be(self) -> Self:
        in_one([*faults.misfits(self.fault, self), *self._contradictions()])
        missing = [name for name, value in self.control if value is None]
        if missing:
            found = told.follows(self, self.control.creep_s2_m)
            control = self.control.replace(**{name: found[name] for name in missing})
            object.__setattr__(self, "control", control)
        return self

    def _contradictions(self) -> Iterator[str]:
        """Yield what no robot can be, a line each: a body that tips over or has no such inertia, a dead battery."""
        body, placed, battery, motor = self.body, self.wheels, self.battery, self.motor
        inside = support(placed.azimuths_deg, placed.arm_m, body.centre_x_m)
        if inside <= 0:
            yield (
                f"body.centre_x_m = {body.centre_x_m:g} is {-inside * 1e3:.3g} mm outside the polygon of the wheels' "
                "contacts (wheels.azimuths_deg, wheels.arm_m): the robot would tip over as it stands; it must be inside"
            )
        if body.yaw_inertia_kg_m2 > 2 * body.tilt_inertia_kg_m2:
            yield (
                f"body.yaw_inertia_kg_m2 = {body.yaw_inertia_kg_m2:g} and body.tilt_inertia_kg_m2 = "
                f"{body.tilt_inertia_kg_m2:g} are principal inertias which no body has; the first is twice the second "
                "at most, that of a flat disc"
            )
        across = max(ENVELOPE_M, placed.arm_m + placed.roller_radius_m)
        for name, farthest in (("yaw", across), ("tilt", math.hypot(across, HEIGHT_M))):
            inertia, most = getattr(body, f"{name}_inertia_kg_m2"), body.mass_kg * farthest**2
            if inertia > most:
                yield (
                    f"body.{name}_inertia_kg_m2 = {inertia:g} is more than body.mass_kg = {body.mass_kg:g} has if all "
                    f"of it is {farthest * 1e3:.0f} mm away, at the robot's edge; at most {most:.3g}"
                )
        counts, fastest = self.sensors.encoder_counts, motor.no_load_rpm / 60
        if counts * fastest < CYCLE_RATE_HZ:
            yield (
                f"sensors.encoder_counts = {counts} gives less than a count in a cycle of 1/{CYCLE_RATE_HZ} s even at "
                f"motor.no_load_rpm = {motor.no_load_rpm:g}: no speed of the motor could be measured; "
                f"{math.ceil(CYCLE_RATE_HZ / fastest)} at least"
            )
        full = FULL_CELL_V * battery.cells
        if battery.cut_off_v >= full:
            yield (
                f"battery.cut_off_v = {battery.cut_off_v:g} is not below the {full:g} V of battery.cells = "
                f"{battery.cells} when full ({FULL_CELL_V} V a cell): it would never give power"
            )

    def replace(self, **sections: Any) -> Self:
        """Return a copy with other values: `settings.replace(radio={"delay_frames": 9}, carpet=CarpetSettings())`.

        Raises:
            OmniError: An unknown name, or a value that is not allowed.
        """
        return type(self)(**merged(dict(self), sections))

    def plain(self) -> dict[str, Any]:
        """Return all values by section and field, and the faults as a list, as TOML and JSON hold them."""
        return self.model_dump(mode="json", by_alias=True)

    def items(self) -> Iterator[tuple[Setting, Any]]:
        """Yield the declaration and value of every setting but the parameters of controllers."""
        for name, kind in _sections().items():
            section = getattr(self, name)
            yield from ((declared, getattr(section, declared.name)) for declared in kind.declared())

    @classmethod
    def _explain(cls, error: ErrorDetails) -> Iterator[str]:
        kind, place = error["type"], error["loc"]
        name = str(place[0]) if place else ""
        if name == "fault" and len(place) > 1 and isinstance(place[1], int) and kind != "value_error":
            given = error["input"].get("kind") if isinstance(error["input"], dict) else error["input"]
            yield f"fault {place[1] + 1}: kind must be a fault's, not {shown(given)}; {choose(given, faults.KINDS)}"
        elif name == "fault" and kind != "value_error":
            yield f"fault is a list: write [[fault]] and its fields below, once for each, not {shown(error['input'])}"
        elif name in cls.model_fields and kind != "value_error":
            where = ".".join(map(str, place))
            yield f"{where} is a section: write [{where}] and its fields below, not {shown(error['input'])}"
        elif kind == "extra_forbidden":
            yield f"{cls.unknown} {shown(name)[1:-1]}; {choose(name, cls.model_fields)}"
        else:
            yield from super()._explain(error)


def _sections() -> dict[str, type[Checked]]:
    """Return the class of each section by name, without that of controllers' parameters."""
    kinds = {name: field.annotation for name, field in Settings.model_fields.items()}
    return {name: kind for name, kind in kinds.items() if isinstance(kind, type) and issubclass(kind, Checked)}


def every_setting() -> list[Setting]:
    """Return the declarations of all settings of all sections, in order."""
    return [declared for kind in _sections().values() for declared in kind.declared()]


for _name, _kind in _sections().items():
    _kind.section = _name
