"""The plant planar: mechanics, creep, rejected rows, and agreement with the plant mujoco."""

import itertools
from typing import Any

import numpy as np
import pytest
from benches.creep import contact_speed, traction_per_load
from benches.plant import (
    ARM_M,
    FRAME_S,
    GRAVITY,
    LOSSLESS,
    MASS_KG,
    NO_FRICTION,
    OUTWARD,
    RADIUS_M,
    STIFF,
    TANGENTS,
    WHEELED_PLANTS,
    PlantOf,
    compute_loads,
    constant,
    drive,
    mass_matrices,
    noiseless,
    planar,
    ramp,
    receive_at_once,
    remove_roller_losses,
    set_twist,
)
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

import omni_mj as om
from omni_control.errors import OmniError
from omni_control.kinematics import world_to_body
from omni_mj.config.resolve import resolve_settings

STIFFNESS = 2.5
FREE: dict[str, Any] = {
    "carpet": {"rolling_resistance": 0.0},
    "drivetrain": LOSSLESS | {"creep_stiffness": STIFFNESS},
    "firmware": STIFF,
    "battery": {"resistance_ohm": 0.0},
    "motor": {"no_load_current_a": 0.0},
}


@WHEELED_PLANTS
def test_slip_and_acceleration_obey_the_creep_law(plant_of: PlantOf) -> None:
    """B' f = M a + drag with the traction f by Pacejka's cubic and normal forces by statics.

    Random robots drive at random speeds in random directions. The ramp tests the slip time T, and
    the constant speed after it the gain K.
    """
    rng, n = np.random.default_rng(1), 16
    stiffness, bearing, rolling = rng.uniform(
        [[3.0], [0.0], [0.0]], [[9.0], [0.15], [0.05]], (3, n)
    )
    # Wheels that hardly travel along their axles would have half the friction of their bearings.
    angle = np.array([a for a in rng.uniform(-np.pi, np.pi, 3 * n) if turns_rollers(a)])
    direction = np.stack([np.cos(angle[:n]), np.sin(angle[:n]), np.zeros(n)], axis=1)
    commands = ramp(rng.uniform(1.2, 1.6, n)[:, None] * direction, 2.0, 75)
    sections = [
        {
            "carpet": {"rolling_resistance": rolling[i]},
            "drivetrain": {
                **NO_FRICTION,
                "creep_stiffness": stiffness[i],
                "roller_friction": bearing[i],
            },
        }
        for i in range(n)
    ]
    plant = plant_of([noiseless(**FREE | sections_i) for sections_i in sections])
    poses, angles = [], []
    for command in commands:
        poses.append(drive(plant, command[None])[-1])
        angles.append(plant.telemetry().wheel_angle)
    body = world_to_body(np.diff(poses, axis=0) / FRAME_S, np.array(poses)[1:, :, 2])
    rims = np.diff(angles, axis=0) / FRAME_S * RADIUS_M
    b = np.column_stack([TANGENTS, 4 * [ARM_M]])
    mass = np.diag([MASS_KG, MASS_KG, resolve_settings().body.yaw_inertia_kg_m2])
    ramp_frames, last_frames = slice(14, 34), slice(-20, None)
    for window, i in itertools.product((ramp_frames, last_frames), range(n)):
        twist = body[window, i].mean(0)
        change = np.polyfit(np.arange(len(body))[window] * FRAME_S, body[window, i], 1)[0]
        acceleration = change + twist[2] * np.array([-twist[1], twist[0], 0.0])
        load = compute_loads(acceleration[:2])
        travel = np.stack([b @ twist, OUTWARD @ twist[:2]], axis=1)
        drag = load[:, None] * rolling[i] * travel / np.linalg.norm(travel, axis=1, keepdims=True)
        drag[:, 1] += load * bearing[i] * np.sign(travel[:, 1])
        slip = rims[window, i].mean(0) - travel[:, 0]
        rim_friction = np.sqrt(0.8**2 - bearing[i] ** 2)
        traction = load * traction_per_load(slip, travel, stiffness[i], rim_friction)
        expected = mass @ acceleration + b.T @ drag[:, 0] + np.append(OUTWARD.T @ drag[:, 1], 0.0)
        # Rollers that are spun up brake by up to 0.25 N per m/s on mujoco, and yaw oscillates.
        difference = b.T @ traction - expected
        assert np.hypot(*difference[:2]) < 0.15 + 0.25 * np.hypot(*twist[:2]), (window, i)
        assert abs(difference[2]) < 0.007, (window, i)


def turns_rollers(angle: float) -> bool:
    """Return whether each wheel travels along its axle in a direction."""
    return bool((np.abs(OUTWARD @ [np.cos(angle), np.sin(angle)]) > 0.15).all())


@WHEELED_PLANTS
def test_slip_is_steady_up_to_the_friction_limit_and_beyond(plant_of: PlantOf) -> None:
    """Motors pull with constant torques, some more than friction transmits."""
    friction, pulls = 0.3, np.array([0.3, 0.8, 1.1, 1.2, 1.3, 1.5])
    n, carpet = len(pulls), {"rolling_resistance": 0.0, "friction": friction}
    plant = plant_of([noiseless(**FREE | {"carpet": carpet})] * n)
    torque = pulls[:, None] * friction * MASS_KG * GRAVITY / 4 * RADIUS_M * np.sign(TANGENTS[:, 0])
    motor = resolve_settings().motor
    plant.set_motor_currents(torque / motor.wheel_back_emf_v_s)
    speeds, slips = [], []
    for _ in range(40):
        drive(plant, constant([0.0, 0.0, 0.0], 1, n))
        speeds.append(plant.twist()[:, 0])
        slips.append(plant.telemetry().slip)
    speed, slip = np.array(speeds)[20:], np.array(slips)[20:]
    travel = speed[..., None, None] * np.stack([TANGENTS[:, 0], OUTWARD[:, 0]], axis=1)
    fraction = slip * STIFFNESS / (3 * friction * contact_speed(travel))
    assert (np.diff(fraction.mean(0), axis=0) > 0).all(), "more torque causes more slip"
    assert fraction[:, 0].max() < 0.3
    assert fraction[:, -1].min() > 1.5, "all wheels slide"
    # 2 % of the limit: rollers change.
    assert (fraction.std(0) < 0.02 * np.maximum(fraction.mean(0), 1)).all()
    traction = traction_per_load(slip, travel, STIFFNESS, friction)
    for i, acceleration in enumerate(np.polyfit(np.arange(20) * FRAME_S, speed, 1)[0]):
        force = compute_loads([acceleration, 0.0]) @ (
            traction[:, i].mean(0) * np.abs(TANGENTS[:, 0])
        )
        # 3 %: rims turn with the body. Rollers that are spun up brake, as in the test above.
        excess = force - MASS_KG * acceleration
        assert abs(excess) < 0.03 * force + 0.15 * speed[:, i].mean(), pulls[i]


def test_a_rolling_and_turning_robot_follows_lagranges_equations() -> None:
    """Wheels keep their speeds: in body axes (M + W) u' = -m w x u, with W of hubs and rims."""
    stiff_rubber = NO_FRICTION | {"creep_stiffness": 25.0}
    plant = planar([noiseless(**FREE | {"drivetrain": stiff_rubber})])
    remove_roller_losses(plant)
    set_twist(plant, start := [1.0, 0.5, 4.0])
    body, hubs = mass_matrices(plant)

    def rates(t: float, u: NDArray) -> NDArray:
        acceleration = np.linalg.solve(body + hubs, MASS_KG * u[2] * np.array([u[1], -u[0], 0.0]))
        return np.array([*acceleration, u[2]])

    plant.set_motor_currents(np.zeros((1, 4)))
    drive(plant, constant([0, 0, 0], 30, 1))
    solution = solve_ivp(rates, (0, 30 * FRAME_S), [*start, 0.0], rtol=1e-9)
    forward, sideways, rate, heading = solution.y[:, -1]
    x, y, turn_rate = plant.twist()[0]
    # The tolerance covers creep and the steps of a cycle. If the momentum of rims kept its
    # direction in the world frame, the error would be 0.022 rad.
    expected = (forward + 1j * sideways) * np.exp(1j * heading)
    assert np.angle((x + 1j * y) / expected) == pytest.approx(0, abs=0.006)
    assert turn_rate == pytest.approx(rate, rel=0.005)


def test_a_robot_that_would_topple_stops_and_does_not_change_others() -> None:
    force = {"kind": "push", "start_s": 0.0, "duration_s": 0.2, "force_n": 60.0}
    load = {"kind": "payload", "start_s": 0.0, "mass_kg": 2.0, "height_m": 0.3}
    plant = planar([noiseless(fault=[force, load]), noiseless()])
    failures: dict[int, str] = {}
    for _ in range(10):
        failures |= plant.advance(
            receive_at_once(np.array([[0.0, 0, 0], [0.5, 0, 0]]), plant.pose()[:, 2])
        )
    assert list(failures) == [0]
    assert "topple" in failures[0]
    assert not plant.twist()[0].any()
    single = planar([noiseless()])
    for _ in range(10):
        single.advance(receive_at_once(np.array([[0.5, 0, 0]]), single.pose()[:, 2]))
    np.testing.assert_array_equal(plant.pose()[1], single.pose()[0])


def test_worlds_of_several_robots_are_refused() -> None:
    with pytest.raises(OmniError, match=r"plant planar"):
        om.Simulation(
            om.load_scenario("rect", plant="planar", world={"start_poses": [[0, 0, 0], [1, 0, 0]]}),
            ["comp-flc"],
        )


@pytest.mark.parametrize("azimuths", [[60, 180, 300], [60, 135, 225, 300]])
def test_errors_are_those_of_the_plant_mujoco(azimuths: list[float]) -> None:
    """Within 2 % on a short path; docs/explanation/planar-plant.md has whole scenarios."""
    rms_errors = []
    for plant in ("mujoco", "planar"):
        chosen = om.load_scenario(
            "rect", plant=plant, wheels={"azimuths_deg": azimuths, "model": "two-rollers"},
            reference={"waypoints": [[0, 0], [0.3, 0.1]], "settle_s": 0.0},
        )  # fmt: skip
        log = om.Simulation(chosen, ["comp-flc"]).run()
        error = (log.channel("ref") - log.channel("pose"))[..., :2]
        rms_errors.append(np.sqrt((error**2).sum(-1).mean()))
    assert rms_errors[1] == pytest.approx(rms_errors[0], rel=0.02)
