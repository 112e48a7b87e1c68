"""Sliding wheels: Coulomb's law, the friction circle, and Newton's laws of robots on the carpet."""

import numpy as np
import pytest
from benches.plant import (
    CONTACTS,
    MASS_KG,
    OUTWARD,
    RADIUS_M,
    ROLLING_KG,
    STIFF,
    TANGENTS,
    constant,
    mujoco,
    noiseless,
    receive_at_once,
)
from benches.step_recorder import StepRecorder
from numpy.typing import NDArray

from omni_mj.config.settings import Settings

FORWARD, LEFT, DIAGONAL, TURN = np.array([[1, 0, 0], [0, 1, 0], [0.7, 0.7, 0], [0, 0, 12.0]])
MODELS = ("rollers", "two-rollers")


def stiff(friction: float, **sections: dict[str, object]) -> Settings:
    """Return settings in which the carpet limits the robot, not the firmware."""
    return noiseless(
        carpet={"friction": friction} | sections.pop("carpet", {}), firmware=STIFF, **sections
    )


def free(friction: float, bearing: float = 0.0) -> Settings:
    """Return settings whose only drag is that of roller bearings."""
    return stiff(
        friction,
        carpet={"rolling_resistance": 0.0},
        drivetrain={"roller_friction": bearing, "roller_damping_nm_s": 0.0},
    )


def impulses(tape: StepRecorder, first_step: int, last_step: int) -> tuple[NDArray, NDArray]:
    """Return the momentum gained between two steps, and what sliding rims would give, N s."""
    load, slips, heading = (
        values[first_step:last_step]
        for values in (tape.steps["load"], tape.steps["slips"], tape.heading())
    )
    assert (np.abs(slips) * RADIUS_M > 0.1).all(), "every wheel slides"
    pull = (-np.sign(slips) * load) @ TANGENTS
    c, s = np.cos(heading)[..., None], np.sin(heading)[..., None]
    pull = np.concatenate(
        [c * pull[..., :1] - s * pull[..., 1:], s * pull[..., :1] + c * pull[..., 1:]], axis=-1
    )
    velocity = tape.steps["velocity"][[first_step - 1, last_step - 1], :, :2]
    return (MASS_KG + ROLLING_KG) * (velocity[1] - velocity[0]), pull.sum(0) / 960


def test_traction_over_load_is_the_friction() -> None:
    frictions = np.repeat([0.2, 0.4, 0.6, 0.8, 1.0], 2)
    tape = StepRecorder(mujoco([free(f) for f in frictions])).drive(
        constant(np.tile(3.6 * np.array([FORWARD, LEFT]), (5, 1)), 14, 10)
    )
    momentum_gain, pull = impulses(tape, 40, 200)
    ratio = np.linalg.norm(momentum_gain, axis=1) / np.linalg.norm(pull, axis=1)
    # 2 %; of these half a per cent is what spinning up rollers costs that come down
    # (two_rollers.py: 0.9 g v each).
    assert ratio == pytest.approx(frictions, rel=0.02)


def test_bearing_friction_uses_part_of_the_friction_circle() -> None:
    """A pull of b N on roller bearings along the axle leaves sqrt(mu^2 - b^2) N for the rim."""
    friction, bearings = 0.5, np.array([0.2, 0.35])
    tape = StepRecorder(mujoco([free(friction, b) for b in bearings])).drive(
        constant(3.6 * FORWARD, 14, 2)
    )
    momentum_gain, pull = impulses(
        tape, 60, 200
    )  # by then the bearings turn: rollers travel faster than 1 cm/s
    axle = np.sign((tape.contact_velocity() * OUTWARD).sum(-1)) * tape.steps["load"]
    fixed = (axle[60:200] @ OUTWARD).sum(0)[:, 0] * bearings / 960
    # As above.
    assert momentum_gain[:, 0] == pytest.approx(
        np.sqrt(friction**2 - bearings**2) * pull[:, 0] - fixed, rel=0.02
    )
    assert (momentum_gain[:, 0] < 0.97 * (friction * pull[:, 0] - fixed)).any(), "it matters"


@pytest.mark.parametrize("model", MODELS)
def test_no_wheel_leaves_the_carpet_while_wheels_slide(model: str) -> None:
    """Wheels stay within 0.1 mm, at 0.5 to 3 m/s, for all frictions and directions."""
    commands = np.array(
        [speed * twist for speed in (1.0, 3.0) for twist in (FORWARD, LEFT, DIAGONAL, TURN)]
    )
    settings = [stiff(f, wheels={"model": model}) for f in (0.3, 0.5, 0.8) for _ in commands]
    tape = StepRecorder(mujoco(settings)).drive(constant(np.tile(commands, (3, 1)), 30, 24))
    fastest = np.abs(tape.steps["slips"]).max((0, 2)) * RADIUS_M
    assert fastest.min() > 0.5
    assert fastest.max() > 2.9
    assert tape.lift().max() < 1e-4
    # Nor is it thrown about: nothing presses harder than standing still and load transfer together.
    assert tape.steps["load"].max() < MASS_KG * 9.81


@pytest.mark.parametrize("model", MODELS)
def test_a_reversal_at_full_speed_does_not_topple_a_robot(model: str) -> None:
    """A step from 3 m/s to -3 m/s; by statics every wheel stays loaded."""
    fraction = np.append(np.minimum(1.0, 0.04 * np.arange(45)), -np.ones(50))
    commands = fraction[:, None, None] * 3 * np.tile([FORWARD, LEFT, DIAGONAL], (2, 1))
    tape = StepRecorder(
        mujoco([stiff(f, wheels={"model": model}) for f in (0.6, 0.8) for _ in range(3)])
    ).drive(commands)
    assert (tape.twist()[-1, [0, 3], 0] < -1.0).all(), "it drives backwards"
    # The spring of the contacts, 0.2 of critically damped, overshoots by half when traction turns
    # at once: at friction 0.8 the rear wheels, which statics leaves 3 N of 11 N, come off for a
    # moment.
    assert tape.lift().max() < 2e-3
    assert np.degrees(tape.tilt().max()) < 1.0


def stands(height: float, friction: float) -> bool:
    """Return whether a robot with this center of mass stays upright when reversed from 3 m/s."""
    settings = free(friction).replace(body={"com_height_m": height, "tilt_inertia_kg_m2": 0.0085})
    # In a sixth of a second, for what it stands on overshoots when traction turns at once.
    fraction = np.append(
        np.minimum(1.0, 0.04 * np.arange(45)), np.maximum(-1.0, 1 - 0.2 * np.arange(45))
    )
    plant = mujoco([settings])
    return not any(
        plant.advance(receive_at_once(3 * direction * FORWARD[None], plant.pose()[:, 2]))
        for direction in fraction
    )


@pytest.mark.parametrize("friction", [0.8, 1.0])
def test_robots_topple_where_statics_predicts(friction: float) -> None:
    """It tips over its front wheels if a h > g x, with a = mu g times their forward fraction."""
    height = CONTACTS[0, 0] / (friction * abs(TANGENTS[0, 0]))
    # 5 % for what is left of the overshoot, and 3 % for the time that falling takes.
    assert stands(0.95 * height, friction)
    assert not stands(1.03 * height, friction)
