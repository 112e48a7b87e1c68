"""Robots in one world: alone where they do not meet, and by Newton's laws where they do."""

import copy
from typing import NamedTuple

import mujoco
import numpy as np
import pytest
from benches.plant import MASS_KG, constant, drive, noiseless, ramp
from benches.plant import mujoco as plant_of
from numpy.typing import ArrayLike, NDArray

from omni_control.errors import OmniError
from omni_mj.config.resolve import resolve_settings
from omni_mj.mjcf import world_builder

RADIUS_M, WALL_X_M = 0.090, 5.2  # of a robot; of the wall
WHEELS = ("rollers", "two-rollers")


class Collision(NamedTuple):
    """Result of a collision of n robots.

    Attributes:
        velocity: Velocities of the centers of mass after each step, (steps, n, 2) m/s.
        turn_rate: Turn rates at the end, (n,) rad/s.
        energy: Kinetic energy after each step, (steps,) J.
        rise_m: Largest rise of a robot's edge, by a hop or a tilt, m.
    """

    velocity: NDArray
    turn_rate: NDArray
    energy: NDArray
    rise_m: float


@pytest.mark.parametrize("wheels", WHEELS)
def test_robots_without_contact_move_like_single_robots(wheels: str) -> None:
    """Equal to rounding: the solver's tolerance depends on all degrees of freedom.

    A bit is enough to change an encoder's count in time, and through it the path: after a second
    and a half, 0.05 mm.
    """
    chosen = [noiseless(wheels={"model": wheels})] * 2
    start, commands = (
        [[0, 0, 0], [1, 0.5, 2.0]],
        ramp([[1.0, 0.2, 2.0], [0.3, -0.8, -3.0]], 3.0, 60),
    )
    single, pair = (drive(plant_of(chosen, start, per_world=n), commands) for n in (1, 2))
    np.testing.assert_allclose(pair[:6], single[:6], rtol=0, atol=1e-12)
    np.testing.assert_allclose(pair, single, rtol=0, atol=5e-5)


def test_hulls_of_upright_robots_never_touch_the_carpet() -> None:
    """At tilts of 1e-15 rad, MuJoCo 4.0 finds false contacts of planes and upright cylinders."""
    world = world_builder.build_world(resolve_settings(), 1, with_hulls=True)
    model, data = world.model, mujoco.MjData(world.model)
    hull, rng = model.geom("robot_1/hull").id, np.random.default_rng(0)
    for heading in rng.uniform(-np.pi, np.pi, 600):
        data.qpos[:] = world.rest_qpos
        data.qpos[:2] = rng.uniform(-3, 3, 2)
        data.qpos[3:7] = np.cos(heading / 2), *(1e-15 * rng.normal(size=2)), np.sin(heading / 2)
        mujoco.mj_fwdPosition(model, data)
        assert not (data.contact.geom == hull).any()


def collide(poses: ArrayLike, velocities: ArrayLike, substeps: int = 1) -> Collision:
    """Let robots without motors, on wheels that do not grip, collide for 0.12 s.

    Args:
        poses: Poses at the beginning, (n, 3) m, m, rad.
        velocities: Velocities at the beginning, (n, 2) m/s.
        substeps: Steps of MuJoCo per cycle of 1/960 s.
    """
    starts, speeds = np.asarray(poses, float), np.asarray(velocities, float)
    settings = resolve_settings().replace(physics={"substeps": substeps})
    world = world_builder.build_world(settings, len(starts), with_hulls=True)
    model = copy.copy(world.model)
    model.pair_dim[model.pair_friction[:, 0] > 1] = 1  # rollers do not grip
    model.dof_frictionloss[:] = 0
    model.opt.enableflags |= int(mujoco.mjtEnableBit.mjENBL_ENERGY)
    data = mujoco.MjData(model)
    data.qpos[:] = world.rest_qpos
    for robot, (x, y, heading), velocity in zip(world.robots, starts, speeds, strict=True):
        data.qpos[robot.qpos[:2]] = x, y
        data.qpos[robot.qpos[3:7]] = np.cos(heading / 2), 0, 0, np.sin(heading / 2)
        data.qvel[robot.dofs[:2]] = velocity
    chassis = [robot.chassis for robot in world.robots]
    dofs = np.array([robot.dofs[:6] for robot in world.robots])
    heights, velocity, energy = [], [], []
    for _ in range(round(0.12 / model.opt.timestep)):
        mujoco.mj_step(model, data)
        mujoco.mj_subtreeVel(model, data)
        heights.append(data.xpos[chassis, 2] + 0.09 * np.sqrt(1 - data.xmat[chassis, 8] ** 2))
        velocity.append(data.subtree_linvel[chassis, :2])
        energy.append(data.energy[1])
    rise = np.array(heights) - world.rest_qpos[world.robots[0].qpos[2]]
    return Collision(np.array(velocity), data.qvel[dofs[:, 5]], np.array(energy), rise.max())


def rebound(before: NDArray, after: NDArray, normal: NDArray) -> float:
    """Return the ratio of parting to closing speed along a normal, for velocities (2, 2)."""
    return -((after[1] - after[0]) @ normal) / ((before[1] - before[0]) @ normal)


@pytest.mark.parametrize("substeps", [1, 8])
@pytest.mark.parametrize("speed", [0.5, 3.0, 5.0])
def test_a_head_on_collision_does_not_depend_on_time_step_or_speed(
    speed: float, substeps: int
) -> None:
    """Robots stay upright and on the carpet, and part with 0.27 to 0.31 of the closing speed."""
    for gap_in_steps in (0.0, 0.3, 0.6):
        x = RADIUS_M + 2e-3 + gap_in_steps * speed / 960
        poses, velocities = [[-x, 0, 0.3], [x, 0, 2.0]], np.array([[speed, 0], [-speed, 0]])
        result = collide(poses, velocities, substeps)
        after = result.velocity[-1]
        np.testing.assert_allclose(after.sum(0), 0, atol=2e-3 * speed)
        assert 0.26 < rebound(velocities, after, np.array([1.0, 0.0])) < 0.315
        assert result.rise_m < 0.5e-3
        assert result.energy[-1] < 0.12 * result.energy[0]


@pytest.mark.parametrize("sideways", [1.0, 3.0])
def test_a_wall_acts_by_restitution_and_coulombs_friction(sideways: float) -> None:
    """The friction of 0.3 ends sliding or takes 0.3 of the normal impulse, and turns the robot."""
    before = np.array([1.5, sideways])
    result = collide([[WALL_X_M - RADIUS_M - 4e-3, 0, 0]], [before])
    impulse = result.velocity[-1, 0] - before
    assert 0.25 < -result.velocity[-1, 0, 0] / before[0] < 0.33
    body = resolve_settings().body
    sliding = result.velocity[-1, 0, 1] + RADIUS_M * result.turn_rate[0]
    mobility = 1 + MASS_KG * RADIUS_M**2 / body.yaw_inertia_kg_m2
    stopping = -sideways / mobility
    assert impulse[1] == pytest.approx(max(0.3 * impulse[0], stopping), rel=0.06)
    assert abs(sliding) < 0.06 or impulse[1] == pytest.approx(0.3 * impulse[0], rel=0.01)
    turning = MASS_KG * RADIUS_M * impulse[1] / body.yaw_inertia_kg_m2
    assert result.turn_rate[0] == pytest.approx(turning, rel=0.05)
    assert result.rise_m < 0.5e-3


@pytest.mark.parametrize("aside", [0.03, 0.1, 0.15])
def test_an_oblique_collision_conserves_momentum_and_spins_both(aside: float) -> None:
    distance = 2 * RADIUS_M + 2e-3
    normal = np.array([np.sqrt(distance**2 - aside**2), aside]) / distance
    before = np.array([[3.0, 0.0], [0.0, 0.0]])
    poses = [[0, 0, 0], [*(distance * normal), 1.0]]
    result, fine_result = (collide(poses, before, substeps) for substeps in (1, 8))
    after = result.velocity[-1]
    np.testing.assert_allclose(after.sum(0), before.sum(0), atol=0.01)
    assert 0 < rebound(before, after, normal) < 0.3
    assert result.energy[-1] < result.energy[0]
    assert result.rise_m < 0.5e-3
    # Friction acts on both robots at the same distance, and turns them in the same sense.
    assert result.turn_rate[0] == pytest.approx(result.turn_rate[1], rel=0.05)
    assert result.turn_rate[0] > 1
    np.testing.assert_allclose(after, fine_result.velocity[-1], atol=0.05)
    np.testing.assert_allclose(result.turn_rate, fine_result.turn_rate, atol=0.4)


def test_three_robots_share_the_momentum_of_one() -> None:
    x = 2 * RADIUS_M + 1e-3
    before = np.array([[2.0, 0.0], [0.0, 0.0], [0.0, 0.0]])
    results = [collide([[0, 0, 0], [x, 0, 0], [2 * x, 0, 0]], before, n) for n in (1, 8)]
    for result in results:
        after = result.velocity[-1]
        np.testing.assert_allclose(after.sum(0), before.sum(0), atol=0.01)
        assert (np.diff(after[:, 0]) > 0).all(), "they part"
        assert result.rise_m < 0.5e-3
    np.testing.assert_allclose(results[0].velocity[-1], results[1].velocity[-1], atol=0.06)


@pytest.mark.parametrize("heading", [0.0, 2.0])
def test_a_robot_pushed_by_another_moves_alike_at_any_time_step(heading: float) -> None:
    """The wheels grip. 50 ms after the hit at 3 m/s, poses agree within 5 mm and 5 mrad."""
    ends = []
    for substeps in (1, 4):
        chosen = [noiseless(wheels={"model": "two-rollers"}, physics={"substeps": substeps})] * 2
        plant = plant_of(chosen, [[-0.25, -0.06, 0.0], [0, 0, heading]], per_world=2)
        twist = plant._views.velocity.get()
        twist[0, 0] = 3.0
        plant._views.velocity.set(twist)
        drive(plant, constant([[3.0, 0, 0], [0, 0, 0]], 6, 2))
        ends.append(plant.pose())
    assert ends[0][1, 0] > 0.05
    np.testing.assert_allclose(ends[0], ends[1], atol=5e-3)


@pytest.mark.parametrize("wheels", WHEELS)
def test_robots_that_drive_at_each_other_do_not_pass(wheels: str) -> None:
    chosen = [noiseless(wheels={"model": wheels})] * 2
    poses = drive(
        plant_of(chosen, [[-0.5, 0, 0], [0.5, 0, 0]], per_world=2),
        ramp([[1.5, 0, 0], [-1.5, 0, 0]], 4.0, 60),
    )
    distance = np.linalg.norm(poses[:, 0, :2] - poses[:, 1, :2], axis=1)
    assert distance.min() > 2 * RADIUS_M - 6e-3
    assert distance[-1] < 2 * RADIUS_M + 0.1, "they push on"
    assert poses[-1, 0, 0] < poses[-1, 1, 0]


@pytest.mark.parametrize("wheels", WHEELS)
def test_a_robot_stops_at_a_wall(wheels: str) -> None:
    chosen = [noiseless(wheels={"model": wheels})] * 2
    start = [[WALL_X_M - 0.5, 1.0, 0.5], [0, 0, 0]]
    poses = drive(plant_of(chosen, start, per_world=2), constant([[1.2, 0, 0], [0, 0, 0]], 60, 2))
    at = poses[:, 0, 0]
    # 5 mm for the hit, and 1.5 mm for the push of spinning wheels, about 10 N.
    assert at.max() < WALL_X_M - RADIUS_M + 5e-3
    assert at[-1] == pytest.approx(WALL_X_M - RADIUS_M, abs=1.5e-3)
    assert np.abs(poses[-1, 1]).max() < 1e-4  # the other stands as it stood


def test_robots_must_start_apart() -> None:
    for start, where in (
        ([[0, 0, 0], [0.1, 0, 0]], "robot_2/hull"),
        ([[0, 0, 0], [0, 3.65, 0]], "wall_left"),
    ):
        with pytest.raises(OmniError, match=f"world 0: .*{where}.* overlap at the start by .* mm"):
            plant_of([noiseless()] * 2, start, per_world=2)
