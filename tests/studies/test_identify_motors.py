"""What currents, voltages and roll-outs of our plant tell of motors, mass and drag, by the closed forms of its law."""

from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

from omni_mj.scenarios.scenario import scenario
from omni_mj.studies.identify import motion
from omni_mj.studies.identify.findings import Estimate
from omni_mj.studies.identify.logs import read
from omni_mj.studies.identify.motors import by_motors
from omni_mj.studies.slip.law import expected
from omni_mj.studies.slip.moves import Move, longest
from omni_mj.studies.slip.record import drive

CHOSEN = scenario("rect", robot="tigers-v2020", wheels={"model": "two-rollers"})
MOVES = [
    Move(kind, sign * speed, 2.0, 0.3, True)
    for kind in ("forward", "sideways")
    for speed in (1.0, 1.5)
    for sign in (1, -1)
]


@pytest.fixture(scope="module")
def told(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Estimate]:
    """Of eight moves, each a log of its own: speed up, hold, and motors off."""
    frames = longest(MOVES)
    commands = np.stack([move.commands(frames) for move in MOVES], 1)
    held = np.stack([np.where(move.free(frames), 0.0, np.nan) for move in MOVES], 1)
    path: Path = tmp_path_factory.mktemp("logs") / "log.parquet"
    pq.write_table(drive(CHOSEN, commands, held).simulation.log.table(), path)
    logs = read(path)
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
