"""What faults must physically do to robots, by laws of mechanics and motors, and that they leave nothing behind."""

from typing import Any

import mujoco
import numpy as np
import pytest
from default_robot import COM_HEIGHT_M, CONTACTS, GRAVITY, MASS_KG, RADIUS_M, TANGENTS
from driving import FRAME_S, STIFF, constant, drive, quiet, ramp, rows, with_settings
from driving import mujoco as plant_of
from hypothesis import given
from hypothesis import settings as hypothesis_settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from taped import Tape

from omni_control.errors import OmniError
from omni_mj.plants.kinematic import KinematicPlant
from omni_mj.plants.mujoco import MujocoPlant
from omni_mj.scenarios.settings import Settings

# Rim and rollers turn along with a body that slides away under them (see test_sliding.py).
RIM_INERTIA = 1e-6 + 16 * (0.0015 * 0.0225**2 + 6e-8)
ROLLING_KG = RIM_INERTIA / RADIUS_M**2 * (TANGENTS**2).sum(0)
ICE: dict[str, Any] = {"carpet": {"friction": 0.01, "pile": 0.0}, "drive": {"roller_friction": 0.0}}
SETTLE, REST = 12, np.zeros(3)  # frames after which a robot stands
STILL = 1e-5  # m, rad: what it moves meanwhile on ice, twice over
FAST: dict[str, Any] = {"wheels": {"model": "two-rollers"}}
EVERYTHING: list[dict[str, Any]] = [
    {"kind": "push", "at": 0.05, "for": 0.1, "force_n": 15.0, "direction_deg": 30.0},
    {"kind": "tilt", "at": 0.1, "for": 0.1, "angle_deg": 3.0, "direction_deg": -60.0},
    {"kind": "friction", "at": 0.05, "for": 0.2, "to": 0.2},
    {"kind": "payload", "at": 0.1, "for": 0.1, "mass_kg": 0.8, "height_m": 0.13},
    {"kind": "motor-weak", "at": 0.0, "for": 0.2, "wheel": 3, "to": 0.6},
    {"kind": "gyro-bias", "at": 0.05, "for": 0.1, "rad_s": 0.5},
]


def meets(*faults: dict[str, Any], **sections: Any) -> Settings:
    """A robot to which these happen, from the frame `SETTLE` on if nothing else is said."""
    return quiet(**sections, fault=[{"at": SETTLE * FRAME_S, **each} for each in faults])


def standing(plant: MujocoPlant, frames: int = SETTLE) -> NDArray:
    """Poses of robots that are told to stand."""
    return drive(plant, constant(REST, frames, len(plant.pose())))


# --- pushes ---


def test_a_push_gives_momentum_and_ends() -> None:
    """M v = F t less what ice holds, whatever heading and direction; then the speed stays."""
    force, frames, bearings = 20.0, 6, (0.0, 90.0, -125.0)
    pushes = [{"kind": "push", "for": frames * FRAME_S, "force_n": force, "direction_deg": b} for b in bearings]
    plant = plant_of([meets(each, **ICE) for each in pushes] + [quiet(**ICE)], [[0, 0, h] for h in (0, 0, 0.7, 0)])
    standing(plant)
    standing(plant, frames)
    mass = MASS_KG + ROLLING_KG.mean()  # the same in all directions within 0.2 %
    direction = np.radians(bearings)
    towards = np.column_stack([np.cos(direction), np.sin(direction)])
    gained = plant.twist()[:3, :2] / (force * frames * FRAME_S / mass)
    # Ice takes up to 1.3 % of the force; rollers that come down take on the speed of the carpet, up to as much.
    np.testing.assert_allclose(gained, towards, atol=0.03)
    after = np.linalg.norm(plant.twist()[:3, :2], axis=1)
    standing(plant, 3)
    # Ice, 0.1 m/s^2, and rollers brake it.
    assert (np.abs(np.linalg.norm(plant.twist()[:3, :2], axis=1) - after) < 0.02).all()
    assert np.abs(plant.pose()[3]).max() < STILL


def test_pushes_add_up() -> None:
    """Two across each other are one along the diagonal; of two against each other nothing is left."""
    one, other, against = ({"kind": "push", "force_n": 6.0, "direction_deg": d} for d in (0, 90, 180))
    both = {"kind": "push", "force_n": 6.0 * 2**0.5, "direction_deg": 45}
    plant = plant_of([meets(*each, **ICE) for each in ((one, other), (both,), (one, against))])
    poses = standing(plant, 40)[-1]
    np.testing.assert_allclose(poses[0], poses[1], rtol=1e-9)
    assert np.abs(poses[2]).max() < STILL < 0.1 < poses[0, 0]


# --- slopes ---


def test_on_ice_a_slope_accelerates_by_g_sin() -> None:
    """Between two slopes, so that Coulomb's friction, which is the same but for 1 % of it, falls out."""
    frames, angles = 9, np.radians([4.0, 8.0])
    chosen = [
        meets({"kind": "tilt", "angle_deg": np.degrees(a), "direction_deg": d}, **ICE) for d in (0, 90) for a in angles
    ]
    plant = plant_of(chosen)
    standing(plant)
    standing(plant, frames)
    speed = np.array([plant.twist()[:2, 0], plant.twist()[2:, 1]])
    gained = np.diff(speed, axis=1)[:, 0] / (frames * FRAME_S)
    # Rims and rollers turn along. 2 %: rollers that come down take on the speed of the carpet.
    np.testing.assert_allclose(gained, GRAVITY * np.diff(np.sin(angles)) * MASS_KG / (MASS_KG + ROLLING_KG), rtol=0.02)


def test_a_robot_that_stands_on_a_slope_weighs_on_its_wheels_as_statics_says() -> None:
    """Loads add up to m g cos; their moment is that of g sin at the height of the centre of mass, downhill."""
    angle, bearings = np.radians(5.0), np.radians([0.0, 90.0, 180.0])
    tilts = [{"kind": "tilt", "angle_deg": 5.0, "direction_deg": np.degrees(b)} for b in bearings]
    plant = plant_of([meets(each, **FAST) for each in tilts] + [quiet(**FAST)])
    standing(plant, SETTLE + 40)
    load = plant._at.load.get()
    np.testing.assert_allclose(load.sum(1)[:3], MASS_KG * GRAVITY * np.cos(angle), rtol=2e-3)
    moment = load @ CONTACTS / GRAVITY
    downhill = np.column_stack([np.cos(bearings), np.sin(bearings)])
    # 1 %: springs that still swing by as much of what the tilt shifts.
    shift = MASS_KG * COM_HEIGHT_M * np.sin(angle)
    np.testing.assert_allclose(moment[:3] - np.cos(angle) * moment[3], shift * downhill, atol=0.01 * shift)
    assert np.abs(plant.pose()[:, :2]).max() < 1e-3, "gears and wheel loops hold it"


def test_robots_of_a_world_stand_on_one_carpet() -> None:
    """What leans for one leans for the other, whose rows must say so; other worlds' do not."""
    tilt = {"kind": "tilt", "angle_deg": 5.0, "direction_deg": 90.0}
    start = [[0, 0, 0], [1, 0, 0]] * 2
    plant = plant_of([meets(tilt, **ICE)] * 2 + [quiet(**ICE)] * 2, start, places=2)
    moved = standing(plant, 30)[-1] - start
    assert (moved[:2, 1] > 0.01).all()
    assert np.abs(moved[2:]).max() < STILL
    with pytest.raises(OmniError, match=r"^robots that share a world stand on one carpet: "):
        plant_of([meets(tilt, **ICE), quiet(**ICE)], start[:2], places=2)


# --- friction ---


def test_a_wheel_that_slides_pulls_by_the_friction_of_the_moment() -> None:
    """Momentum over what the wheels bear, along the rims, before, while and after."""
    usual, other, first, frames = 0.25, 0.5, 4, 7
    fault = {"kind": "friction", "at": first * FRAME_S, "for": frames * FRAME_S, "to": other}
    free: dict[str, Any] = {"drive": {"roller_friction": 0.0, "roller_damping_nm_s": 0.0}, "firmware": STIFF}
    tape = Tape(plant_of([meets(fault, carpet={"friction": usual, "pile": 0.0}, **free)]))
    tape.drive(constant([3.6, 0.0, 0.0], 18, 1))
    # From some steps after a change on, when the load has swung.
    for start, stop, friction in ((20, 60, usual), (80, 170, other), (190, 280, usual)):
        slips, load = tape.steps["slips"][start:stop], tape.steps["load"][start:stop]
        assert (np.abs(slips) * RADIUS_M > 0.1).all(), "every wheel slides"
        velocity = tape.steps["velocity"][:, 0, 0]
        gained = (MASS_KG + ROLLING_KG[0]) * (velocity[stop - 1] - velocity[start - 1])
        pull = ((-np.sign(slips) * load) @ TANGENTS[:, 0]).sum() / 960
        assert gained / pull == pytest.approx(friction, rel=0.03), start  # 2 % as in test_sliding.py, and short


def test_patches_keep_their_friction() -> None:
    """A robot on a patch that covers all feels no change of the carpet."""
    patch = {"friction": 0.8, "patches": [[0, 0, 5.0, 0.3]]}
    fault = {"kind": "friction", "at": 0.0, "to": 0.9}
    poses = drive(plant_of([meets(fault, carpet=patch), quiet(carpet=patch)]), constant([2.0, 0, 0], 20, 2))
    np.testing.assert_array_equal(poses[:, 0], poses[:, 1])


# --- loads ---


def chassis_of(plant: MujocoPlant, row: int) -> tuple[float, NDArray, NDArray]:
    """Mass, centre of mass, and inertia about it in its own axes, as the batch has them."""
    body = plant._world.robots[0].chassis
    mass, centre, moments, turned = (
        plant._batch.expand(name)[row, body] for name in ("body_mass", "body_ipos", "body_inertia", "body_iquat")
    )
    axes = np.zeros(9)
    mujoco.mju_quat2Mat(axes, turned)
    axes = axes.reshape(3, 3)
    return float(mass), centre.copy(), axes @ np.diag(moments) @ axes.T


def inertia_about(origin: NDArray, body: tuple[float, NDArray, NDArray]) -> NDArray:
    mass, centre, inertia = body
    r = centre - origin
    return inertia + mass * (r @ r * np.eye(3) - np.outer(r, r))


@hypothesis_settings(deadline=None, max_examples=6, derandomize=True)
@given(st.lists(st.tuples(st.floats(0, 20), st.floats(0.001, 0.5)), min_size=1, max_size=3))
def test_a_load_is_a_point_mass_on_the_chassis(loads: list[tuple[float, float]]) -> None:
    """Mass, first and second moments about the origin are sums over the bodies: they are independent of its axes."""
    payloads = [{"kind": "payload", "at": 0.0, "mass_kg": m, "height_m": h} for m, h in loads]
    plant = plant_of([meets(*payloads), quiet()])
    empty = chassis_of(plant, 0)
    standing(plant, 1)
    loaded, beside = chassis_of(plant, 0), chassis_of(plant, 1)
    points = [(m, np.array([*empty[1][:2], h])) for m, h in loads]
    assert loaded[0] == pytest.approx(empty[0] + sum(m for m, _ in points))
    np.testing.assert_allclose(loaded[0] * loaded[1], empty[0] * empty[1] + sum(m * r for m, r in points), atol=1e-12)
    zero = np.zeros(3)
    expected = inertia_about(zero, empty) + sum(inertia_about(zero, (m, r, np.zeros((3, 3)))) for m, r in points)
    np.testing.assert_allclose(inertia_about(zero, loaded), expected, rtol=0, atol=1e-12 * np.abs(expected).max())
    np.testing.assert_array_equal(beside[2], empty[2])
    subtree = plant._batch.expand("body_subtreemass")[0, plant._world.robots[0].chassis]
    assert subtree == pytest.approx(MASS_KG + sum(m for m, _ in points))


def test_wheels_bear_a_load_and_its_inertia() -> None:
    """Weight on the wheels, their middle below the common centre of mass on a slope, and what a push does on ice."""
    mass, height = 1.2, 0.12
    load, more = {"kind": "payload", "mass_kg": mass, "height_m": height}, {"kind": "payload", "mass_kg": mass}
    tilt = {"kind": "tilt", "angle_deg": 5.0}
    own = [meets(*each, **FAST) for each in ((load,), (more,), (load, tilt), (tilt,))]
    plant = plant_of([*own, quiet(**FAST)])
    standing(plant, SETTLE + 60)
    bears = plant._at.load.get()
    np.testing.assert_allclose(bears[:2].sum(1), (MASS_KG + mass) * GRAVITY, rtol=2e-3)
    ahead = bears @ CONTACTS[:, 0] / GRAVITY
    chassis = plant._world.model.body_ipos[plant._world.robots[0].chassis]
    # Over the chassis' centre of mass: what it adds, and how far a slope shifts it. Springs still swing: by 2 % of what
    # the slope shifts, and by 0.03 mm of the centre.
    assert ahead[0] - ahead[4] == pytest.approx(mass * chassis[0], abs=1e-4)
    angle = np.radians(5.0)
    shift = (ahead[2] - np.cos(angle) * ahead[0]) - (ahead[3] - np.cos(angle) * ahead[4])
    assert shift == pytest.approx(mass * height * np.sin(angle), rel=0.02)

    push = {"kind": "push", "at": 2 * SETTLE * FRAME_S, "force_n": 12.0, "direction_deg": 90.0}
    plant = plant_of([meets(more, push, **ICE), meets(push, **ICE)])
    standing(plant, 2 * SETTLE + 8)
    heavy, light = plant.twist()[:, 1]
    ratio = (MASS_KG + ROLLING_KG[1]) / (MASS_KG + mass + ROLLING_KG[1])
    # Friction of ice is 2.5 % of this push, and as much more as the mass; 1 %: rollers that come down.
    held = 0.01 * GRAVITY / 12.0
    assert heavy / light == pytest.approx(ratio * (1 - (MASS_KG + mass) * held) / (1 - MASS_KG * held), rel=0.01)


# --- motors and gyros ---


def test_a_weak_motor_pulls_and_turns_by_its_constant() -> None:
    """At full voltage, free of load: w = V / K, of the one wheel that is weak; and after that as before."""
    share, motor = 0.6, {"no_load_current_a": 0.0}
    slick = {"carpet": {"friction": 0.01}, "drive": {"gear_friction_nm": 0.0, "roller_friction": 0.0}}
    fault = {"kind": "motor-weak", "at": 0.0, "for": 0.7, "wheel": 2, "to": share}
    plant = plant_of([meets(fault, motor=motor, **slick, **FAST), quiet(motor=motor, **slick, **FAST)])
    expected = np.ones((2, 4))
    sheet = Settings().motor
    for weak in (share, 1.0):
        drive(plant, constant([0, 0, 100.0], 42, 2))
        expected[0, 1], told = weak, plant.telemetry()
        assert (told.duty_peak == 1).all()
        constants = sheet.constant_nm_a * sheet.gear * expected
        # As in test_variation.py: what is left of friction 0.01 and of the run-up, and magnets that warm up by 2 K.
        np.testing.assert_allclose(told.voltage / told.wheel_speed, constants, rtol=5e-3)
        np.testing.assert_allclose(plant._motors.constant / sheet.constant_nm_a, expected, rtol=2e-3)


def test_a_gyros_bias_turns_what_a_robot_holds_for_its_heading() -> None:
    """By bias times time, where vision corrects nothing."""
    bias, frames = 0.4, 20
    fault = {"kind": "gyro-bias", "for": frames * FRAME_S, "rad_s": bias}
    blind = {"heading_gain": 0.0, "bias_gain": 0.0, "turn_gain": 0.0}
    plant = plant_of([meets(fault, firmware=blind), quiet(firmware=blind)])
    standing(plant, SETTLE + frames + 10)
    drift = plant._firmware.estimate.heading - plant.pose()[:, 2]
    np.testing.assert_allclose(drift, [bias * frames * FRAME_S, 0.0], atol=1e-4)  # the gyro is a cycle late


def test_alpha_takes_the_place_of_what_is_drawn() -> None:
    """Equation 7 as a sum; before and after, and beside, what would have been drawn anyway."""
    commands = np.random.default_rng(0).normal(size=(30, 2, 3))
    fault = {"kind": "alpha", "at": 10 * FRAME_S, "for": 0.2, "to": 0.3}
    chosen = [with_settings(fault=[fault]), Settings()]
    poses = drive(KinematicPlant(rows(chosen, [3, 3]), np.zeros((2, 3))), commands)
    moved = np.diff(poses, axis=0)
    np.testing.assert_allclose(moved[10:22, 0], 0.3 * FRAME_S * commands[10:22, 0], atol=1e-12)
    others = [*range(10), *range(22, 30)]
    np.testing.assert_allclose((moved / commands)[others, 0], (moved / commands)[others, 1], rtol=1e-9)
    alone = drive(KinematicPlant(rows(chosen[:1], [3]), np.zeros((1, 3))), commands[:, :1])
    np.testing.assert_array_equal(alone[:, 0], poses[:, 0])


# --- rows ---


@pytest.mark.parametrize(
    ("model", "happening"),
    [("rollers", [[], EVERYTHING]), ("two-rollers", [[], EVERYTHING, *([each] for each in EVERYTHING)])],
)
def test_what_happens_to_a_row_concerns_no_other(model: str, happening: list[list[dict[str, Any]]]) -> None:
    """To the last bit: all together, and those with nothing and with everything alone, the others by themselves."""
    own = [with_settings(wheels={"model": model}, fault=each) for each in happening]
    commands = ramp([[1.5, 0.3, 2.0]] * len(own), 3.0, 16)
    together = drive(plant_of(own), commands)
    for part in filter(len, ([0], [1], range(2, len(own)))):
        apart = drive(plant_of([own[i] for i in part]), commands[:, : len(part)])
        np.testing.assert_array_equal(apart, together[:, list(part)])
    for i, each in enumerate(own[1:], 1):
        assert (together[-1, i] != together[-1, 0]).all(), each.fault


def test_a_fault_that_has_ended_leaves_nothing_behind() -> None:
    """Every field of the model, friction, motors and forces are those of a robot that met nothing."""
    plant = plant_of([with_settings(fault=EVERYTHING), with_settings(variation={"mass": 0.1, "centre_m": 0.005})])
    fields = ("body_mass", "body_subtreemass", "body_ipos", "body_inertia", "body_iquat", "opt.gravity")

    def state() -> list[NDArray]:
        traction = plant._traction
        own = [plant._batch.expand(name) for name in fields] + [traction.centre, plant._motors._cold_constant]
        return [np.array(each) for each in (*own, traction.carpet.friction(np.zeros(2, complex), np.ones(2, complex)))]

    before = state()
    standing(plant, 7)
    during = state()
    # Of the other robot, which is no two's like, nothing ever changes.
    assert all((now[0] != then[0]).any() for now, then in zip(during, before, strict=True))
    assert all((now[1] == then[1]).all() for now, then in zip(during, before, strict=True))
    standing(plant, 9)
    for now, then in zip(state(), before, strict=True):
        np.testing.assert_array_equal(now, then)
    assert not plant._faults.push.any()
    assert not plant._faults.gyro.any()


def test_a_robot_that_failed_is_pushed_no_more() -> None:
    """In a world that another robot, which is, keeps going."""
    plant = plant_of([meets({"kind": "push", "at": 0.0, "force_n": 9.0}, **ICE)] * 2, [[0, 0, 0], [1, 0, 0]], places=2)
    plant._stop([0], [])
    standing(plant, 10)
    assert plant.pose()[0, 0] < STILL < 0.03 < plant.pose()[1, 0] - 1


def test_rows_at_several_places_meet_their_own() -> None:
    """A payload and a push of the second robot of the second world are its alone."""
    start = [[0, 0, 0], [1, 0, 0]] * 2
    push, load = {"kind": "push", "force_n": 9.0}, {"kind": "payload", "mass_kg": 1.0}
    plant = plant_of([*[quiet(**ICE)] * 3, meets(push, load, **ICE)], start, places=2)
    moved = standing(plant, SETTLE + 10)[-1] - start
    assert (np.abs(moved[:3]) < STILL).all()
    assert moved[3, 0] > 0.03
    mass = plant._batch.expand("body_mass")
    chassis = [robot.chassis for robot in plant._world.robots]
    np.testing.assert_allclose(mass[1, chassis[1]] - mass[:, chassis].ravel()[:3], 1.0)
