"""Creep: slip of wheels by the closed form, per wheel and per robot, at any time step."""

import numpy as np
import pytest
from benches.creep import contact_speed, slip_of_traction, traction_per_load
from benches.plant import (
    COM_HEIGHT_M,
    CONTACTS,
    GRAVITY,
    LOSSLESS,
    MASS_KG,
    OUTWARD,
    RADIUS_M,
    STIFF,
    TANGENTS,
    mujoco,
    noiseless,
    ramp,
)
from benches.step_recorder import StepRecorder
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from omni_mj.config.settings import Settings

STIFFNESS, FRICTION = 5.0, 0.8
FORWARD_TRAVEL = np.stack([TANGENTS[:, 0], OUTWARD[:, 0]], axis=-1)  # of wheels, at 1 m/s
HUB_INERTIA = 9e-6  # models/ssl_robot.xml
RIM_INERTIA = 1e-6 + 16 * (0.0015 * 0.0225**2 + 6e-8)
TWISTS = np.array([[1.5, 0, 0], [0, 1.5, 0], [1.0, 1.0, 0]])


def free(stiffness: float = STIFFNESS, **sections: dict[str, object]) -> Settings:
    """Return settings without drag and losses."""
    return noiseless(
        carpet={"rolling_resistance": 0.0},
        drivetrain=LOSSLESS | {"creep_stiffness": stiffness}, firmware=STIFF,
        battery={"resistance_ohm": 0.0}, **sections,
    )  # fmt: skip


@pytest.fixture(scope="module")
def driven() -> StepRecorder:
    return StepRecorder(mujoco([free()] * 3)).drive(ramp(TWISTS, 2.0, 55))


def test_each_wheel_slips_by_the_creep_law(driven: StepRecorder) -> None:
    """The slip is that of Pacejka's cubic, with the motor torque minus that of hub and rotor."""
    settings, window = free(), slice(16 * 20, 16 * 40)
    inertia = HUB_INERTIA + settings.motor.rotor_inertia_kg_m2 * settings.motor.gear_ratio**2
    hubs = driven.steps["wheels"]
    hub_torque = driven.hub_torque() - inertia * np.gradient(hubs, 1 / 960, axis=0)
    load, velocity = driven.steps["load"], driven.contact_velocity()
    travel = np.stack([(velocity * TANGENTS).sum(-1), (velocity * OUTWARD).sum(-1)], axis=-1)
    # Loads ripple as rollers change, so means are compared, and slips relative to the travel.
    pull = hub_torque[window].mean(0) / RADIUS_M / load[window].mean(0)
    expected = slip_of_traction(pull, [1.0, 0.0], STIFFNESS, FRICTION)
    slip = -driven.steps["slips"] * RADIUS_M / contact_speed(travel)
    measured = slip[window].mean(0)
    strong = np.abs(pull) > 0.08
    assert strong.sum() >= 10
    # 3 %: loads ripple as rollers change, by half of themselves and within a step.
    assert measured[strong] == pytest.approx(expected[strong], rel=0.03)
    assert np.abs(measured - expected).max() < 0.05 / STIFFNESS


def test_speeds_solve_the_differential_equation_of_the_law(driven: StepRecorder) -> None:
    """Hubs, rims and body in one equation, solved by scipy, with the torques of the motors."""
    start, end = 16 * 5, 16 * 35
    settings = free()
    inertia = HUB_INERTIA + settings.motor.rotor_inertia_kg_m2 * settings.motor.gear_ratio**2
    times = np.arange(end) / 960
    frames, torque = times[8::16], driven.hub_torque()[:end, 0].reshape(-1, 16, 4).mean(1)
    speed, hubs = driven.twist()[:, 0, 0], driven.steps["wheels"][:, 0]
    cosines = TANGENTS[:, 0]
    mass = MASS_KG + (RIM_INERTIA / RADIUS_M**2 * cosines**2).sum()

    def change(time: float, state: NDArray) -> NDArray:
        v, turning = state[0], state[1:]
        torques = np.array([np.interp(time, frames, torque[:, wheel]) for wheel in range(4)])
        # Load as in the test above, with the acceleration that it makes.
        slip = RADIUS_M * turning - v * cosines
        sums = np.array([np.ones(4), *CONTACTS.T])
        a = 2.0
        for _ in range(3):
            load = (
                MASS_KG * sums.T @ np.linalg.solve(sums @ sums.T, [GRAVITY, -a * COM_HEIGHT_M, 0.0])
            )
            pull = load * traction_per_load(slip, v * FORWARD_TRAVEL, STIFFNESS, FRICTION)
            a = pull @ cosines / mass
        return np.array([a, *((torques - pull * RADIUS_M) / inertia)])

    initial = [speed[start], *hubs[start]]
    solved = solve_ivp(
        change, (times[start], times[end - 1]), initial, "LSODA", times[start:end], rtol=1e-4
    )
    # 3 %: as above, of a speed that has grown from 0.15 to 1.4 m/s.
    assert solved.y[0, -1] == pytest.approx(speed[end - 1], rel=0.03)
    assert solved.y[1:, -1] == pytest.approx(hubs[end - 1], rel=0.03)
    assert np.abs(solved.y[0] - speed[start:end]).max() < 0.03


def test_creep_does_not_depend_on_the_step() -> None:
    lags = []
    for substeps in (1, 4):
        tape = StepRecorder(mujoco([free(physics={"substeps": substeps})] * 2)).drive(
            ramp(TWISTS[:2], 2.0, 35)
        )
        twist, hubs = (
            values[substeps * 16 * 20 :] for values in (tape.twist(), tape.steps["wheels"])
        )
        slips = tape.steps["slips"][substeps * 16 * 20 :] * RADIUS_M
        lags.append(np.abs(slips).mean((0, 2)) / [twist[:, 0, 0].mean(), twist[:, 1, 1].mean()])
        assert np.abs(hubs).max() > 10
    # 2 %: the ripple of the loads differs with the step.
    assert lags[1:] == pytest.approx(np.tile(lags[0], (1, 1)), rel=0.02)
