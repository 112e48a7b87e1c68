"""A controller from a file has a process of its own, which it can spoil as it likes: others' numbers stay the same."""

import inspect
import random
from pathlib import Path

import hostile
import hostile_process
import numpy as np
import pytest
from simulating import bits

import omni_mj as om
from omni_mj.simulate.simulation import Simulation
from omni_mj.studies.outcome import drive

SCENARIO = om.scenario(
    "rect-noise", plant="kinematic", reference={"waypoints": [[0, 0], [0.1, 0.1]], "settle_s": 0}, seeds=2
)


def file(kind: type) -> str:
    """How it is named by the file that it is in."""
    return f"{inspect.getfile(kind)}:{kind.__name__}"


@pytest.fixture(scope="module")
def together() -> Simulation:
    """All of them in one run, between two that do what they shall."""
    kinds = [*hostile_process.FAIL, *hostile_process.GO_ON]
    simulation = Simulation(SCENARIO, ["comp-flc", *map(file, kinds), hostile.Honest])
    drive(simulation)
    return simulation


def test_others_do_what_they_do_alone(together: Simulation) -> None:
    alone = Simulation(SCENARIO, ["comp-flc", hostile.Honest]).run()
    for name in ("comp-flc", "Honest"):
        assert bits(together.log, name) == bits(alone, name)


def test_each_that_fails_is_named_with_the_reason(together: Simulation) -> None:
    """In the frame in which it does, with what was recorded until then."""
    causes = {failure.controller: failure for failure in together.failures}
    assert set(causes) == {kind.__name__ for kind in hostile_process.FAIL}
    for kind, says in hostile_process.FAIL.items():
        assert causes[kind.__name__].cause.startswith(f"{kind.__name__} {says}")
        assert causes[kind.__name__].time_s == hostile.AT / 60
        assert (together.log.lengths[together.log.of(kind.__name__)] == hostile.AT).all()


def test_a_process_gives_the_numbers_that_a_thread_gives(together: Simulation) -> None:
    """The same class, asked in this process, up to the last bit; so do those that do harm to nobody."""
    honest = bits(together.log, "Honest")
    for kind in hostile_process.GO_ON:
        assert bits(together.log, kind.__name__) == honest


def test_what_one_has_started_ends_with_it(together: Simulation) -> None:
    pids = together.log.channel("own_pid")[-1, together.log.of("Starts"), 0]
    assert len(pids) == np.isfinite(pids).sum() == 2
    for pid in pids.astype(int):
        status = Path(f"/proc/{pid}/stat")
        assert not status.exists() or status.read_text().rpartition(")")[2].split()[0] == "Z"


def test_what_it_prints_is_told_apart(capfd: pytest.CaptureFixture[str]) -> None:
    """On stderr, after its name, so that tables on stdout stay tables."""
    Simulation(SCENARIO, [file(hostile.Prints)]).run()
    assert capfd.readouterr() == ("", "Prints: hello\nPrints: you 3\n")


def test_its_dice_fall_as_in_a_thread() -> None:
    """Seeded by its name, or by itself; those of the program are as they were."""
    before = random.getstate()
    thrown = [Simulation(SCENARIO, [kind]).run().channel("own_dice") for kind in (hostile.Dice, file(hostile.Dice))]
    np.testing.assert_array_equal(*thrown)
    assert random.getstate() == before
