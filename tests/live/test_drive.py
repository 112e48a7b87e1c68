"""The live loop over real sockets, with a peer that integrates commands exactly.

The peer waits for commands (`--lockstep`), so that nothing depends on how busy this computer is.
"""

from pathlib import Path

import numpy as np
import pytest
from benches.drive import (
    UNUSED_ADDRESS,
    connect_peer,
    drive_live,
    live_scenario,
    simulate_in_process,
    summarize,
)
from serve_client import LOOPBACK, udp

from omni_mj.live.latency_fit import fit_latency
from omni_mj.live.sockets import Address, MessageCounter
from omni_mj.live.team_radio import SenderConfig, SimulatorRadio


@pytest.mark.parametrize(
    ("controller", "delay"), [("comp-flc", 0), ("comp-flc", 4), ("inverse-flc", 2)]
)
def test_the_wire_adds_its_delay_and_nothing_else(controller: str, delay: int) -> None:
    """A pulse finds the delay. The errors are those of the in-process loop with the same delay.

    The pulse leaves the robot turned by some mrad from where its route begins, which the heading
    hold takes back at 3 per second; floats in mm are 0.1 um apart, which the fuzzy controller
    magnifies. A controller that learns would learn from that turn, so it is not compared. A
    computer that is busy for a frame holds a command for longer, which is another run; it has three
    chances to have time.
    """
    for _ in range(3):
        with connect_peer("--delay", delay) as options:
            live = drive_live(live_scenario(controller), options)
        if not live.frame_clock.skipped:
            break
    assert live.scenario.settings.radio.delay_frames == delay
    assert (live.frame_clock.skipped, dict(live.messages)) == (0, {"pulse": 1})
    expected = simulate_in_process(live, delay)
    assert live.log.length == expected.log.length
    for channel in ("ref", "pose", "command"):
        ours, theirs = live.log.channel(channel)[:, 0], expected.log.channel(channel)[:, 0]
        allowed = {"ref": 0.0, "pose": [1e-5, 1e-5, 2e-3], "command": [1e-4, 1e-4, 1e-2]}[channel]
        assert (np.abs(ours - theirs) <= allowed).all(), channel


def test_a_fitted_alpha_is_positive() -> None:
    """A robot with reversed signs follows a sine half a period later, and a ramp not at all."""
    for commands in (np.sin(2 * np.pi * np.arange(200) / 20)[:, None], np.ones((200, 1))):
        late = np.concatenate([np.zeros((4, 1)), 0.8 * np.cumsum(commands, axis=0)[:-4] / 60])
        ages_s = np.zeros(200)
        fit = fit_latency(commands, late, ages_s, is_angle=False)
        assert fit == pytest.approx((4.0, 0.8), abs=1.1)
        reversed_fit = fit_latency(commands, -late, ages_s, is_angle=False)
        assert reversed_fit is None or reversed_fit.alpha > 0
    assert reversed_fit is None


@pytest.mark.parametrize("delay", [1.0, 3.5])
def test_latency_is_found_whatever_the_controller(delay: float) -> None:
    """The fit over the run is within 0.1 frames, also for a delay of half a frame."""
    with connect_peer("--delay", delay, "--noise", 0.0003, "--age", 0.01) as options:
        live = drive_live(live_scenario("flc"), options)
    (robot,) = summarize(live)["robots"]
    assert robot["fitted"]["latency_frames"] == pytest.approx(delay, abs=0.1)
    assert robot["fitted"]["alpha"] == pytest.approx(1.0, abs=0.02)
    assert robot["identified"] is None


def test_what_vision_gets_wrong_costs_little() -> None:
    """Two robots; two cameras 1 cm apart, some wrong numbers, reversed headings and bad packets.

    Where this computer is busy between an image and its tick, the image is as much older, and the
    robot is taken to have gone on for so long, which one of a peer that waits has not: by 4 and 14
    cm in two of some 35 runs beside six busy processes. It has three chances to have time.
    """
    wrong = (
        "--cameras",
        2,
        "--bias",
        0.01,
        "--swap",
        0.03,
        "--mirror",
        0.03,
        "--junk",
        0.1,
        "--noise",
        0.0005,
    )
    for _ in range(3):
        with connect_peer(
            "--delay", 2, *wrong, "--start", 0.1, 0.2, 0.3, -0.6, -0.4, 1.2, ids=(0, 1)
        ) as options:
            live = drive_live(live_scenario("comp-flc"), options)
        assert live.messages["bad packet"]
        error = np.abs(live.log.channel("pose") - live.log.channel("ref"))
        if error[..., :2].max() < 0.02:
            break
    assert error[..., :2].max() < 0.02
    assert error[..., 2].max() < 0.1


def test_robots_that_turn_while_they_drive_are_told_right() -> None:
    """By their heading when the command acts: a turn of pi over 0.5 m, with a dead time of 5."""
    turn = {"waypoints": [[0, 0, 0], [0.5, 0, np.pi]], "settle_s": 0.3}
    with connect_peer("--delay", 5) as options:
        live = drive_live(live_scenario("comp-flc", reference=turn), options)
    aside = np.abs(live.log.channel("pose")[:, 0, 1])
    assert aside.max() < 0.003


def test_robots_start_where_they_are() -> None:
    """The route is displaced and turned to begin there."""
    with connect_peer("--start", 1.0, -0.5, 2.0) as options:
        live = drive_live(live_scenario("comp-flc"), options)
    np.testing.assert_allclose(live.log.channel("ref")[0, 0], [1.0, -0.5, 2.0], atol=1e-3)
    assert np.abs(live.log.channel("pose") - live.log.channel("ref")).max() < 0.02


RADIO = """
from omni_mj.live.team_radio import TeamRadio
from serve_client import local, udp


class Mine(TeamRadio):
    def send(self, commands):
        packet = b"".join(local(c.id, c.forward, c.left, c.turn) for c in commands)
        with udp() as socket:
            socket.sendto(packet, self.config.host)
"""


def test_a_radio_of_ones_own(tmp_path: Path) -> None:
    file = tmp_path / "radio.py"
    file.write_text(RADIO)
    with connect_peer(radio=f"{file}:Mine") as options:
        live = drive_live(live_scenario("comp-flc"), options)
    assert np.abs(live.log.channel("pose") - live.log.channel("ref")).max() < 0.02


def test_answers_of_a_simulator_are_counted_and_said_once_in_printable_text() -> None:
    """Whatever bytes they have: an error, one with control characters, one that is not UTF-8."""
    said, errors = list[str](), (b"too fast", b"\x1b[2J", b"\xff")
    with udp() as peer:
        config = SenderConfig(Address(*peer.getsockname()), "blue", LOOPBACK, False)
        radio = SimulatorRadio(config, MessageCounter(said.append))
        radio.send([])
        _, client = peer.recvfrom(100)
        for text in errors * 2:
            peer.sendto(bytes([0x0A, len(text) + 2, 0x12, len(text)]) + text, client)
        radio.send([])
        radio.close()
    assert sorted(radio.messages.values()) == [2, 2, 2]
    assert len(said) == 3
    assert all(text.isprintable() for text in said)


REFUSALS = [
    (
        {"color": "yellow"},
        "does not detect 1 robot for the scenario; yellow robots that it detects: none",
    ),
    ({"ids": (4,)}, "does not detect robots 4; blue robots that it detects: 0"),
    ({"commands": UNUSED_ADDRESS}, "robots 0 were not seen to turn as commanded"),
    ({"radio": "radio.py"}, "--radio must be file.py:Class"),
]


@pytest.mark.parametrize(
    ("options", "reason"), REFUSALS, ids=[next(iter(options)) for options, _ in REFUSALS]
)
def test_what_cannot_be_driven_is_said(options: dict[str, object], reason: str) -> None:
    with (
        connect_peer("--patience", 0.01, **options) as there,
        pytest.raises(ValueError, match=reason),
    ):
        drive_live(live_scenario("flc"), there)
