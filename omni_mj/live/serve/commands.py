"""Commands of the league's simulation protocol as packets of the radio, and what robots hold of them."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from omni_control.kinematics import Array
from omni_mj.link.radio import Received
from omni_mj.live.serve.squad import REMEMBERED_FRAMES
from omni_mj.live.wire.simulation import MoveCommand, RobotCommand, SimulatorError
from omni_mj.scenarios.settings import CYCLE_RATE_HZ, FRAME_RATE_HZ

# A packet: velocities [vx, vy, w], vision's heading and the cycle of its image, whether the velocities are along the
# robot's own axes, then rim speeds, not a number where there are none.
HEADING, IMAGE, BODY, WHEELS = 3, 4, 5, 6
FASTEST = 1e3  # m/s and rad/s: beyond it a number is a mistake

Tell = Callable[[str, str], None]


def nothing(wheels: int) -> list[float]:
    """What a robot holds before the first packet."""
    return [0.0, 0.0, 0.0, np.nan, 0.0, 0.0, *[np.nan] * wheels]


class Refusal(NamedTuple):
    """Why something is not done: a code for programs, words for people."""

    code: str
    text: str

    @property
    def error(self) -> SimulatorError:
        """As it is answered."""
        return SimulatorError(self.code, self.text)


def packet(command: RobotCommand, wheels: int) -> list[float] | Refusal | None:
    """What is sent to a robot of so many wheels; None where it is not told how to move.

    Rim speeds are positive where they turn the robot counter-clockwise. The robot's wheels count from the front left,
    counter-clockwise; the protocol's from the front right, clockwise.
    """
    move = command.move_command or MoveCommand()
    sent = nothing(wheels)
    if move.wheel_velocity is not None:
        if wheels != 4:
            text = f"robot {command.id} has {wheels} wheels; the protocol's rim speeds are of four"
            return Refusal("WHEELS", text)
        rims = move.wheel_velocity
        values: tuple[float, ...] = (rims.front_left, rims.back_left, rims.back_right, rims.front_right)
        sent[WHEELS:] = values
    elif move.local_velocity is not None:
        values = tuple(move.local_velocity)
        sent[:3], sent[BODY] = values, 1.0
    elif move.global_velocity is not None:
        values = tuple(move.global_velocity)
        sent[:3] = values
    else:
        return None
    if not all(abs(value) < FASTEST for value in values):
        text = f"robot {command.id}: velocities must be numbers below {FASTEST:g} m/s and rad/s, not {values}"
        return Refusal("VELOCITY", text)
    return sent


def received(held: Array, new: np.ndarray, compared: int) -> Received:
    """What robots hold.

    Args:
        held: packets, (n, k).
        new: at which robots one arrived now, (n,).
        compared: cycle in which robots compare vision's headings with their own, by its clock.
    """
    age = np.rint((compared - held[:, IMAGE]) / (CYCLE_RATE_HZ // FRAME_RATE_HZ)).astype(int)
    known = new & (age <= REMEMBERED_FRAMES)
    body, wheels = held[:, BODY] > 0, held[:, WHEELS:]
    return Received(
        command=held[:, :3],
        heading=np.where(known, held[:, HEADING], np.nan),
        age=age * known,
        new=new,
        body=body if np.count_nonzero(body) else None,
        wheels=wheels if np.count_nonzero(~np.isnan(wheels)) else None,
    )
