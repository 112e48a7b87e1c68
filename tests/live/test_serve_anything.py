"""Whatever valid message comes, however absurd, is obeyed or refused with a reason, and the world goes on."""

from functools import cache

import numpy as np
from hypothesis import given, settings
from served import FAST, QUIET, pitch_of
from wire_messages import messages

from omni_mj.live.serve import control
from omni_mj.live.serve.pitch import Pitch
from omni_mj.live.wire import decode, encode
from omni_mj.live.wire.simulation import RobotControl, SimulatorCommand, Team
from omni_mj.live.wire.vision import VisionPacket

BODIES = 3


@cache
def shared() -> Pitch:
    """What all messages go to, made when the first does: this file is read by every process."""
    return pitch_of(*QUIET, FAST, blue="2", yellow="1", seed=1)


def goes_on(pitch: Pitch) -> None:
    """For a frame; all that is sent can be sent, and robots are on the field, upright and on their feet."""
    for _ in range(16):
        pitch.step()
        for image in pitch.look():
            packet = VisionPacket(pitch.detection(image, 1e9))
            assert decode(VisionPacket, encode(packet)).detection is not None
    encode(VisionPacket(geometry=pitch.geometry()))
    here = pitch.plant.pose()[pitch.plant.present, :2]
    assert (np.abs(here) < pitch.plant.surface / 2 - pitch.plant.reach[:, None] + 0.01).all()
    assert pitch.plant.driven.sum() == pitch.plant.present.sum()


@settings(deadline=None, max_examples=80, derandomize=True)
@given(messages(SimulatorCommand))
def test_commands_to_the_simulator(command: SimulatorCommand) -> None:
    pitch = shared() if len(shared().names) <= BODIES + 3 else pitch_of(*QUIET, FAST)
    wishes = control.obey(pitch, command)
    assert all(refusal.code and refusal.text for refusal in wishes.refused)
    goes_on(pitch)


@settings(deadline=None, max_examples=80, derandomize=True)
@given(messages(RobotControl))
def test_commands_to_robots(control: RobotControl) -> None:
    pitch = shared()
    refused, commanded = pitch.command(Team.BLUE, control.robot_commands)
    assert all(refusal.code and refusal.text for refusal in refused)
    assert set(commanded) <= set(pitch.numbers(Team.BLUE))
    goes_on(pitch)
