"""models/ssl_robot.xml in scenes of somebody else, with MuJoCo's default options."""

from typing import Any

import mujoco
import numpy as np
import pytest
from benches.rolling import attach, make_floor, measure_rolling

from omni_mj.config.resolve import resolve_settings
from omni_mj.config.robot_files import find_models_folder

IMPLICITFAST, RK4 = mujoco.mjtIntegrator.mjINT_IMPLICITFAST, mujoco.mjtIntegrator.mjINT_RK4
FOLDER = find_models_folder()


@pytest.fixture(scope="module")
def robot() -> mujoco.MjSpec:
    return mujoco.MjSpec.from_file(str(FOLDER / "ssl_robot.xml"))


@pytest.mark.parametrize(
    ("floor", "options"),
    [
        ("plane", {}),
        ("plane", {"integrator": RK4}),
        ("box", {"timestep": 0.005, "integrator": IMPLICITFAST}),
        ("hfield", {"timestep": 0.005}),
        ("plane", {"timestep": 0.001, "cone": mujoco.mjtCone.mjCONE_ELLIPTIC}),
    ],
)
def test_nine_robots_roll_as_far_as_their_wheels(
    robot: mujoco.MjSpec, floor: str, options: dict[str, Any]
) -> None:
    """In eight directions and on the spot, within 1 %, without a hop.

    MuJoCo's contacts with heightfields are tilted by up to 9 deg, so wheels slide at less
    acceleration.
    """
    model = attach(make_floor(floor, **options), robot)
    ramp_s = 0.8 if floor == "hfield" else 0.4
    error, hop = measure_rolling(model, resolve_settings().wheels.kinematics, ramp_s)
    assert np.abs(error).max() < 0.01
    assert hop.max() < 3e-4


@pytest.mark.parametrize("floor", ["plane", "box", "hfield"])
def test_robots_that_fall_on_each_other_stay_above_the_floor(
    robot: mujoco.MjSpec, floor: str
) -> None:
    scene, rng, n = make_floor(floor, timestep=0.005), np.random.default_rng(1), 8
    for i in range(n):
        pos = [*rng.uniform(-0.15, 0.15, 2), 0.3 + 0.2 * i]
        frame = scene.worldbody.add_frame(pos=pos, quat=rng.normal(size=4))
        scene.attach(robot.copy(), frame=frame, prefix=f"{i}/")
    model = scene.compile()
    data = mujoco.MjData(model)
    mujoco.mj_step(model, data, nstep=300)
    assert data.ncon > n
    assert data.contact.dist.min() > -3e-3
    chassis = [model.body(f"{i}/chassis").id for i in range(n)]
    assert (data.xipos[chassis, 2] > 0.03).all()
    assert np.abs(data.xipos[chassis]).max() < 4


def test_the_robot_is_one_for_attach_include_and_keyframe() -> None:
    """By MjSpec.attach above; here twice by <attach>, and once by <include> in scene.xml."""
    robots = "".join(
        f'<frame pos="{x} 0 0"><attach model="r" body="chassis" prefix="{prefix}"/></frame>'
        for prefix, x in (("a_", -1), ("b_", 1))
    )
    xml = f"""<mujoco><asset><model name="r" file="ssl_robot.xml"/></asset>
      <worldbody><geom type="plane" size="3 3 1"/>{robots}</worldbody></mujoco>"""
    files = {file.name: file.read_bytes() for file in FOLDER.glob("*.xml")}
    single = _drive(mujoco.MjModel.from_xml_path(str(FOLDER / "scene.xml")))
    assert single[0] > 0.25
    np.testing.assert_allclose(
        _drive(mujoco.MjModel.from_xml_string(xml, files)), np.tile(single, 2), rtol=2e-3
    )


def _drive(model: mujoco.MjModel) -> np.ndarray:
    """Return how far robots roll forward from their keyframe in 0.3 s with 6 V, (n,) m."""
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    n_robots = model.nu // 4
    data.ctrl[:] = np.tile(-6 * np.sin(np.radians([60, 135, 225, 300])), n_robots)
    x = np.arange(n_robots) * (model.nq // n_robots)
    start = data.qpos[x]
    mujoco.mj_step(model, data, nstep=150)
    return data.qpos[x] - start


def test_the_robot_steps_without_warnings(capfd: pytest.CaptureFixture[str]) -> None:
    """As MuJoCo Menagerie asks."""
    for file in ("ssl_robot.xml", "scene.xml"):
        model = mujoco.MjModel.from_xml_path(str(FOLDER / file))
        data = mujoco.MjData(model)
        mujoco.mj_step(model, data, nstep=100)
        assert not data.warning.number.any()
        assert np.isfinite(data.qpos).all()
    assert capfd.readouterr() == ("", "")
