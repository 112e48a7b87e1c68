"""The MJCF: sizes, masses, wheels and sensors against rules, the published robot and geometry."""

import mujoco
import numpy as np
import pytest
from benches.plant import ARM_M, RADIUS_M, ROLLER_RADIUS_M
from numpy.typing import NDArray

from omni_mj.config.resolve import resolve_settings
from omni_mj.config.robot_files import DEFAULT_ROBOT, find_models_folder
from omni_mj.config.toml_files import find_builtin_files
from omni_mj.mjcf import world_builder

AZIMUTHS_DEG = (60, 135, 225, 300)
WHEELS = (1, 2, 3, 4)


@pytest.fixture(scope="module")
def model() -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_path(str(find_models_folder() / "scene.xml"))


@pytest.fixture(scope="module")
def data(model: mujoco.MjModel) -> mujoco.MjData:
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return data


def rollers(model: mujoco.MjModel, wheel: int) -> list[int]:
    """Return the bodies on a wheel's rim."""
    parent = model.body(f"rim_{wheel}").id
    return [i for i in range(model.nbody) if model.body_parentid[i] == parent]


def robot_geoms(model: mujoco.MjModel) -> list[int]:
    """Return the geoms of the robot, without its hull."""
    return [
        i for i in range(model.ngeom) if model.geom_bodyid[i] != 0 and model.geom(i).name != "hull"
    ]


def support(model: mujoco.MjModel, data: mujoco.MjData, geom: int, directions: NDArray) -> NDArray:
    """Return the exact support function of a geom along unit vectors (k, 3), m."""
    local = directions @ data.geom_xmat[geom].reshape(3, 3)
    a, b, c = model.geom_size[geom]
    match model.geom_type[geom]:
        case mujoco.mjtGeom.mjGEOM_CYLINDER:
            reach = a * np.hypot(local[:, 0], local[:, 1]) + b * np.abs(local[:, 2])
        case mujoco.mjtGeom.mjGEOM_BOX:
            reach = np.abs(local) @ [a, b, c]
        case mujoco.mjtGeom.mjGEOM_ELLIPSOID:
            reach = np.linalg.norm(local * [a, b, c], axis=1)
        case mujoco.mjtGeom.mjGEOM_CAPSULE:
            reach = a + b * np.abs(local[:, 2])
        case mujoco.mjtGeom.mjGEOM_MESH:
            mesh = model.mesh(model.geom_dataid[geom])
            vertices = model.mesh_vert[mesh.vertadr[0] :][: mesh.vertnum[0]]
            reach = (local @ vertices.T).max(1)
        case kind:
            raise AssertionError(f"no support function for geom type {kind}")
    return directions @ data.geom_xpos[geom] + reach


def com_and_inertia(model: mujoco.MjModel, data: mujoco.MjData) -> tuple[NDArray, NDArray]:
    """Return center of mass and inertia (3, 3) about it, by the parallel axis theorem."""
    mass, position = model.body_mass, data.xipos
    com = mass @ position / mass.sum()
    inertia = np.zeros((3, 3))
    for m, p, principal, frame in zip(
        mass, position - com, model.body_inertia, data.ximat, strict=True
    ):
        axes = frame.reshape(3, 3)
        inertia += axes @ np.diag(principal) @ axes.T + m * (p @ p * np.eye(3) - np.outer(p, p))
    return com, inertia


def test_mass_balance_and_inertia_are_those_of_the_default_robot(
    model: mujoco.MjModel, data: mujoco.MjData
) -> None:
    com, inertia = com_and_inertia(model, data)
    body = resolve_settings().body
    assert model.body_mass.sum() == pytest.approx(body.mass_kg)
    np.testing.assert_allclose(com, [body.com_x_m, 0.0, body.com_height_m], atol=1e-8)
    # The file's nine digits.
    principal = np.diag([body.tilt_inertia_kg_m2, body.tilt_inertia_kg_m2, body.yaw_inertia_kg_m2])
    np.testing.assert_allclose(inertia, principal, rtol=1e-6, atol=1e-9)


def test_the_default_robot_is_like_the_published_ones(model: mujoco.MjModel) -> None:
    """2.3 to 2.8 kg, center of mass 45 to 49 mm high, yaw inertia 0.7 m r^2, r = 80 to 90 mm."""
    body = resolve_settings().body
    assert 2.3 <= body.mass_kg <= 2.8
    assert 0.0445 < body.com_height_m < 0.0495
    assert 0.7 * body.mass_kg * 0.08**2 < body.yaw_inertia_kg_m2 < 0.7 * body.mass_kg * 0.09**2
    assert (
        body.tilt_inertia_kg_m2 < body.yaw_inertia_kg_m2 < 2 * body.tilt_inertia_kg_m2
    )  # of a solid body


def test_every_geom_stays_inside_the_leagues_cylinder(model: mujoco.MjModel) -> None:
    # A convex body's furthest point from the axis is the largest of its supports over horizontal
    # directions; 720 of them miss it by a factor of at most cos(0.25 deg), 1 micrometre here.
    angle = np.radians(np.arange(0, 360, 0.5))
    around = np.stack([np.cos(angle), np.sin(angle), np.zeros_like(angle)], axis=1)
    up_down = np.array([[0.0, 0, 1], [0, 0, -1]])
    data = mujoco.MjData(model)
    hinges = [model.joint(f"wheel_{i}").qposadr[0] for i in WHEELS]
    for phase in np.radians(
        np.linspace(0, 22.5, 9)
    ):  # the wheels look the same again after one roller
        data.qpos[hinges] = phase
        mujoco.mj_kinematics(model, data)
        for geom in robot_geoms(model):
            name = model.geom(geom).name
            # TIGERs publish 83 mm to where wheels touch, with which rollers of 6 mm stick out, as
            # modelled: whole.
            outside = 0.0925 if name.startswith("roller") else 0.090 - 1e-6
            assert support(model, data, geom, around).max() < outside, f"{name} is outside 180 mm"
            top, bottom = support(model, data, geom, up_down)
            assert top < 0.150, f"{name} is higher than 150 mm"
            assert bottom < 1e-9, f"{name} reaches below the carpet"


@pytest.mark.parametrize(
    ("robot", "azimuths_deg", "skirts"),
    [(name, None, 5) for name in find_builtin_files("robots")]
    + [(DEFAULT_ROBOT, [60, 180, 300], 4), (DEFAULT_ROBOT, [30, 90, 180, 270], 1)],
)
def test_the_shell_reaches_the_floor_and_touches_no_wheel(
    robot: str, azimuths_deg: list[float] | None, skirts: int
) -> None:
    """Seen from the side, at most 5 mm of air are below, except where wheels and dribbler are."""
    settings = resolve_settings(
        {"wheels": {"azimuths_deg": azimuths_deg}} if azimuths_deg else {}, robot
    )
    world = world_builder.build_world(settings)
    model, data = world.model, mujoco.MjData(world.model)
    mujoco.mj_forward(model, data)
    geoms = {model.geom(i).name.removeprefix("robot_1/"): i for i in range(model.ngeom)}
    parts = [geoms[name] for name in geoms if name.startswith("skirt_")]
    assert len(parts) == skirts
    rollers = model.body_geomadr[world.robots[0].rollers.ravel()]
    for part in parts:
        down = support(model, data, part, np.array([[0.0, 0, -1]]))
        assert -0.005 < down[0] < 0
        assert support(model, data, part, np.array([[0.0, 0, 1]]))[0] > 0.065
        for roller in rollers:
            assert mujoco.mj_geomDistance(model, data, part, roller, 1.0, None) > 1e-4


def test_the_front_is_flat(model: mujoco.MjModel, data: mujoco.MjData) -> None:
    """As the rules demand room for the ball: the shell ends 72.5 mm ahead, without the wheels."""
    ahead = np.array([[1.0, 0, 0]])
    chassis = model.body("chassis").id
    for geom in robot_geoms(model):
        if model.geom_bodyid[geom] == chassis:
            assert support(model, data, geom, ahead)[0] < 0.0727, model.geom(geom).name


def test_the_hull_is_the_leagues_cylinder_above_the_base_plate(model: mujoco.MjModel) -> None:
    hull = model.geom("hull")
    radius, half = hull.size[:2]
    bottom, top = hull.pos[2] - half, hull.pos[2] + half
    np.testing.assert_allclose([radius, top], [0.090, 0.150])
    base = model.geom("base")
    assert bottom == pytest.approx(base.pos[2] - base.size[1])


def test_wheels_sit_where_the_league_puts_them(model: mujoco.MjModel, data: mujoco.MjData) -> None:
    kinematics = world_builder.build_world(resolve_settings()).kinematics
    for i, azimuth in enumerate(np.radians(AZIMUTHS_DEG)):
        outward = np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
        centre = data.body(f"wheel_{i + 1}").xpos
        # Decimal angles and lengths in the file: equal up to rounding.
        np.testing.assert_allclose(centre, ARM_M * outward + [0, 0, RADIUS_M], atol=1e-12)
        axle = data.joint(f"wheel_{i + 1}").xaxis
        np.testing.assert_allclose(axle, -outward, atol=1e-12)
        assert kinematics.azimuths[i] == pytest.approx(azimuth, abs=1e-12)
    assert kinematics.arm == pytest.approx(ARM_M, abs=1e-12)
    assert kinematics.radius == pytest.approx(RADIUS_M, abs=1e-12)


def test_a_positive_wheel_speed_drives_the_robot_counter_clockwise(
    model: mujoco.MjModel, data: mujoco.MjData
) -> None:
    for wheel, azimuth in zip(WHEELS, np.radians(AZIMUTHS_DEG), strict=True):
        centre = data.body(f"wheel_{wheel}").xpos
        contact = np.array([[centre[0]], [centre[1]], [0.0]])
        jacobian = np.zeros((3, model.nv))
        mujoco.mj_jac(model, data, jacobian, None, contact, model.body(f"wheel_{wheel}").id)
        rim = jacobian[:, model.joint(f"wheel_{wheel}").dofadr[0]]
        # The rim pushes the carpet backwards, which pushes the robot along the tangent (equation
        # 3).
        tangent = np.array([-np.sin(azimuth), np.cos(azimuth), 0.0])
        np.testing.assert_allclose(rim, -RADIUS_M * tangent, atol=1e-12)


def test_rollers(model: mujoco.MjModel, data: mujoco.MjData) -> None:
    for wheel in WHEELS:
        check_rollers(model, data, wheel)


def check_rollers(model: mujoco.MjModel, data: mujoco.MjData, wheel: int) -> None:
    robot_geoms = rollers(model, wheel)
    assert len(robot_geoms) >= 16
    centre, axle = data.body(f"wheel_{wheel}").xpos, data.joint(f"wheel_{wheel}").xaxis
    angles = []
    for body in robot_geoms:
        joint = model.body(body).jntadr[0]
        assert model.body_jntnum[body] == 1
        assert model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_HINGE
        spoke = data.xpos[body] - centre
        # Each turns about the wheel's tangent, and its middle reaches the wheel's radius; exact up
        # to rounding.
        np.testing.assert_allclose(
            np.abs(data.xaxis[joint] @ np.cross(axle, spoke)), RADIUS_M - ROLLER_RADIUS_M
        )
        assert np.linalg.norm(spoke) == pytest.approx(RADIUS_M - ROLLER_RADIUS_M)
        angles.append(np.arctan2(spoke @ np.cross(axle, [0, 0, 1]), spoke[2]))
        (geom,) = [g for g in range(model.ngeom) if model.geom_bodyid[g] == body]
        short, medium, long = model.geom_size[geom]
        assert short == medium == ROLLER_RADIUS_M
        # An ellipsoid's profile has radius of curvature long^2 / short at its middle, which must be
        # the wheel's; 0.1 % for the file's five digits.
        assert long**2 / short == pytest.approx(RADIUS_M, rel=1e-3)
    # Evenly around the wheel; exact up to rounding.
    np.testing.assert_allclose(np.diff(np.sort(angles)), 2 * np.pi / len(robot_geoms), atol=1e-9)


def test_only_the_rollers_touch_the_carpet() -> None:
    """In worlds of this program."""
    world = world_builder.build_world(resolve_settings())
    model, rollers = world.model, world.robots[0].rollers
    moving = model.geom_bodyid != 0
    assert not model.geom_contype[moving].any()
    assert not model.geom_conaffinity[moving].any()
    assert (model.pair_geom1 == model.geom("carpet").id).all()
    assert sorted(model.pair_geom2) == sorted(model.body_geomadr[rollers.ravel()])
    # Never slides: the hinge between hub and rim does, within the friction that it is given in
    # every step.
    np.testing.assert_array_equal(model.pair_friction[:, :2], 5.0)


def test_a_gyro_on_the_chassis_and_four_encoders(
    model: mujoco.MjModel, data: mujoco.MjData
) -> None:
    gyro = model.sensor("gyro")
    assert gyro.type[0] == mujoco.mjtSensor.mjSENS_GYRO
    imu = gyro.objid[0]
    assert model.site_bodyid[imu] == model.body("chassis").id
    np.testing.assert_allclose(
        data.site_xmat[imu], np.eye(3).ravel(), atol=1e-12
    )  # its z is the robot's
    for wheel in WHEELS:
        encoder = model.sensor(f"encoder_{wheel}")
        assert encoder.type[0] == mujoco.mjtSensor.mjSENS_JOINTPOS
        assert encoder.objid[0] == model.joint(f"wheel_{wheel}").id
