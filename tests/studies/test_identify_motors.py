"""What currents, voltages and roll-outs of our plant tell of motors, mass and drag, by the closed forms of its law."""

from dataclasses import replace
from pathlib import Path

import compiled
import numpy as np
import pyarrow.parquet as pq
import pytest

from omni_mj.scenarios.scenario import scenario
from omni_mj.studies.identify import motion, windings
from omni_mj.studies.identify.findings import Estimate
from omni_mj.studies.identify.logs import Log, read
from omni_mj.studies.identify.motors import by_motors
from omni_mj.studies.slip.law import expected
from omni_mj.studies.slip.moves import Move, longest
from omni_mj.studies.slip.record import drive

CHOSEN = scenario("rect", robot="tigers-v2020", wheels={"model": "two-rollers"}, physics=compiled.NUMBA)
MOVES = [
    Move(kind, sign * speed, 2.0, 0.3, True)
    for kind in ("forward", "sideways")
    for speed in (1.0, 1.5)
    for sign in (1, -1)
]


@pytest.fixture(scope="module")
def logs(tmp_path_factory: pytest.TempPathFactory) -> list[Log]:
    """Eight moves, each a log of its own: speed up, hold, and motors off."""
    compiled.once("mujoco")
    frames = longest(MOVES)
    commands = np.stack([move.commands(frames) for move in MOVES], 1)
    held = np.stack([np.where(move.free(frames), 0.0, np.nan) for move in MOVES], 1)
    path: Path = tmp_path_factory.mktemp("logs") / "log.parquet"
    pq.write_table(drive(CHOSEN, commands, held).simulation.log.table(), path)
    return read(path)


@pytest.fixture(scope="module")
def told(logs: list[Log]) -> dict[str, Estimate]:
    assert len(logs) == len(MOVES)
    rolled = motion.by_wheels(logs, CHOSEN.settings)
    estimates, odd = by_motors(logs, CHOSEN.settings, rolled)
    assert not odd
    return {e.name: e for e in estimates}


def test_roll_outs_tell_the_drag_of_all(told: dict[str, Estimate]) -> None:
    """The closed form's deceleration, within 10 %: it leaves out 0.1 to 0.2 of 2.6 N."""
    for axis, name in enumerate(("forward", "sideways")):
        found = told[f"roll_out_{name}_m_s2"]
        assert found.told
        assert found.value == pytest.approx(expected(CHOSEN.settings).deceleration[axis], rel=0.1)


def test_currents_and_voltages_tell_motors_and_mass(told: dict[str, Estimate]) -> None:
    """Windings are 5 % warmer at the most; of mass the closed form leaves out what rollers do."""
    motor = CHOSEN.settings.motor
    assert told["constant_nm_a"].value == pytest.approx(motor.constant_nm_a, rel=0.02)
    assert told["resistance_ohm"].value == pytest.approx(motor.resistance_ohm, rel=0.05)
    assert told["mass_kg"].value == pytest.approx(CHOSEN.settings.body.mass_kg, rel=0.1)


@pytest.mark.parametrize(("begins", "says"), [(0.0, "is 0.0"), (1.0, "changes over the log by -0.0")])
def test_a_motor_that_is_not_as_the_others_is_named(logs: list[Log], begins: float, says: str) -> None:
    """One that has lost 0.3 of its constant k gives k G w less, of the same current; or loses it from start to end."""
    spoilt, gear = list[Log](), CHOSEN.settings.motor.gear
    for log in logs:
        assert log.motors is not None
        assert log.motors.voltage is not None
        assert log.wheels is not None
        speed = np.concatenate([log.wheels[:1], log.wheels[:-1]])[:, 1]  # mean since the line before
        lost = 0.3 * np.linspace(1.0 - begins, 1.0 + begins, len(log.time))
        voltage = log.motors.voltage.copy()
        voltage[:, 1] -= lost * CHOSEN.settings.motor.constant_nm_a * gear * speed
        spoilt.append(replace(log, motors=replace(log.motors, voltage=voltage)))
    assert not list(windings.odd(windings.windings(logs, CHOSEN.settings)))
    lines = list(windings.odd(windings.windings(spoilt, CHOSEN.settings)))
    assert all(line.startswith("motor 2: its torque constant") for line in lines)
    assert any(says in line for line in lines)
