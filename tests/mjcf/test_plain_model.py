"""Robots as plain MJCF in scenes of somebody else, with MuJoCo's default options."""

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
from benches.rolling import attach, make_floor, measure_rolling
from own_robot import written

from omni_mj.config.resolve import resolve_settings
from omni_mj.config.robot_files import find_models_folder
from omni_mj.config.settings import Settings
from omni_mj.mjcf.plain_model import build_plain_model

IMPLICITFAST, RK4 = mujoco.mjtIntegrator.mjINT_IMPLICITFAST, mujoco.mjtIntegrator.mjINT_RK4
DEFAULT = "tigers-v2016"
ELLIPTIC = mujoco.mjtCone.mjCONE_ELLIPTIC
FOLDER = find_models_folder()
HOP_M = 3e-4


def read_robot(settings: Settings) -> mujoco.MjSpec:
    """Return the specification of a robot as somebody reads it from the exported file."""
    files = build_plain_model(settings, "mine").files
    return mujoco.MjSpec.from_string(files["mine.xml"].decode())


def test_the_robot_in_models_is_the_export_of_the_default_robot() -> None:
    """Every number in models/ is that of the robot's file."""
    files = build_plain_model(resolve_settings(), "ssl_robot").files
    for name, content in files.items():
        assert (FOLDER / name).read_bytes() == content, f"export the robot to models/{name}"


@pytest.mark.parametrize(
    ("robot", "azimuths_deg", "floor", "options"),
    [
        ("roboteam-twente", (60, 135, 225, 300), "plane", {}),
        (DEFAULT, (60, 135, 225, 300), "hfield", {"timestep": 0.005}),
        (DEFAULT, (0, 72, 144, 216, 288), "plane", {"timestep": 0.005, "integrator": RK4}),
        (DEFAULT, (45, 135, 225, 315), "box", {"timestep": 0.005, "integrator": IMPLICITFAST}),
        (DEFAULT, (60, 180, 300), "plane", {"timestep": 0.001, "cone": ELLIPTIC}),
    ],
)
def test_nine_robots_roll_as_far_as_their_wheels(
    robot: str, azimuths_deg: tuple[float, ...], floor: str, options: dict[str, Any]
) -> None:
    """In eight directions and on the spot, within 1 %, without a hop.

    MuJoCo's contacts with heightfields are tilted by up to 9 deg, so wheels slide at less
    acceleration.
    """
    settings = resolve_settings({"wheels": {"azimuths_deg": azimuths_deg}}, robot)
    model = attach(make_floor(floor, **options), read_robot(settings))
    ramp_s = 0.8 if floor == "hfield" else 0.4
    error, hop = measure_rolling(model, settings.wheels.kinematics, ramp_s)
    assert np.abs(error).max() < 0.01
    assert hop.max() < HOP_M


def test_a_robot_with_its_own_mjcf_rolls_too(tmp_path: Path) -> None:
    """Its axles point outward, its frame is above the floor, and its motors have no names."""
    file = tmp_path / "own.xml"
    text = written((50, 130, 230, 310), outward=True, raised=0.01)
    file.write_text(re.sub('<dcmotor name="[^"]*"', "<dcmotor", text))
    settings = resolve_settings({"model": {"file": str(file)}})
    spec = read_robot(settings)
    assert [motor.name for motor in spec.actuators] == [f"motor_{i}" for i in (1, 2, 3, 4)]
    model = attach(make_floor("plane", timestep=0.004), spec)
    assert np.isfinite(model.actuator_ctrlrange).all()
    assert (model.actuator_ctrlrange == [-16.8, 16.8]).all()
    error, hop = measure_rolling(model, settings.wheels.kinematics)
    assert np.abs(error).max() < 0.01
    assert hop.max() < HOP_M


@pytest.mark.parametrize("robot", ["tigers-v2020", "own"])
def test_mass_and_inertia_are_those_of_the_settings(robot: str, tmp_path: Path) -> None:
    file = tmp_path / "own.xml"
    file.write_text(written((60, 180, 300)))
    sections = {"model": {"file": str(file)}} if robot == "own" else {}
    settings = resolve_settings(sections, "tigers-v2020")
    model = read_robot(settings).compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    body = settings.body
    assert model.body_subtreemass[1] == pytest.approx(body.mass_kg, rel=1e-4)
    center = [body.com_x_m, 0, body.com_height_m]
    np.testing.assert_allclose(data.subtree_com[1], center, atol=1e-6)
    rates = np.zeros(model.nv)
    rates[5] = 1.0  # turn about the vertical axis
    momentum = np.zeros(model.nv)
    mujoco.mj_mulM(model, data, momentum, rates)
    yaw_inertia = body.yaw_inertia_kg_m2 + body.mass_kg * body.com_x_m**2
    assert momentum[5] == pytest.approx(yaw_inertia, rel=1e-3)


@pytest.mark.parametrize("floor", ["plane", "box", "hfield"])
def test_robots_that_fall_on_each_other_stay_above_the_floor(floor: str) -> None:
    scene, rng, n = make_floor(floor, timestep=0.005), np.random.default_rng(1), 5
    robot = read_robot(resolve_settings())
    for i in range(n):
        pos = [*rng.uniform(-0.15, 0.15, 2), 0.3 + 0.2 * i]
        frame = scene.worldbody.add_frame(pos=pos, quat=rng.normal(size=4))
        scene.attach(robot.copy(), frame=frame, prefix=f"{i}/")
    model = scene.compile()
    data = mujoco.MjData(model)
    mujoco.mj_step(model, data, nstep=240)
    assert data.ncon > n
    assert data.contact.dist.min() > -3e-3
    chassis = [model.body(f"{i}/chassis").id for i in range(n)]
    assert (data.xipos[chassis, 2] > 0.03).all()
    assert np.abs(data.xipos[chassis]).max() < 4


def test_the_robot_rolls_by_attach_and_by_include() -> None:
    """By MjSpec.attach above; here twice by <attach>, and once by <include> in scene.xml."""
    robots = "".join(
        f'<frame pos="{x} 0 0"><attach model="r" body="chassis" prefix="{prefix}"/></frame>'
        for prefix, x in (("a_", -1), ("b_", 1))
    )
    xml = f"""<mujoco><asset><model name="r" file="ssl_robot.xml"/></asset>
      <worldbody><geom type="plane" size="3 3 1"/>{robots}</worldbody></mujoco>"""
    single = drive((FOLDER / "scene.xml").read_text(), {})
    assert single[0] > 0.25
    np.testing.assert_allclose(drive(xml, {}), np.tile(single, 2), rtol=2e-3)


def drive(xml: str, files: Mapping[str, bytes]) -> np.ndarray:
    """Return how far robots roll forward from their keyframe in 0.3 s with 6 V, (n,) m."""
    files = {file.name: file.read_bytes() for file in FOLDER.glob("*.xml")} | dict(files)
    model = mujoco.MjModel.from_xml_string(xml, files)
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    n_robots = model.nu // 4
    data.ctrl[:] = np.tile(-6 * np.sin(np.radians([60, 135, 225, 300])), n_robots)
    x = np.arange(n_robots) * (model.nq // n_robots)
    start = data.qpos[x]
    mujoco.mj_step(model, data, nstep=150)
    return data.qpos[x] - start
