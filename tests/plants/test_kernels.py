"""The two kernels: loops over robots that numba compiles reckon by the laws that numpy does."""

import sys
from typing import Any

import numpy as np
import pytest
from driving import drive, mujoco, with_settings
from hypothesis import given
from hypothesis import strategies as st
from laws import LAW
from omni_mj.onboard import by_frame, by_robot, kernel
from omni_mj.onboard.battery import Battery
from omni_mj.onboard.firmware import Firmware
from omni_mj.onboard.motors import Motors
from omni_mj.onboard.traction import Traction

from omni_control.errors import OmniError
from omni_control.kinematics import Kinematics
from omni_mj.link.radio import Received
from omni_mj.plants import Telemetry, between
from omni_mj.scenarios import scenario
from omni_mj.scenarios.settings import Settings
from omni_mj.simulate.simulation import Simulation

KINEMATICS = Kinematics(np.radians([60, 135, 225, 300]), 0.083, 0.0285)
CYCLE_S, PERIOD_S = 1 / 960, 1 / 60
# Either kernel rounds each operation to 1.1e-16 of it. Some hundred of them, with differences of numbers 10 times as
# large as what is left, come to 1e-13.
ROUNDING = 1e-12
OTHER = with_settings(
    firmware={"ki": 3.0, "kd": 2e-3, "rate_hz": 320, "derate": True, "timeout_s": 4 * CYCLE_S, "current_limit_a": 3.0},
    carpet={"nap": 0.4, "nap_deg": 70.0, "patches": [[0.2, 0.1, 0.15, 0.3]]},
    battery={"charge": 0.06},
    motor={"winding_c": 120.0},
)


class Robots:
    """What is on robots with the default settings and with others in turn."""

    def __init__(self, n: int) -> None:
        settings = [(Settings(), OTHER)[i % 2] for i in range(n)]
        limits = np.array([[s.firmware.current_limit_a] for s in settings])
        self.firmware = Firmware(settings, KINEMATICS, np.linspace(-3, 3, n), CYCLE_S, PERIOD_S)
        self.motors = Motors([s.motor for s in settings], 4, PERIOD_S, limits)
        self.battery = Battery([s.battery for s in settings])
        self.traction = Traction(settings, KINEMATICS, np.array([0.003, -0.001, 0.04]), np.full(4, 8e4), CYCLE_S)


def numbers(n: int, seed: int) -> dict[str, np.ndarray]:
    """What n robots meet in 8 cycles."""
    rng = np.random.default_rng(seed)
    return {
        "command": rng.normal(0, 2, (n, 3)),
        "rims": np.where(rng.random((n, 4)) < 0.2, rng.normal(0, 2, (n, 4)), np.nan),
        "body": rng.random(n) < 0.3,
        "gyro": rng.normal(0, 5, (8, n)),
        "angle": rng.normal(0, 0.1, (8, n, 4)).cumsum(0),
        "speed": rng.normal(0, 40, (8, n, 4)),
        "load": np.maximum(rng.normal(4, 4, (8, n, 4)), 0),
        "position": rng.uniform(-0.3, 0.5, (n, 3)),
        "velocity": rng.normal(0, 2, (n, 6)),
    }


@LAW
@given(n=st.integers(1, 5), seed=st.integers(0, 10_000))
def test_robot_by_robot_is_as_all_at_once(n: int, seed: int) -> None:
    """The loops as plain Python against the classes, after each of two frames of 8 cycles."""
    one, other, met = Robots(n), Robots(n), numbers(n, seed)
    heading = np.linspace(-2, 2, n)
    quaternion = np.column_stack([np.cos(heading / 2), np.zeros((n, 2)), np.sin(heading / 2)])
    received = Received(met["command"], heading, np.zeros(n, int), np.arange(n) % 2 == 0, met["body"], met["rims"])
    for _ in range(2):
        volts, amperes = np.zeros((2, 2, 8, n, 4))
        one.firmware.receive(received, one.motors.winding)
        f, m, b, t = (each.arrays() for each in (other.firmware, other.motors, other.battery, other.traction))
        heat, charge, estimate = other.motors.heat_arrays(), other.battery.charge_arrays(), other.firmware.estimate
        other.firmware.listen(received.heading, received.age)
        by_frame.correct((0, n), f, heat, estimate.past, estimate.frame)
        other.firmware.note(received)
        by_frame.obey((0, n), f, other.firmware.cycle)
        estimate.frame += 1
        supplies = np.zeros((8, n))
        for k in range(8):
            supplies[k] = one.battery.voltage
            duty = one.firmware.duties(met["gyro"][k], met["angle"][k])
            wanted = duty * one.battery.voltage[:, None]
            volts[0, k], amperes[0, k] = one.motors.drive(wanted, met["speed"][k])
            one.traction.travel(met["position"], quaternion, met["velocity"], met["load"][k], met["angle"][k])
            one.traction.press(met["load"][k])
            one.battery.load(volts[0, k], amperes[0, k])
            speed, load, facing = met["speed"][k].T, met["load"][k].T, np.stack([np.cos(heading), np.sin(heading)])
            body = (met["velocity"][:, 0] + 1j * met["velocity"][:, 1]) * np.exp(-1j * heading)
            twist = np.stack([body.real, body.imag, met["velocity"][:, 5]])
            for part in [(i, i + 1) for i in range(n)] if k % 2 else [(0, n)]:  # together, or one after the other
                by_robot.control(part, other.firmware.cycle, f, met["gyro"][k], met["angle"][k].T)
                by_robot.supply(part, f, m, b, np.zeros((0, n)), speed, volts[1, k].T)
                by_robot.drive(part, m, speed, volts[1, k].T, amperes[1, k].T)
                by_robot.travel(part, t, met["position"].T, facing, twist, load, met["angle"][k].T)
                by_robot.press(part, t.rims, load)
                by_robot.load(part, b, volts[1, k].T, amperes[1, k].T, np.zeros(n))
            other.firmware.cycle += 1
            np.testing.assert_allclose(f.held.T, duty, rtol=0, atol=ROUNDING)
        one.motors.warm(amperes[0], met["speed"])
        one.battery.discharge(PERIOD_S)
        by_robot.warm((0, n), m, heat, amperes[1].swapaxes(1, 2), met["speed"].swapaxes(1, 2), np.zeros((2, n)))
        by_robot.discharge((0, n), b, charge, PERIOD_S)
        wheels, out = (met["angle"][-1], met["speed"][-1], np.abs(met["speed"][0])), Telemetry.empty(n, 4)
        recorded = amperes[1].swapaxes(1, 2), supplies
        by_frame.tell((0, n), out.columns, (*(w.T for w in wheels),), (volts[1].swapaxes(1, 2), *recorded), heat, b)
        told = Telemetry.of_wheels(*wheels, (volts[0], amperes[0], supplies), one.motors, one.battery)
        for name, values in told.named().items():
            np.testing.assert_allclose(getattr(out, name), values, rtol=ROUNDING, atol=ROUNDING, err_msg=name)
    for numpys, loops in (
        (one.firmware.estimate.heading, other.firmware.estimate.heading),
        (one.firmware.estimate.bias, other.firmware.estimate.bias),
        (one.firmware.arrays().swing, other.firmware.arrays().swing),
        (volts[0], volts[1]),
        (amperes[0], amperes[1]),
        (one.traction.wrench, other.traction.wrench),
        (one.traction.block, other.traction.block),
        (one.battery.block, other.battery.block),
        (one.battery.charge, other.battery.charge),
        (one.motors.block, other.motors.block),
        (one.motors.winding, other.motors.winding),
        (one.motors.housing, other.motors.housing),
        (one.motors.limited, other.motors.limited),
    ):
        np.testing.assert_allclose(loops, numpys, rtol=ROUNDING, atol=ROUNDING)


@pytest.mark.parametrize(("wheels", "controller"), [("rollers", "comp-flc"), ("two-rollers", "adaptive-comp-flc")])
def test_the_kernels_drive_the_same_run(wheels: str, controller: str) -> None:
    """A loop with a controller, one of them of compiled loops too, full wheels and two rollers, two robots of a world.

    Rounding moves rollers in contact by 1e-13 m in two seconds. Where it moves an encoder's count into the next cycle,
    a wheel misses 0.3 rad/s for 1 ms, and the robot 1e-6 m: allowed, 10 times.
    """
    more = [
        f"wheels.model={wheels}",
        "reference.waypoints=[[0, 0], [0.3, 0.2]]",
        "reference.settle_s=0.1",
        "world.places=[[0, 0], [0, 1]]",
    ]
    logs = []
    for name in ("numpy", "numba"):
        chosen = scenario.load("rect", [*more, f"physics.kernel={name}"], {"seeds": 1, "controllers": (controller,)})
        logs.append(Simulation(chosen).run())
    numpys, loops = (log.channel("pose") for log in logs)
    np.testing.assert_allclose(loops, numpys, rtol=0, atol=1e-5)
    np.testing.assert_allclose(*(log.channel("winding") for log in logs), rtol=1e-6)
    np.testing.assert_allclose(*(log.channel("battery") for log in logs), rtol=1e-3)


@pytest.mark.parametrize("changes", [{}, {"wheels": {"model": "two-rollers"}, "physics": {"substeps": 2}}])
def test_the_loops_between_steps_do_compiled_what_they_do_as_python(changes: dict[str, dict[str, Any]]) -> None:
    """Two frames, in which no rounding reaches an encoder's count: then it grows by contacts alone."""
    seen = []
    for python in (True, False):
        physics = {"kernel": "numba", **changes.get("physics", {})}
        plant = mujoco([with_settings(**{**changes, "physics": physics})])
        loops = plant.between
        assert isinstance(loops, between.Between)
        if python:
            loops._burst, loops._end = between.burst, between.end
        poses = drive(plant, np.full((2, 1, 3), 0.5))
        seen.append([poses, plant.currents.copy(), plant._motors.winding, plant._battery.charge])
    for one, other in zip(*seen, strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-9, atol=1e-9)


def test_neither_threads_nor_the_batch_change_a_bit_of_the_compiled_loops() -> None:
    settings, seeds = with_settings(disturbance={"force_n": 10.0}, physics={"kernel": "numba"}), [3, 1, 4]
    start = np.array([[0, 0, 0.3], [1, 0, -2], [0, 2, 1.0]])
    commands = np.random.default_rng(1).normal(scale=1.5, size=(8, 3, 3))
    serial = drive(mujoco([settings] * 3, start, seeds, threads=1), commands)
    np.testing.assert_array_equal(drive(mujoco([settings] * 3, start, seeds, threads=3), commands), serial)
    for row in range(3):
        alone = drive(mujoco([settings], start[[row]], [seeds[row]]), commands[:, [row]])
        np.testing.assert_array_equal(alone, serial[:, [row]])


def test_currents_that_drivers_hold_are_held_by_both() -> None:
    """Of one wheel; the others are the firmware's."""
    held, seen = np.array([[1.5, np.nan, np.nan, np.nan]]), []
    for name in ("numpy", "numba"):
        plant = mujoco([with_settings(physics={"kernel": name})])
        plant.hold(held)
        drive(plant, np.zeros((3, 1, 3)))
        seen.append(plant.currents.copy())
    np.testing.assert_allclose(seen[1], seen[0], rtol=0, atol=1e-6)
    np.testing.assert_allclose(seen[1][..., 0], 1.5, rtol=1e-9)


def test_without_numba_its_kernel_is_refused_in_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "numba", None)
    kernel.check("numpy")
    settings = with_settings(physics={"kernel": "numba"})
    with pytest.raises(OmniError, match=r"physics.kernel = numba needs .* pip install 'omni-mj\[fast\]'") as error:
        mujoco([settings])
    assert "\n" not in str(error.value)
