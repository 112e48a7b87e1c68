"""The models as plain MJCF have the same numbers as the world of the default robot."""

from itertools import product
from typing import Any

import mujoco
import numpy as np
from benches.plant import model_arrays
from numpy.typing import NDArray

from omni_mj.config.resolve import resolve_settings
from omni_mj.config.robot_files import find_models_folder
from omni_mj.mjcf import world_builder
from omni_mj.mjcf.robot_builder import build_robot_spec

DIGITS = 1e-6  # of the numbers in the files


def written(values: Any) -> str:
    """Return numbers as they are written in the file."""
    return " ".join(
        f"{number:.9g}" if abs(number) > 1e-15 else "0" for number in np.atleast_1d(values)
    )


def expected() -> list[str]:
    """Return the attributes that the models must contain for the default robot."""
    settings = resolve_settings()
    wheels, motor, world = (
        settings.wheels,
        settings.motor,
        world_builder.build_world(resolve_settings()),
    )
    (chassis,) = build_robot_spec(settings.mechanics).spec.worldbody.bodies
    pair = {
        name: getattr(world.model, f"pair_{name}")[0]
        for name in ("solref", "solimp", "solreffriction")
    }
    dry = motor.wheel_dry_friction_nm + settings.drivetrain.gear_friction_nm
    at_rest = (
        settings.carpet.friction * settings.body.mass_kg * 9.81 / 4 * wheels.radius_m
    )  # of a rim
    barrel = (
        wheels.roller_radius_m,
        wheels.roller_radius_m,
        np.sqrt(wheels.radius_m * wheels.roller_radius_m),
    )
    return [
        f'<inertial pos="{written(chassis.ipos)}" mass="{written(chassis.mass)}"',
        f'fullinertia="{written(chassis.fullinertia)}"',
        *(f'<frame euler="0 0 {written(azimuth)}">' for azimuth in wheels.azimuths_deg),
        *(
            f'name="wheel_{i + 1}" pos="{written([wheels.arm_m, 0, wheels.radius_m])}"'
            for i in range(4)
        ),
        f'<replicate count="{wheels.rollers}" euler="{written(360 / wheels.rollers)} 0 0">',
        f'pos="{written([0, 0, wheels.roller_radius_m - wheels.radius_m])}" euler="90 0 0"',
        f'<geom type="ellipsoid" size="{written(barrel)}"',
        f'frictionloss="{written(dry)}" damping="{written(motor.wheel_viscous_friction_nm_s)}"',
        f'frictionloss="{written(at_rest)}"',
        f'damping="{written(settings.drivetrain.roller_damping_nm_s)}"',
        f'motorconst="{written(motor.torque_constant_nm_a)}" '
        f'resistance="{written(motor.resistance_ohm)}" '
        f'gear="{written(motor.gear_ratio)}"',
        f'armature="{written(motor.rotor_inertia_kg_m2)}"',
        f'solref="{written(pair["solref"])}"',
        f'solimp="{written(pair["solimp"][:3])}"',
        f'solreffriction="{written(pair["solreffriction"])}"',
    ]


def test_the_plain_file_holds_the_default_robots_numbers() -> None:
    """The values in omni_mj/robots are repeated in models for use without omni-mj."""
    files = [find_models_folder() / name for name in ("ssl_robot.xml", "field.xml")]
    text = " ".join(" ".join(file.read_text() for file in files).split())
    missing_values = [line for line in expected() if line not in text]
    assert not missing_values, "models must be changed to hold these:\n" + "\n".join(missing_values)


def test_the_plain_file_is_the_world_of_one_robot() -> None:
    """Except for load sensors, which the builder adds, and values that are written in each step."""
    plain = model_arrays(mujoco.MjModel.from_xml_path(str(find_models_folder() / "scene.xml")))
    built = model_arrays(world_builder.build_world(resolve_settings()).model)
    assert plain.keys() == built.keys()
    assert len(plain) > 300
    n_sensors = plain["nsensor"]
    assert built["nsensor"] == n_sensors + 4
    counts = {"nsensor", "nsensordata"}
    for name in plain.keys() - counts:
        built_values: NDArray = (
            built[name][:n_sensors] if name.startswith("sensor_") else built[name]
        )
        np.testing.assert_allclose(built_values, plain[name], rtol=DIGITS, atol=1e-12, err_msg=name)


def drive(model: mujoco.MjModel) -> NDArray:
    """Return how far robots roll forward in 0.3 s with voltages for 6 V, (n,) m."""
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    n_robots = model.nu // 4
    data.ctrl[:] = np.tile(-6 * np.sin(np.radians([60, 135, 225, 300])), n_robots)
    x = np.arange(n_robots) * (model.nq // n_robots)
    start = data.qpos[x]
    mujoco.mj_step(model, data, nstep=288)
    return data.qpos[x] - start


def test_attached_robots_roll_like_the_single_one() -> None:
    """As models/README.md says: all pairs are listed, and their parameters are the field's."""
    folder = find_models_folder()
    robots, pairs = "", ""
    for prefix, x in (("a_", -1), ("b_", 1)):
        robots += (
            f'<frame pos="{x} 0 0"><attach model="r" body="chassis" prefix="{prefix}"/></frame>'
        )
        for wheel, roller in product(range(1, 5), range(16)):
            name = f"{prefix}roller_{wheel}_{roller:02}"
            pairs += f'<pair geom1="carpet" geom2="{name}"/>'
    xml = f"""<mujoco><include file="field.xml"/>
      <asset><model name="r" file="ssl_robot.xml"/></asset>
      <worldbody>{robots}</worldbody><contact>{pairs}</contact></mujoco>"""
    files = {file.name: file.read_bytes() for file in folder.glob("*.xml")}
    single = drive(mujoco.MjModel.from_xml_path(str(folder / "scene.xml")))
    assert single[0] > 0.25
    attached = drive(mujoco.MjModel.from_xml_string(xml, files))
    np.testing.assert_allclose(attached, np.tile(single, 2), rtol=2e-3)
