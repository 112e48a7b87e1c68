"""A controller harms nobody but itself: what the others do beside it is what they do alone, to the last bit."""

# ruff: noqa: NPY002

import os
import random
import signal
import sys
import threading
import time
import warnings
from pathlib import Path

import click
import hostile
import numpy as np
import pytest
from simulating import bits

import omni_mj as om
from omni_control import Controller
from omni_control.controllers import guests
from omni_control.errors import ControllerError
from omni_mj.simulate.log import Log
from omni_mj.simulate.simulation import Simulation

SCENARIO = om.scenario(
    "rect-noise", plant="kinematic", seeds=2, reference={"waypoints": [[0, 0], [0.1, 0.1]], "settle_s": 0}
)


def run(*kinds: str | type[Controller]) -> tuple[Log, Simulation]:
    simulation = Simulation(SCENARIO, kinds)
    return simulation.run(), simulation


@pytest.fixture(scope="module")
def alone() -> list[bytes]:
    return bits(run("comp-flc")[0], "comp-flc")


@pytest.mark.parametrize("kind", [*hostile.FAIL, *hostile.GO_ON])
def test_others_do_what_they_do_alone(kind: type[Controller], alone: list[bytes]) -> None:
    """Before it and after it in the table, with references and errors as they were; it fails alone, and is named."""
    program = sys.stdout, sys.stderr, sys.excepthook, os.getcwd(), warnings.filters[:], np.geterr()
    random_numbers = random.getstate(), np.random.get_state(legacy=False)["state"]["key"].tobytes()
    for order in (("comp-flc", kind), (kind, "comp-flc")):
        log, simulation = run(*order)
        assert bits(log, "comp-flc") == alone
        failed = {failure.controller: failure for failure in simulation.failures}
        assert set(failed) == ({kind.__name__} if kind in hostile.FAIL else set())
        assert len(simulation.failures) == 2 * len(failed)
        for failure in failed.values():
            assert (failure.time_s, failure.cause.isprintable()) == (hostile.AT / 60, True)
            assert failure.cause.startswith(kind.__name__)
            assert f"in frame {hostile.AT}" in failure.cause
            assert len(failure.cause) < 700
    assert (sys.stdout, sys.stderr, sys.excepthook, os.getcwd(), warnings.filters[:], np.geterr()) == program
    assert (random.getstate(), np.random.get_state(legacy=False)["state"]["key"].tobytes()) == random_numbers


def test_what_spoils_its_own_reference_is_measured_by_the_true_one() -> None:
    """Who writes where it shall be goes there, and its error is what that is worth."""
    honest = run(hostile.Honest)[0].channel("ref")
    for kind in (hostile.Writes, hostile.Swaps):
        np.testing.assert_array_equal(run(kind)[0].channel("ref"), honest)


def test_nobody_sees_the_truth_who_does_not_say_so_beforehand() -> None:
    log, _ = run(hostile.Cheats, hostile.Honest)
    assert bits(log, "Cheats") == bits(log, "Honest")


def test_dice_are_a_controllers_own(monkeypatch: pytest.MonkeyPatch) -> None:
    """Seeded when it is made, they fall as after that seed, whoever else throws, seeds, or is asked in between."""
    np.random.seed(3)
    random.seed(3)
    own = [[np.random.random(), random.random()] for _ in range(30)]
    for others in ((), ("flc",), (hostile.Seeds,)):
        np.random.seed(9)
        log, _ = run(*others, hostile.Dice)
        np.testing.assert_array_equal(log.channel("own_dice")[:30, log.first("Dice")], own)
    assert np.random.random() == np.random.RandomState(9).random_sample()  # the program's are as it left them


def test_what_it_prints_is_told_apart(capsys: pytest.CaptureFixture[str]) -> None:
    """On stderr, after its name, so that tables on stdout stay tables."""
    run(hostile.Prints)
    assert capsys.readouterr() == ("", "Prints: hello\nPrints: you 3\n")
    guests.Guest("Click", patience_s=5.0).call(lambda: click.echo("by a library"), "ever")
    assert capsys.readouterr() == ("", "Click: by a library\n")


@pytest.mark.parametrize(
    ("body", "says"),
    [
        ("sys.exit(0)", "wanted to end the program when it was made, by SystemExit"),
        ("time.sleep(9)", "did not answer when it was made: it was waited for for 0.2 s"),
        ("object.__setattr__(self.told, 'delay_frames', 0)", "changed what it was told"),
        ("self.memory_frames = 10**9", "has memory_frames = 1000000000"),
        ("self.memory_frames = 'all'", "has memory_frames = 'all'"),
        ("self.channels = None", "has no channels when it was made"),
    ],
)
def test_one_that_cannot_be_made_costs_its_own_rows(tmp_path: Path, body: str, says: str, alone: list[bytes]) -> None:
    """From a file as well as in Python."""
    (tmp_path / "made.py").write_text(
        "import sys, time\nimport omni_mj as om\n\n\nclass Made(om.Controller):\n    patience_s = 0.2\n\n"
        f"    def __init__(self, told, reference, n):\n        super().__init__(told, reference, n)\n        {body}\n"
    )
    log, simulation = run("comp-flc", f"{tmp_path / 'made.py'}:Made")
    assert bits(log, "comp-flc") == alone
    assert {failure.controller for failure in simulation.failures} == {"Made"}
    assert says in simulation.failures[0].cause


def test_the_wait_for_one_ends_whatever_signals_come() -> None:
    """While it is waited for, a signal's handler may take longer than is left until the next look at the time."""
    before = signal.signal(signal.SIGALRM, lambda *_: time.sleep(3 * guests.LOOK_S))
    signal.setitimer(signal.ITIMER_REAL, guests.LOOK_S / 2)
    try:
        with pytest.raises(ControllerError, match="did not answer"):
            guests.Guest("Slow", patience_s=0.2).call(lambda: threading.Event().wait(10), "ever")
    finally:
        signal.signal(signal.SIGALRM, before)
