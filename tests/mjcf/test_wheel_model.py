"""Exported wheels: a base on them rolls as the angles of its wheels say, in anybody's scene."""

import re
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
from benches.rolling import make_floor
from hypothesis import given
from hypothesis import settings as examples
from hypothesis import strategies as st
from numpy.typing import NDArray

import omni_mj as om
from omni_mj.mjcf.robot_geometry import compute_support_distance
from omni_mj.mjcf.robot_parts import compute_initial_kinematics
from omni_mj.mjcf.wheel_model import WheelDesign, render_wheel_files

SSL = {"radius": 0.0285, "width": 0.014, "rollers": 16, "roller_radius": 0.006}
TWO_ROWS = {"radius": 0.05, "width": 0.03, "rollers": 20, "roller_radius": 0.007, "rows": 2}
MECANUM = {"radius": 0.05, "width": 0.05, "rollers": 9, "roller_radius": 0.008}
MECANUM |= {"roller_angle": 45}
ROUND_MECANUM = MECANUM | {"rollers": 12, "load": 3.0}
TINY = {"radius": 0.016, "width": 0.01, "rollers": 12, "roller_radius": 0.003}
HUGE = {"radius": 0.2, "width": 0.2, "rollers": 18, "roller_radius": 0.03}
HUGE |= {"roller_angle": 45}
RK4, IMPLICITFAST = mujoco.mjtIntegrator.mjINT_RK4, mujoco.mjtIntegrator.mjINT_IMPLICITFAST
LARGEST_TIMESTEP_S = 0.005
SETTLING_S, RAMP_S, DURATION_S = 0.2, 0.25, 0.5
# Directions of eight twists in the plane, and of one on the spot, (9, 3).
DIRECTIONS = np.array([*([np.cos(a), np.sin(a), 0] for a in np.arange(8) * np.pi / 4), [0, 0, 1]])


def write_scene(folder: Path, **values: Any) -> mujoco.MjSpec:
    """Write a wheel's files, and return the scene with its base."""
    for name, content in render_wheel_files(WheelDesign(**values)).items():
        (folder / name).write_bytes(content)
    return mujoco.MjSpec.from_file(str(folder / "scene.xml"))


def put_on(floor: str, scene: mujoco.MjSpec, load: float = 1.0, **options: Any) -> mujoco.MjModel:
    """Return the base on another floor, with MuJoCo's default options except these.

    Args:
        floor: Kind of the floor.
        scene: Scene of `write_scene`.
        load: Mass of the base over that for which the wheels were made.
        **options: Options.
    """
    scene.delete(scene.geom("floor"))
    scene.body("base").geoms[0].mass *= load
    world = make_floor(floor, **options)
    world.attach(scene, frame=world.worldbody.add_frame(), prefix="a_")
    return world.compile()


def find_wheels(model: mujoco.MjModel) -> NDArray:
    """Return the joints that actuators drive, (wheels,)."""
    return model.actuator_trnid[:, 0]


def compute_rim_speeds(model: mujoco.MjModel) -> NDArray:
    """Return the speeds of the rims, (wheels, 3), per twist, in closed form."""
    rows = []
    for joint in find_wheels(model):
        body = model.jnt_bodyid[joint]
        (x, y, _), yaw = model.body_pos[body], 2 * np.arctan2(*model.body_quat[body][[3, 0]])
        if model.nu == 3:
            rows.append([np.cos(yaw), np.sin(yaw), x * np.sin(yaw) - y * np.cos(yaw)])
        else:  # front left and rear right roll freely along (1, 1), the others along (1, -1)
            side = -np.sign(x * y)
            rows.append([1, side, side * x - y])
    return np.array(rows)


def drive(
    model: mujoco.MjModel, speeds: NDArray, angles: NDArray
) -> tuple[NDArray, NDArray, NDArray]:
    """Drive a base from rest.

    Args:
        model: Scene with the base.
        speeds: Speeds of the wheels, (wheels,) rad/s.
        angles: Angles of the wheels at the start, (wheels,) rad.

    Returns:
        Displacement (3,) in the frame of the base, m and rad; angles by which the wheels turn,
        (wheels,); heights of the base, m.
    """
    data, h = mujoco.MjData(model), model.opt.timestep
    wheels = model.jnt_qposadr[find_wheels(model)]
    data.qpos[wheels] = angles
    mujoco.mj_step(model, data, nstep=round(SETTLING_S / h))
    start, moved, heights = data.qpos[wheels], np.zeros(3), [data.qpos[2]]
    for step in range(round(DURATION_S / h)):
        data.ctrl[:] = speeds * min(1.0, step * h / RAMP_S)
        before, turn = data.qpos[:7].copy(), np.zeros(3)
        mujoco.mj_step(model, data)
        mujoco.mju_subQuat(turn, data.qpos[3:7], before[3:7])
        heading = 2 * np.arctan2(before[6], before[3]) + turn[2] / 2
        forward = np.array([np.cos(heading), np.sin(heading)])
        x, y = data.qpos[:2] - before[:2]
        moved += [forward @ [x, y], forward @ [y, -x], turn[2]]
        heights.append(data.qpos[2])
    return moved, data.qpos[wheels] - start, np.array(heights)


def assert_rolls(model: mujoco.MjModel, design: WheelDesign) -> None:
    """Check that a base rolls within 1 % of its wheels' angles, and does not hop."""
    matrix = compute_rim_speeds(model)
    arm = np.abs(matrix[:, 2]).max()
    lengths = np.array([1, 1, arm])
    # A mecanum wheel with few rollers depends on its angle at the start.
    angles = np.arange(model.nu) if design.rollers >= 10 else np.zeros(model.nu)
    for direction in DIRECTIONS:
        twist = direction / lengths * min(10 * design.radius, 1.0)
        moved, turned, heights = drive(model, matrix @ twist / design.radius, angles)
        rolled = np.linalg.pinv(matrix) @ turned * design.radius
        distance = np.linalg.norm(rolled * lengths)
        error = (moved - rolled) * lengths / distance
        assert distance > design.radius
        assert abs(error @ direction) < 0.01, (direction, error)
        swing = np.radians(94 / design.rollers**2) if design.is_mecanum else 0.0
        assert np.linalg.norm(error) < max(0.01, swing), (direction, error)
        assert np.ptp(heights) < 0.3e-3 + 0.005 * design.radius, direction


@pytest.mark.parametrize(
    ("values", "floor", "options"),
    [
        (SSL, "plane", {}),
        (SSL, "hfield", {"timestep": LARGEST_TIMESTEP_S, "integrator": RK4}),
        (SSL, "plane", {"load": 2.0, "timestep": LARGEST_TIMESTEP_S}),
        (TWO_ROWS, "hfield", {"integrator": IMPLICITFAST}),
        (MECANUM, "plane", {"timestep": 0.001}),
        (MECANUM, "box", {"timestep": LARGEST_TIMESTEP_S, "integrator": IMPLICITFAST}),
        (ROUND_MECANUM, "hfield", {"timestep": LARGEST_TIMESTEP_S}),
        (ROUND_MECANUM, "plane", {"load": 0.4, "integrator": RK4}),
        (TINY, "box", {}),
        (HUGE, "plane", {"timestep": LARGEST_TIMESTEP_S}),
    ],
)
def test_a_base_rolls_as_its_wheels_turn(
    values: dict[str, Any], floor: str, options: dict[str, Any], tmp_path: Path
) -> None:
    assert_rolls(put_on(floor, write_scene(tmp_path, **values), **options), WheelDesign(**values))


@examples(max_examples=100, deadline=None)
@given(
    radius=st.floats(0.015, 0.5),
    roller=st.floats(0.02, 0.45),
    rollers=st.integers(4, 50),
    rows=st.sampled_from([1, 2]),
    angle=st.sampled_from([90, 45]),
)
def test_a_wheel_is_round_or_refused(
    radius: float, roller: float, rollers: int, rows: int, angle: int
) -> None:
    """The lowest point of the rollers is a radius below the axle within 1 % at every angle."""
    values = {"radius": radius, "rollers": rollers, "rows": rows, "roller_angle": angle}
    try:
        design = WheelDesign(width=2 * radius, roller_radius=roller * radius, **values)
    except om.OmniError as error:
        assert re.fullmatch(  # noqa: PT017
            r"(rows|rollers|roller_radius|width) must be (1|at least|at most|.* than).*",
            str(error),
        )
        return
    name = "left_wheel.xml" if angle == 45 else "wheel.xml"
    model = mujoco.MjModel.from_xml_string(render_wheel_files(design)[name].decode())
    data = compute_initial_kinematics(model)
    geoms = np.flatnonzero(model.geom_type == mujoco.mjtGeom.mjGEOM_ELLIPSOID)
    assert len(geoms) == rollers
    for turn in np.linspace(0, 2 * np.pi, 7):
        down = np.array([np.sin(turn), 0, -np.cos(turn)])
        lowest = max(compute_support_distance(data, geom, down) for geom in geoms)
        assert lowest == pytest.approx(radius, rel=0.01)
    widest = max(compute_support_distance(data, geom, np.array([0, 1.0, 0])) for geom in geoms)
    assert widest <= 1.0001 * radius


def test_the_gain_is_stable_in_the_air(tmp_path: Path) -> None:
    """Wheels without a load reach their speed without overshoot, with explicit integration."""
    scene = write_scene(tmp_path, **SSL)
    scene.option.gravity, scene.option.timestep = [0, 0, 0], LARGEST_TIMESTEP_S
    scene.body("base").pos = [0, 0, 1]
    model = scene.compile()
    data = mujoco.MjData(model)
    data.ctrl[:] = 10.0
    speeds = []
    for _ in range(40):
        mujoco.mj_step(model, data)
        speeds.append(data.qvel[model.jnt_dofadr[find_wheels(model)]])
    assert (np.diff(speeds, axis=0) > -1e-3).all()
    np.testing.assert_allclose(speeds[-1], 10, rtol=0.02)


def test_a_base_at_rest_stays_and_an_upset_one_lies_on_the_floor(tmp_path: Path) -> None:
    model = put_on("plane", write_scene(tmp_path, **TWO_ROWS))
    data = mujoco.MjData(model)
    mujoco.mj_step(model, data, nstep=100)
    pose = data.qpos[:7].copy()
    mujoco.mj_step(model, data, nstep=1000)
    np.testing.assert_allclose(data.qpos[:7], pose, atol=1e-6)
    mujoco.mj_resetData(model, data)
    data.qpos[2:7] = 0.3, 0, 1, 0, 0  # wheels up
    mujoco.mj_step(model, data, nstep=1000)
    assert 0.015 < data.qpos[2] < 0.06


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"radius": 50.0}, r"radius must be .* \(0.015 to 0.5 m\), not 50"),
        ({"roller_radius": 0.024}, r"roller_radius must be at most 0.0225, .*overlap the hub"),
        ({"rollers": 5}, "rollers must be at least 6 for these radii, not 5: the gaps"),
        ({"rollers": 6, "roller_angle": 45}, "rollers must be at least 8 for these radii"),
        ({"width": 0.015}, "width must be at least 0.016, that of the rollers, not 0.015"),
        ({"width": 0.03, "rows": 2}, "width must be at least 0.032"),
        ({"width": 0.035, "roller_angle": 45}, "width must be at least 0.0414"),
        ({"rows": 2, "rollers": 15}, "rows must be 1 for mecanum wheels and odd numbers"),
        ({"rows": 2, "roller_angle": 45}, "rows must be 1 for mecanum wheels and odd numbers"),
        ({"mass": 0.2, "load": 0.1}, "load must be at least 0.3, 1.5 times the mass"),
        ({"roller_angle": 60}, "roller_angle must be 90 or 45"),
    ],
)
def test_impossible_sizes_are_refused(changes: dict[str, Any], message: str) -> None:
    sizes = {"radius": 0.05, "width": 0.05, "rollers": 12, "roller_radius": 0.008}
    with pytest.raises(om.OmniError, match=message) as error:
        WheelDesign(**sizes | changes)
    assert len(str(error.value).splitlines()) == 1
