"""Real robots hold what they were told: a controller that does not answer must not leave them driving."""

import threading
import time
from pathlib import Path

import numpy as np
import pytest
from live_peer import driven, on_wire, peer

from omni_control import Controller
from omni_mj.live import drive

AHEAD = np.array([[0.4, 0.0, 0.0]])
FROM = 20  # the frame from which on it hangs, once: in frames that go by while this computer is busy it is not asked


class Hangs(Controller):
    """Drives ahead, and once does not answer until the robot stands, or at all."""

    truth: Path | None = None  # where the robot writes its poses down; without it, nothing is waited for
    for_s = 0.0
    _hung: int | None = None

    def command(self, frame, seen):
        if frame >= FROM and self._hung is None:
            self._hung = frame
            while self.truth is not None and not stands(self.truth):
                time.sleep(0.01)
            threading.Event().wait(self.for_s)
        return AHEAD if frame < 2 * FROM else 0 * AHEAD


class Endless(Controller):
    """Never comes out of compiled code, which lets nothing else in its process run."""

    def command(self, frame, seen):
        return sum(range(10**15)) if frame >= FROM else AHEAD


def stands(truth: Path) -> bool:
    poses = [line.split()[1:] for line in truth.read_text().splitlines()[-4:-1]]
    return len(poses) == 3 and poses[0] == poses[1] == poses[2]


def test_robots_stand_until_the_controller_answers(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Nothing but the loop can make the robot stand, which the controller waits for; then it goes on."""
    monkeypatch.setattr(drive, "HUNG_S", 30.0)
    monkeypatch.setattr(Hangs, "truth", tmp_path / "truth")
    with peer("--patience", 1 / 60, "--truth", tmp_path / "truth") as options:
        live = driven(on_wire(Hangs), options)
    assert live.notes.counts["hung"] > 0
    assert not live.failures
    assert live.log.length > 2 * FROM


@pytest.mark.parametrize("controller", [Hangs, f"{__file__}:Endless"])
def test_a_controller_that_hangs_for_long_is_given_up(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, controller: str | type[Controller]
) -> None:
    """Long before its own patience is over: its robots stand, and the run ends with the reason."""
    monkeypatch.setattr(Hangs, "for_s", 20.0)
    with peer("--patience", 1 / 60, "--truth", tmp_path / "truth") as options:
        live = driven(on_wire(controller), options)
        until = time.monotonic() + 20
        while not stands(tmp_path / "truth"):
            assert time.monotonic() < until
    (failure,) = live.failures
    assert ": robots wait 0.5 s at most" in failure.cause


def test_a_simulation_that_waits_gives_a_controller_time(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its time stands still: nothing is sent meanwhile, and nothing is given up."""
    monkeypatch.setattr(Hangs, "for_s", 1.0)
    with peer() as options:
        live = driven(on_wire(Hangs), options)
    assert "hung" not in live.notes.counts
    assert not live.failures
    assert (live.log.channel("command")[FROM, 0] != 0).any()
