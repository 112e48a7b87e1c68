"""The planar plant: laws of mechanics and creep, and that its numbers depend neither on the batch nor on the kernel."""

import math
from typing import Any

import compiled
import numpy as np
import pytest
from default_robot import ARM_M, COM_HEIGHT_M, CONTACTS, GRAVITY, MASS_KG, RADIUS_M, TANGENTS
from driving import FRAME_S, STIFF, constant, drive, mujoco, quiet, ramp, rows, with_settings
from numpy.typing import ArrayLike, NDArray
from omni_mj.plants.planar.plant import PlanarPlant
from scipy.integrate import solve_ivp

import omni_mj as om
from omni_control.errors import OmniError
from omni_mj.link.radio import Received
from omni_mj.scenarios.settings import Settings
from omni_mj.worlds import build

STIFFNESS = 2.5
NOTHING = {"roller_friction": 0.0, "gear_friction_nm": 0.0, "roller_damping_nm_s": 0.0}
FREE: dict[str, Any] = {
    "carpet": {"pile": 0.0}, "drive": NOTHING | {"creep_stiffness": STIFFNESS}, "firmware": STIFF,
    "battery": {"resistance_ohm": 0.0}, "motor": {"no_load_current_a": 0.0},
}  # fmt: skip


def planar(chosen: list[Settings], start: ArrayLike | None = None, seeds: list[int] | None = None) -> PlanarPlant:
    poses = np.zeros((len(chosen), 3)) if start is None else np.asarray(start, float)
    compiled.ready("planar", chosen)
    return PlanarPlant(rows(chosen, seeds), poses)


def driven(plant: PlanarPlant, commands: NDArray) -> dict[str, NDArray]:
    """After each frame twists in the body's frame, slips in m/s, loads, torques on rims; means of it: `moved`, hubs.

    `pressed` are the loads of which slips and torques are: those before the last cycle.
    """
    names = "twist", "moved", "hubs", "slip", "load", "torque", "pressed"
    found: dict[str, list[NDArray]] = {name: [] for name in names}
    for command in commands:
        before = plant.pose()
        assert plant.advance(Received(command, plant.pose()[:, 2], np.zeros(len(command), int))) == {}
        m, turn = plant._motion, np.exp(-1j * plant.pose()[:, 2])
        x, y, w = plant.twist().T
        body = (x + 1j * y) * turn
        moved = (plant.pose() - before) / FRAME_S  # of robots that keep their heading
        values = (
            np.stack([body.real, body.imag, w], axis=1),
            moved,
            plant._speeds.mean(0),
            (m.speed - m.rims).T * RADIUS_M,
            m.load.T,
            m.torque.T,
            plant._traction.limit / plant._traction._rim_friction,
        )
        for name, value in zip(found, values, strict=True):
            found[name].append(value.copy())
    return {name: np.array(values) for name, values in found.items()}


def statics(acceleration: ArrayLike) -> NDArray:
    """Loads of four springs, (4,) N, of a robot that wheels speed up, m/s^2 ahead and aside."""
    sums = np.array([np.ones(4), *CONTACTS.T])
    moments = [GRAVITY, *(-np.asarray(acceleration) * COM_HEIGHT_M)]
    return MASS_KG * sums.T @ np.linalg.solve(sums @ sums.T, moments)


def test_each_wheel_slips_by_the_law_and_the_body_lags_by_t() -> None:
    """s = |v| f / (N C); u - v = T |v| a with T = (B' N B)^-1 M / C, N by statics; see tests/worlds/test_creep.py."""
    twists = np.array([[1.5, 0, 0], [0, 1.5, 0]])
    seen, window = driven(planar([quiet(**FREE)] * 2), ramp(twists, 2.0, 55)), slice(25, 40)
    turning = seen["twist"][..., 2, None, None] * np.stack([-CONTACTS[:, 1], CONTACTS[:, 0]], axis=1)
    speed = np.linalg.norm(seen["twist"][..., None, :2] + turning, axis=-1)[window]
    pull = seen["torque"][window] / RADIUS_M
    law = speed * pull / (seen["pressed"][window] * STIFFNESS)
    # 1.5 %: |v| is that of up to four cycles before, 8 mm/s or 1 % less than here; the lever is 0.1 % below the radius.
    np.testing.assert_allclose(seen["slip"][window].mean(0), law.mean(0), atol=0.015 * np.abs(law).mean())

    b = np.column_stack([TANGENTS, 4 * [ARM_M]])
    mass = np.diag([MASS_KG, MASS_KG, Settings().body.yaw_inertia_kg_m2])
    for row in (0, 1):
        twist, wheels = seen["moved"][window, row], RADIUS_M * seen["hubs"][window, row] @ np.linalg.pinv(b).T
        a = np.polyfit(np.arange(len(twist)) * FRAME_S, twist, 1)[0]
        load = statics(a[:2])
        lag = np.linalg.solve(b.T * load @ b, mass @ a) / STIFFNESS
        behind = ((wheels - twist)[:, row] / twist[:, row]).mean()
        # 5 %: rims turn with the body, 2 %; carpet that yields, 1 %; the lever, 0.1 % of the speed and 2 % of the lag.
        assert behind == pytest.approx(lag[row], rel=0.05)


def test_a_sliding_wheel_pulls_by_friction_times_load() -> None:
    friction = 0.3
    slick = FREE | {"carpet": {"pile": 0.0, "friction": friction}}
    plant = planar([quiet(**slick)])
    seen = driven(plant, constant([3.6, 0.0, 0.0], 18, 1))
    sliding = slice(4, 15)
    assert (np.abs(seen["slip"][sliding]) > 0.1).all()
    speed = seen["twist"][:, 0, 0]
    gained = np.diff(speed)[sliding] / FRAME_S
    pull = np.abs(seen["torque"][sliding, 0]) / RADIUS_M
    np.testing.assert_allclose(pull, friction * seen["pressed"][sliding, 0], rtol=1e-9)
    # Rollers that pass let loads ripple; on the mean they are those of statics. All four pull ahead by their cosines.
    load = statics([gained.mean(), 0.0])
    # 2 %: rims turn with the body; 1 %: carpet that yields.
    assert gained.mean() * MASS_KG == pytest.approx(friction * load @ np.abs(TANGENTS[:, 0]), rel=0.03)


def test_loads_ripple_and_robots_sway_as_on_the_full_plant() -> None:
    """There rollers, springs and a body in space do it. Ahead, wheels of a pair turn alike, which aside none do."""
    twists = np.array([[1.0, 0, 0], [0, 1.0, 0], [0, 0.5, 0]])
    chosen, commands, loads = [quiet()] * 3, ramp(twists, 2.0, 75), []
    full = mujoco(chosen)
    for command in commands:
        full.go(1, Received(command, full.pose()[:, 2], np.zeros(3, int)))
        for _ in range(1, full.cycles):
            full.go(1)
            loads.append(full._at.load.get().copy())
    whole = np.array(loads)[45 * 15 :]
    seen = driven(planar(chosen), commands)["load"][45:]
    np.testing.assert_allclose(seen.mean(0), whole.mean(0), rtol=0.03)  # a standard error of 30 frames
    # A quarter: half of it is the standard error of 120 values, the rest are higher harmonics, which only the full
    # plant has. Without ripple a robot that cruises has less than a tenth of this.
    np.testing.assert_allclose(seen.std(0).mean(1), whole.std(0).mean(1), rtol=0.25)
    assert (whole.std(0).mean(1) > 0.25).all()


def test_a_robot_on_a_slope_weighs_on_its_wheels_as_statics_says() -> None:
    """Loads add up to m g cos; their moment is that of g sin at the height of the centre of mass, downhill."""
    tilt = {"kind": "tilt", "at": 0.0, "angle_deg": 5.0, "direction_deg": 30.0}
    plant = planar([quiet(fault=[tilt])] * 2)
    plant.block(np.array([4 * [True], 4 * [False]]))
    still, creeping = driven(plant, constant([0, 0, 0], 60, 2))["load"][20:].mean(0)
    angle, downhill = math.radians(5), np.array([math.cos(math.pi / 6), 0.5])
    weight, shift = MASS_KG * GRAVITY * np.array([math.cos(angle), math.sin(angle) * COM_HEIGHT_M])
    assert still.sum() == pytest.approx(weight, rel=1e-9)
    np.testing.assert_allclose(still @ CONTACTS, shift * downhill, atol=1e-4 * shift)
    # Between counts it creeps, and sways on the rollers that turn: by 2 mN, or by 7 on the full plant, of 26 N.
    assert creeping.sum() == pytest.approx(weight, rel=1e-5)
    np.testing.assert_allclose(creeping @ CONTACTS, shift * downhill, atol=0.03 * shift)


def test_energy_of_a_rolling_robot_only_falls_and_a_still_one_stays() -> None:
    plant = planar([quiet(), quiet()])
    m, r = plant._motion, plant._robots
    m.twist[:, 0] = forward = [1.0, 0.5, 0.0]
    m.speed[:, 0] = forward @ r.rims[..., 0].T
    plant.hold(np.zeros((2, 4)))
    energy = []
    for _ in range(60):
        drive(plant, constant([0, 0, 0], 1, 2))
        hubs = plant._bodies.hub[0, 0] * (m.speed[:, 0] ** 2).sum()
        energy.append(
            MASS_KG * (m.twist[:2, 0] ** 2).sum() + plant._bodies.whole.inertia[0] * m.twist[2, 0] ** 2 + hubs
        )
    assert (np.diff(energy)[np.array(energy[1:]) > 1e-9] < 0).all()
    assert energy[-1] < 0.1 * energy[0]
    assert np.abs(plant.pose()[1]).max() < 1e-9


def test_a_turning_robot_rolls_on_as_lagrange_says() -> None:
    """Wheels do not feel that the robot turns: along its axes (M + W) u' = -m w x u, with W of hubs and rims."""
    plant = planar([quiet(**FREE)])
    m, r, bodies = plant._motion, plant._robots, plant._bodies
    for lost in (r.bearing, r.spin_up, r.cost, r.lift, r.ripple, r.ripple_grows):
        lost[:] = 0.0
    m.twist[:, 0] = start = [1.0, 0.5, 4.0]
    m.speed[:, 0] = m.rims[:, 0] = m.twist[:, 0] @ r.rims[..., 0].T
    mass, inertia = float(bodies.whole.mass[0]), r.rows[..., 0] * build.CYCLE_S
    whole = inertia + bodies.hub[0, 0] * r.rims[..., 0].T @ r.rims[..., 0]

    def rates(t: float, u: NDArray) -> NDArray:
        turned = np.linalg.solve(whole, mass * u[2] * np.array([u[1], -u[0], 0.0]))
        return np.array([*turned, u[2]])

    plant.hold(np.zeros((1, 4)))
    drive(plant, constant([0, 0, 0], 30, 1))
    ahead, aside, rate, turned = solve_ivp(rates, (0, 30 * FRAME_S), [*start, 0.0], rtol=1e-9).y[:, -1]
    x, y, turning = plant.twist()[0]
    # Creep, and steps of a cycle. Were rims mass that keeps its way in the world, it would be 0.022 rad.
    assert np.angle((x + 1j * y) / ((ahead + 1j * aside) * np.exp(1j * turned))) == pytest.approx(0, abs=0.006)
    assert turning == pytest.approx(rate, rel=0.005)


def test_a_push_on_ice_gives_its_momentum_and_a_slope_g_sin() -> None:
    ice: dict[str, Any] = {"carpet": {"friction": 0.01, "pile": 0.0}, "drive": NOTHING}
    push = {"kind": "push", "at": 0.0, "force_n": 20.0, "direction_deg": 30.0}
    tilts = [{"kind": "tilt", "at": 0.0, "angle_deg": a, "direction_deg": 90.0} for a in (4.0, 8.0)]
    plant = planar([quiet(fault=[each], **ice) for each in (push, *tilts)])
    drive(plant, constant([0, 0, 0], 9, 3))
    gained = plant.twist()[:, :2] / (9 * FRAME_S)
    rims = plant._bodies.rim * (plant._robots.rims[:, :2, 0] ** 2).sum(0)
    towards = 20.0 * np.array([math.cos(math.pi / 6), 0.5])
    # Ice holds up to 1 % of the weight, 1.3 % of the push.
    np.testing.assert_allclose(gained[0] * (MASS_KG + rims), towards, atol=0.015 * 20.0)
    steep = GRAVITY * np.diff(np.sin(np.radians([4.0, 8.0])))[0] * MASS_KG / (MASS_KG + rims[1])
    assert gained[2, 1] - gained[1, 1] == pytest.approx(steep, rel=0.01)  # what ice holds falls out


def test_a_payload_is_a_point_mass_on_the_chassis_and_leaves_nothing_behind() -> None:
    load = {"kind": "payload", "at": 0.0, "for": 0.1, "mass_kg": 0.8, "height_m": 0.12}
    plant = planar([quiet(fault=[load]), quiet()])
    drive(plant, constant([0, 0, 0], 3, 2))
    (mass, _), (centre, _), (inertia, _) = (np.array(values) for values in plant._bodies.whole)
    chassis, alone = plant._bodies.chassis.centre[1], plant._bodies._empty
    assert mass == pytest.approx(MASS_KG + 0.8)
    at = np.array([*chassis[:2], 0.12])
    np.testing.assert_allclose(mass * centre, MASS_KG * alone.centre[1] + 0.8 * at)
    # About the origin moments of inertia are sums.
    about = inertia + mass * (centre[:2] ** 2).sum()
    expected = alone.inertia[1] + MASS_KG * (alone.centre[1, :2] ** 2).sum() + 0.8 * (at[:2] ** 2).sum()
    assert about == pytest.approx(expected)
    drive(plant, constant([0, 0, 0], 5, 2))
    np.testing.assert_allclose(*plant._robots.inertia.T)


@pytest.mark.parametrize("kernel", ["numpy", "numba"])
def test_a_rows_bits_do_not_depend_on_the_batch(kernel: str) -> None:
    if kernel == "numba":
        pytest.importorskip("numba")
    worn = {"friction": 0.1, "wear_m": 0.0003, "motor_constant": 0.03, "mass": 0.03, "centre_m": 0.003}
    chosen = with_settings(variation=worn, disturbance={"force_n": 10.0}, physics={"kernel": kernel})
    commands = ramp([[2.0, 1.0, 3.0]], 4.0, 20)
    several = drive(planar([chosen] * 5, seeds=[3, 4, 5, 6, 7]), np.tile(commands, (1, 5, 1)))
    alone = drive(planar([chosen], seeds=[5]), commands)
    np.testing.assert_array_equal(several[:, 2], alone[:, 0])
    assert (several[-1, 0] != several[-1, 1]).all()


def test_both_kernels_give_the_same() -> None:
    """But for rounding, which grows: sliding, turning, pushed, on patches, with loads and motors that are held."""
    pytest.importorskip("numba")
    faults = [{"kind": "payload", "at": 0.1, "mass_kg": 0.5}, {"kind": "tilt", "at": 0.2, "angle_deg": 3.0}]
    common: dict[str, Any] = {
        "carpet": {"patches": [[0.3, 0.0, 0.2, 0.3]], "nap": 0.3}, "disturbance": {"force_n": 5.0}, "fault": faults,
    }  # fmt: skip
    ends = []
    for kernel in ("numpy", "numba"):
        plant = planar([with_settings(physics={"kernel": kernel}, **common)] * 2, seeds=[1, 2])
        path = [drive(plant, ramp(np.array([[2.5, 1.0, 3.0], [-1.0, 2.0, -4.0]]), 6.0, 30))]
        plant.hold(np.array([[1.0, np.nan, -1.0, 0.0]] * 2))
        path.append(drive(plant, constant([0.5, 0, 0], 10, 2)))
        ends.append((np.concatenate(path), plant.telemetry().named()))
    np.testing.assert_allclose(ends[0][0], ends[1][0], atol=1e-7)
    for name, values in ends[0][1].items():
        np.testing.assert_allclose(values, ends[1][1][name], rtol=1e-5, atol=1e-5, err_msg=name)


def test_a_robot_that_would_topple_stops_and_leaves_the_others_alone() -> None:
    push = {"kind": "push", "at": 0.0, "for": 0.2, "force_n": 60.0}
    load = {"kind": "payload", "at": 0.0, "mass_kg": 2.0, "height_m": 0.3}
    plant = planar([quiet(fault=[push, load]), quiet()])
    causes: dict[int, str] = {}
    for _ in range(10):
        causes |= plant.advance(Received.at_once(np.array([[0.0, 0, 0], [0.5, 0, 0]]), plant.pose()[:, 2]))
    assert list(causes) == [0]
    assert causes[0] == "would topple over, which the plant planar does not follow"
    beside = planar([quiet()])
    for _ in range(10):
        beside.advance(Received.at_once(np.array([[0.5, 0, 0]]), beside.pose()[:, 2]))
    np.testing.assert_array_equal(plant.pose()[1], beside.pose()[0])


@pytest.mark.parametrize(
    ("sections", "message"),
    [
        ({"world": {"places": [[0, 0, 0], [1, 0, 0]]}}, r"^the plant planar has one robot in a world"),
        ({"wheels": {"creep": "off"}}, r"^the plant planar needs wheels.creep = on"),
    ],
)
def test_what_it_cannot_do_is_refused(sections: dict[str, Any], message: str) -> None:
    with pytest.raises(OmniError, match=message):
        om.Simulation(om.scenario("rect", plant="planar", **sections), ["comp-flc"])


def test_three_wheels_drive_and_errors_are_those_of_the_full_plant() -> None:
    """As do four, on a short way: within 2 %, which is more than what docs/planar.md has of whole scenarios."""
    found = []
    for plant in ("mujoco", "planar"):
        chosen = om.scenario(
            "rect", plant=plant, wheels={"azimuths_deg": [60, 180, 300], "model": "two-rollers"},
            reference={"waypoints": [[0, 0], [0.3, 0.1]], "settle_s": 0.0},
        )  # fmt: skip
        log = om.Simulation(chosen, ["comp-flc"]).run()
        error = (log.channel("ref") - log.channel("pose"))[..., :2]
        found.append(np.sqrt((error**2).sum(-1).mean()))
    assert found[1] == pytest.approx(found[0], rel=0.02)
