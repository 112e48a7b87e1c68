"""README.md of a robot that is exported as plain MJCF."""

from typing import NamedTuple

from omni_mj.config.settings import FULL_CELL_V, Settings
from omni_mj.mjcf.plain_model import PlainModel, compute_full_voltage

MUJOCO_VERSION = "4.0.0"  # the oldest that was tried
_TEXT = """# {name} (MJCF)

Requires MuJoCo {mujoco} or later.

## Overview

{origin.description}

<p float="left">
  <img src="{name}.png" width="400">
</p>

| file | content |
|---|---|
| `{name}.xml` | the robot |
| `scene.xml` | the robot on a floor: `python -m mujoco.viewer --mjcf=scene.xml` |

Every roller of the omnidirectional wheels is a body on a hinge. `<attach>` the robot to any scene,
as often as you like, or `<include>` it in a scene with angles in {angle}. It rolls on geoms with
MuJoCo's default contype and conaffinity (1), with MuJoCo's default options, all integrators, and
timesteps of up to 5 ms. The distance agrees with the angles of the wheels within 1 % as long as no
wheel slides. Wheels slide above about half of gravity in acceleration.

## Actuators, sensors and conventions

SI units. The origin of the body frame is on the floor; x points forward, y left, z up. The keyframe
`home` stands at the origin. A positive wheel speed turns the robot counter-clockwise.

| actuator | drives | azimuth of the wheel | control |
|---|---|---|---|
{actuators}

The control is the voltage of a motor. For the body velocity (vx, vy) in m/s and the turn rate w in
rad/s, the wheel at the azimuth a turns at

    wheel speed = (-sin(a) vx + cos(a) vy + {wheels.arm_m:g} w) / {wheels.radius_m:g}    rad/s

and without acceleration this takes at least

    voltage = {slope:.4g} wheel speed + {drop:.3g} sign(wheel speed)    V

It leaves out losses at the rollers. With it, `tigers-v2016` was up to 3 % too slow in tests, and
`tigers-v2020`, whose wheels are light, up to 16 %, most at low speeds.

Sensors are the wheel angles in rad (`jointpos`) and the turn rate of a gyro in rad/s.

## What this model leaves out

omni-mj simulates these, but plain MJCF cannot express them:

- Creep and sliding of the rubber. The friction of wheel and floor here is 1.5, so that wheels roll.
  That of the robot on its carpet is {settings.carpet.friction:g}.
- Drag of carpet, roller bearings and gears under load.
- Battery: its voltage drops under load.
- Heat of the motors, and current limits of their drivers.
- Firmware: loops of wheel speed and turn rate, with rates and delays.

## Numbers

| in the file | value | from the settings |
|---|---|---|
| mass with wheels | {body.mass_kg:.4g} kg | body.mass_kg |
| center of mass | {body.com_x_m:.3g}, 0, {body.com_height_m:.4g} m | body.com_x_m, com_height_m |
| inertia, tilt and yaw | {body.tilt_inertia_kg_m2:.4g}, {body.yaw_inertia_kg_m2:.4g} kg m² | \
body.tilt_inertia_kg_m2, yaw_inertia_kg_m2 |
| azimuths of wheels | {azimuths} deg | wheels.azimuths_deg |
| arm and radius of wheels | {wheels.arm_m:g}, {wheels.radius_m:g} m | wheels.arm_m, radius_m |
| rollers of a wheel, their radius | {wheels.rollers}, {wheels.roller_radius_m:g} m | \
wheels.rollers, roller_radius_m |
| motorconst | {motor.effective_constant_nm_a:.4g} N m/A | motor.torque_factor x \
torque_constant_nm_a |
| resistance | {motor.resistance_ohm:g} ohm | motor.resistance_ohm |
| gear | {motor.gear_ratio:.4g} | motor.gear_ratio |
| armature | {motor.rotor_inertia_kg_m2:g} kg m² | motor.rotor_inertia_kg_m2 |
| ctrlrange | {voltage:g} V | {cell_voltage:g} V x battery.series_cells |
| frictionloss of wheels | {settings.hub_friction_nm:.4g} N m | drivetrain.gear_friction_nm + \
motor.dry_friction_fraction x no_load_current_a x torque_constant_nm_a x gear_ratio |
| damping of wheels | {motor.wheel_viscous_friction_nm_s:.4g} N m s/rad | \
rest of the no-load current, over motor.no_load_rpm |
| damping of rollers | {settings.drivetrain.roller_damping_nm_s:g} N m s/rad | \
drivetrain.roller_damping_nm_s |
{shape}
| contact of rollers | friction 1.5, 10 ms, impedance from 0.97 | chosen, so that wheels roll |
| contact of hulls | friction 0.3 | chosen |

The settings, with the source of each:

```toml
{origin.settings_file}
```
{changes}
## MJX and MuJoCo Warp

MuJoCo Warp simulates the model. MJX with JAX does not support `<dcmotor>`.

## How it was made

With omni-mj {origin.version}: `{origin.command}`

## License

{license}
"""
_STANDARD_SHAPE = """\
| rollers | ellipsoids | long semi-axis² = wheel radius x roller radius |
| masses of hub, rim, roller | 42, 2, 1.5 g at a radius of 28.5 mm | aluminium and rubber |
| hull | 180 mm wide, up to 150 mm high | rules of the RoboCup Small Size League |
| shell, dribbler, kicker, colors | for the eye only | standard pattern of the league |"""
_CUSTOM_SHAPE = "| shapes, masses and inertias | | the robot's own MJCF |"
_STANDARD_LICENSE = "MIT ([LICENSE](LICENSE)). The numbers are facts that teams and makers publish."
_CUSTOM_LICENSE = "That of the robot's own MJCF. Put its text into a file `LICENSE`."


class ModelOrigin(NamedTuple):
    """Where a model comes from.

    Attributes:
        description: What the robot is.
        settings_file: Content of the robot's TOML file.
        changes: Settings that differ from this file; may be empty.
        command: Command that exports the model.
        version: Version of this program.
    """

    description: str
    settings_file: str
    changes: str
    command: str
    version: str


def format_readme(settings: Settings, model: PlainModel, origin: ModelOrigin) -> str:
    """Return the text of README.md."""
    wheels, motor, is_custom = settings.wheels, settings.motor, bool(settings.model.file)
    azimuths = [f"{azimuth:g}" for azimuth in wheels.azimuths_deg]
    voltage = compute_full_voltage(settings)
    volts_per_torque = motor.resistance_ohm / motor.wheel_back_emf_v_s
    return _TEXT.format(
        name=model.name,
        mujoco=MUJOCO_VERSION,
        settings=settings,
        body=settings.body,
        wheels=wheels,
        motor=motor,
        actuators="\n".join(
            f"| `{name}` | wheel {number} | {azimuth} deg | -{voltage:g} to {voltage:g} V |"
            for number, (name, azimuth) in enumerate(zip(model.motors, azimuths, strict=True), 1)
        ),
        angle="radians" if is_custom else "degrees",
        slope=motor.wheel_back_emf_v_s + volts_per_torque * motor.wheel_viscous_friction_nm_s,
        drop=volts_per_torque * settings.hub_friction_nm,
        azimuths=", ".join(azimuths),
        voltage=voltage,
        cell_voltage=FULL_CELL_V,
        shape=_CUSTOM_SHAPE if is_custom else _STANDARD_SHAPE,
        origin=origin,
        changes=f"\nChanged for this model: {origin.changes}.\n" if origin.changes else "",
        license=_CUSTOM_LICENSE if is_custom else _STANDARD_LICENSE,
    )
