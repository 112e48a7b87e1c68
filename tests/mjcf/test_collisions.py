"""Robots in one world: alone where they do not meet, and by Newton's laws where they do."""

import copy

import mujoco
import numpy as np
import pytest
from benches.plant import MASS_KG, constant, drive, noiseless, ramp
from benches.plant import mujoco as plant_of
from numpy.typing import NDArray

from omni_control.errors import OmniError
from omni_mj.config.resolve import resolve_settings
from omni_mj.mjcf import world_builder

RADIUS_M, WALL_X_M = 0.090, 5.2  # of a robot; of the wall
WHEELS = ("rollers", "two-rollers")


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


def collide(speed: float, aside: float) -> tuple[NDArray, NDArray, float]:
    """Two robots without motors on ice approach at `speed`, `aside` m off the center line.

    Returns:
        Momenta (steps, 2, 2) in N s, kinetic energies (steps,) in J, and how deep one hull enters
        the other, m.
    """
    world = world_builder.build_world(resolve_settings(), robots_per_world=2)
    model = copy.copy(world.model)
    model.pair_dim[:] = 1  # without friction
    model.dof_frictionloss[:] = 0
    model.opt.enableflags |= int(mujoco.mjtEnableBit.mjENBL_ENERGY)
    data = mujoco.MjData(model)
    data.qpos[:] = world.rest_qpos
    for robot, side in zip(world.robots, (-1, 1), strict=True):
        data.qpos[robot.qpos[:2]] = [side * 0.12, side * aside / 2]
        data.qvel[robot.dofs[0]] = -side * speed
    momenta, energies, depth = [], [], 0.0
    hulls = {i for i in range(model.ngeom) if model.geom(i).name.endswith("/hull")}
    for _ in range(round(0.2 / model.opt.timestep)):
        mujoco.mj_step(model, data)
        mujoco.mj_subtreeVel(model, data)
        momenta.append([MASS_KG * data.subtree_linvel[robot.chassis, :2] for robot in world.robots])
        energies.append(data.energy[1])
        depth = max(
            [depth, *(-contact.dist for contact in data.contact if hulls.issuperset(contact.geom))]
        )
    return np.array(momenta), np.array(energies), depth


@pytest.mark.parametrize(("speed", "aside"), [(0.5, 0.0), (1.5, 0.0), (1.5, 0.1)])
def test_a_collision_conserves_momentum(speed: float, aside: float) -> None:
    momenta, energies, depth = collide(speed, aside)
    total = momenta.sum(1)
    # Nothing else acts in the plane. A step's momentum is at the pose of its beginning: centres 45
    # mm up of robots that rock at 4 rad/s are off by m h w^2 dt = 2 mN s.
    np.testing.assert_allclose(total - total[0], 0, atol=2e-3)
    normal = np.array([np.sqrt(4 * RADIUS_M**2 - aside**2), aside]) / (
        2 * RADIUS_M
    )  # where circles meet
    momentum_before, momentum_after = ((momenta[i, 1] - momenta[i, 0]) @ normal for i in (0, -1))
    assert momentum_before == pytest.approx(-2 * MASS_KG * speed * normal[0], rel=1e-2)
    # They part, no faster than they met, and energy is lost: neither elastic nor sticking.
    assert 0 < momentum_after < -momentum_before
    assert energies[-1] < energies[0]
    # Hulls give way by 2 ms times the speed at which they meet.
    assert 0 < depth < 2e-3 * 2 * speed


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
    # 3 mm for the hit, and no more for the push of spinning wheels, about 10 N.
    assert at.max() < WALL_X_M - RADIUS_M + 3e-3
    assert at[-1] == pytest.approx(WALL_X_M - RADIUS_M, abs=1e-3)
    assert np.abs(poses[-1, 1]).max() < 1e-4  # the other stands as it stood


def test_robots_must_start_apart() -> None:
    for start, where in (
        ([[0, 0, 0], [0.1, 0, 0]], "robot_2/hull"),
        ([[0, 0, 0], [0, 3.65, 0]], "wall_left"),
    ):
        with pytest.raises(OmniError, match=f"world 0: .*{where}.* overlap at the start by .* mm"):
            plant_of([noiseless()] * 2, start, per_world=2)
