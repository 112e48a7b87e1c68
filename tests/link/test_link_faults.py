"""What happens between robot and team: packets that take longer from some frame on, a camera that is blind."""

from typing import Any

import compiled
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

import omni_mj as om
from omni_mj.link.camera import Camera
from omni_mj.link.radio import Radio
from omni_mj.scenarios.faults import Delay, Fault, VisionOut
from omni_mj.scenarios.settings import RadioSettings, VisionSettings
from omni_mj.simulate.simulation import Simulation

FRAME_S = 1 / 60


def delay(start: int, frames: int, to: int) -> Delay:
    return Delay(at=start * FRAME_S, to=to, **{"for": frames * FRAME_S})


delays = st.lists(st.builds(delay, st.integers(0, 40), st.integers(0, 40), st.integers(0, 15)), max_size=3)


def dead_time(usual: int, faults: list[Delay], frame: int) -> int:
    """Of a packet sent in a frame: that of the last fault that goes on, if any does."""
    for fault in reversed(faults):
        start, lasts = round(fault.at / FRAME_S), round(fault.for_ / FRAME_S) or np.inf
        if start <= frame < start + lasts:
            return fault.to
    return usual


def exchanged(radio: Radio, commands: NDArray, headings: NDArray) -> tuple[NDArray, NDArray, NDArray]:
    received = [radio.exchange(*packet) for packet in zip(commands, headings, strict=True)]
    command, heading, age = zip(*((r.command, r.heading, r.age) for r in received), strict=True)
    return np.array(command), np.array(heading), np.array(age)


@settings(deadline=None, max_examples=15, derandomize=True)
@given(st.lists(st.tuples(st.integers(0, 12), delays), min_size=1, max_size=3))
def test_packets_take_the_dead_time_of_the_frame_in_which_they_are_sent(robots: list[tuple[int, list[Delay]]]) -> None:
    """Against a list of arrivals: a robot holds the newest of the packets that have arrived."""
    frames, n = 90, len(robots)
    rng = np.random.default_rng(0)
    commands, headings = rng.normal(size=(frames, n, 3)), rng.normal(size=(frames, n))
    radio = Radio(
        [RadioSettings(delay_frames=usual) for usual, _ in robots], [(0,)] * n, [faults for _, faults in robots]
    )
    command, heading, age = exchanged(radio, commands, headings)
    for robot, (usual, faults) in enumerate(robots):
        arrivals = [(sent + dead_time(usual, faults, sent), sent) for sent in range(frames)]
        before = None
        for frame in range(frames):
            held = max((sent for arrival, sent in arrivals if arrival <= frame), default=None)
            expected = np.zeros(3) if held is None else commands[held, robot]
            np.testing.assert_array_equal(command[frame, robot], expected)
            fresh = np.nan if held is None or held == before else headings[held, robot]
            np.testing.assert_array_equal(heading[frame, robot], fresh)
            assert held is None or age[frame, robot] == frame - held
            before = held


def test_jitter_is_about_the_dead_time_of_the_moment() -> None:
    """Two frames either way, as before; the same packets are late."""
    frames, jitter = 600, 2
    usual, longer = RadioSettings(delay_frames=4, jitter_frames=jitter), [[], [delay(0, 0, 11)]]
    radio = Radio([usual] * 2, [(5,)] * 2, longer)
    numbers = np.broadcast_to(np.arange(frames, dtype=float)[:, None, None], (frames, 2, 3))
    _, _, age = exchanged(radio, numbers, numbers[..., 0])
    np.testing.assert_array_equal(age[40:, 1] - age[33:-7, 0], 7)
    assert set(age[40:, 0]) == {2, 3, 4, 5, 6}


@pytest.mark.parametrize("plant", ["kinematic", "mujoco"])
def test_a_longer_dead_time_is_that_of_a_radio_of_which_the_team_believes_the_old_one(plant: str) -> None:
    """To the last bit, also of the heading that the firmware compares with what it held for its own as long ago."""
    if plant == "mujoco":
        compiled.once(plant)
    chosen = om.scenario(
        "rect",
        plant=plant,
        controllers=["comp-flc"],
        reference={"waypoints": [[0, 0, 0], [0.2, 0, 1.0]], "settle_s": 0.2},
        wheels={"model": "two-rollers"},
        physics=compiled.NUMBA,
    )
    told = chosen.settings.replace(radio={"delay_frames": 9}, control={"delay_error_frames": -3})
    met = chosen.settings.replace(fault=[{"kind": "delay", "at": 0, "to": 9}])
    one, other = (Simulation(chosen.replace(settings=own)).run() for own in (told, met))
    for name in one.columns:
        np.testing.assert_array_equal(one.channel(name), other.channel(name), err_msg=name)
    assert (one.channel("command") != 0).any()


def out(start: int, frames: int) -> VisionOut:
    return VisionOut(at=start * FRAME_S, **{"for": frames * FRAME_S})


def seen(faults: list[list[Fault]], frames: int = 60, **vision: Any) -> tuple[NDArray, NDArray]:
    camera = Camera([VisionSettings(**vision)] * len(faults), [(1,)] * len(faults), faults)
    poses, valid = zip(*(camera(np.zeros((len(faults), 3))) for _ in range(frames)), strict=True)
    return np.array(poses), np.array(valid)


def test_a_camera_that_is_out_sees_nothing_then_and_all_else_as_before() -> None:
    """Of two that overlap, while either goes on; misses and noise of other frames are those of a robot in sight."""
    spans: list[list[Fault]] = [[], [out(10, 5)], [out(40, 0)], [out(0, 3), out(20, 10), out(25, 10)]]
    poses, valid = seen(spans, miss_probability=0.1, miss_frames=2)
    hidden = np.zeros((60, 4), bool)
    hidden[10:15, 1], hidden[40:, 2], hidden[:3, 3], hidden[20:35, 3] = True, True, True, True
    np.testing.assert_array_equal(valid, valid[:, :1] & ~hidden)
    assert 0 < (~valid[:, 0]).sum() < 30
    assert np.isnan(poses[~valid]).all()
    np.testing.assert_array_equal(poses[valid], np.broadcast_to(poses[:, :1], poses.shape)[valid])
