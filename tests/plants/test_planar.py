"""The plant planar: mechanics, creep, rejected rows, and agreement with the plant mujoco."""

import math
from typing import Any

import numpy as np
import pytest
from benches.plant import (
    ARM_M,
    COM_HEIGHT_M,
    CONTACTS,
    FRAME_S,
    GRAVITY,
    MASS_KG,
    RADIUS_M,
    STIFF,
    TANGENTS,
    constant,
    drive,
    mass_matrices,
    noiseless,
    planar,
    ramp,
    receive_at_once,
    remove_roller_losses,
    set_twist,
    wheel_loads,
)
from numpy.typing import ArrayLike, NDArray
from scipy.integrate import solve_ivp

import omni_mj as om
from omni_control.errors import OmniError
from omni_mj.config.resolve import resolve_settings

STIFFNESS = 2.5
NO_FRICTION = {"roller_friction": 0.0, "gear_friction_nm": 0.0, "roller_damping_nm_s": 0.0}
FREE: dict[str, Any] = {
    "carpet": {"rolling_resistance": 0.0},
    "drivetrain": NO_FRICTION | {"creep_stiffness": STIFFNESS},
    "firmware": STIFF,
    "battery": {"resistance_ohm": 0.0},
    "motor": {"no_load_current_a": 0.0},
}


def statics(acceleration: ArrayLike) -> NDArray:
    """Return the forces of four springs, (4,) N, under an acceleration, body axes, (2,) m/s^2."""
    sums = np.array([np.ones(4), *CONTACTS.T])
    moments = [GRAVITY, *(-np.asarray(acceleration) * COM_HEIGHT_M)]
    return MASS_KG * sums.T @ np.linalg.solve(sums @ sums.T, moments)


@pytest.mark.parametrize("axis", [0, 1])
def test_a_body_lags_behind_its_wheels_by_t_times_its_acceleration(axis: int) -> None:
    """u - v = T |v| a with T = (B' N B)^-1 M / C, N by statics; see tests/mjcf/test_creep.py."""
    plant, twist = planar([noiseless(**FREE)]), np.eye(3)[axis] * 1.5
    commands = ramp([twist], 2.0, 55)
    drive(plant, commands[:25])
    poses, angles = [plant.pose()[0]], [plant.telemetry().wheel_angle[0]]
    for command in commands[25:40]:
        poses.append(drive(plant, command[None])[-1][0])
        angles.append(plant.telemetry().wheel_angle[0])
    b = np.column_stack([TANGENTS, 4 * [ARM_M]])
    body, wheels = np.diff(poses, axis=0) / FRAME_S, np.diff(angles, axis=0) / FRAME_S * RADIUS_M
    a = np.polyfit(np.arange(len(body)) * FRAME_S, body, 1)[0]
    mass = np.diag([MASS_KG, MASS_KG, resolve_settings().body.yaw_inertia_kg_m2])
    lag = np.linalg.solve(b.T * statics(a[:2]) @ b, mass @ a) / STIFFNESS
    measured = ((wheels @ np.linalg.pinv(b).T - body)[:, axis] / body[:, axis]).mean()
    # 5 %: rims turn with the body, 2 %; the carpet yields, 1 %; the rolling radius, 0.1 % of the
    # speed and 2 % of the lag.
    assert measured == pytest.approx(lag[axis], rel=0.05)


def test_traction_of_sliding_wheels_is_friction_times_normal_force() -> None:
    friction = 0.3
    carpet = {"rolling_resistance": 0.0, "friction": friction}
    plant, speeds = planar([noiseless(**FREE | {"carpet": carpet})]), []
    for command in constant([3.6, 0.0, 0.0], 15, 1):
        drive(plant, command[None])
        speeds.append(plant.twist()[0, 0])
    assert (plant.telemetry().slip > 0.1).all()
    acceleration = (speeds[-1] - speeds[4]) / (10 * FRAME_S)
    # 2 %: rims turn with the body; 1 %: the carpet yields.
    load = statics([acceleration, 0.0])
    force = friction * load @ np.abs(TANGENTS[:, 0])
    assert acceleration * MASS_KG == pytest.approx(force, rel=0.03)


def test_normal_forces_on_a_slope_are_those_of_statics() -> None:
    """Their sum is m g cos, their moment that of m g sin at the center of mass, downhill."""
    faults = [{"kind": "motor-blocked", "start_s": 0.0, "wheel": wheel} for wheel in (1, 2, 3, 4)]
    tilt = {"kind": "tilt", "start_s": 0.0, "angle_deg": 5.0, "direction_deg": 30.0}
    plant = planar([noiseless(fault=[tilt, *faults])])
    drive(plant, constant([0, 0, 0], 60, 1))
    (load,) = wheel_loads(plant)
    angle, downhill = math.radians(5), np.array([math.cos(math.pi / 6), 0.5])
    weight, shift = MASS_KG * GRAVITY * np.array([math.cos(angle), math.sin(angle) * COM_HEIGHT_M])
    assert load.sum() == pytest.approx(weight, rel=1e-9)
    np.testing.assert_allclose(load @ CONTACTS, shift * downhill, atol=1e-3 * shift)


def test_without_motor_currents_a_robot_slows_down_and_stays_at_rest() -> None:
    plant = planar([noiseless(), noiseless()])
    set_twist(plant, [1.0, 0.5, 0.0])
    plant.set_motor_currents(np.zeros((2, 4)))
    speeds = []
    for _ in range(60):
        drive(plant, constant([0, 0, 0], 1, 2))
        speeds.append(np.hypot(*plant.twist()[0, :2]))
    assert (np.diff(speeds)[np.array(speeds[1:]) > 1e-4] < 0).all()
    assert speeds[-1] < 0.3 * speeds[0]
    assert np.abs(plant.pose()[1]).max() < 1e-9


def test_a_rolling_and_turning_robot_follows_lagranges_equations() -> None:
    """Wheels keep their speeds: in body axes (M + W) u' = -m w x u, with W of hubs and rims."""
    plant = planar([noiseless(**FREE)])
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
