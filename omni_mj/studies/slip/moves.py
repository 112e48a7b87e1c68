"""The moves with which TIGERs Mannheim identify a robot (`IdentifyBotModelRole.java` of Sumatra), frame by frame.

There and back between two ends 3 m apart, each way on its own: speed up at 2 m/s^2, hold, and either brake and stop or,
half a second's way before the end, let the motors go and roll out; forward and sideways. On the spot: speed up at
12 rad/s^2, hold for 3 s, roll out.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from omni_control.kinematics import Array
from omni_mj.scenarios.settings import PERIOD_S
from omni_mj.studies.slip.law import AXES

SPEEDS_M_S, ACCELERATION_M_S2, WAY_M, ROLL_OUT_S = (0.5, 1.0, 1.25, 1.5), 2.0, 3.0, 0.5
TURN_RATES_RAD_S, TURN_ACCELERATION_RAD_S2, HELD_S = (4.0, 6.0, 8.0, 10.0), 12.0, 3.0
REST_S = 0.1  # at the start
AFTER_S = 0.25  # to come to rest after braking; a roll-out is given as long as ROLLING allows
ROLLING = 1.5  # s at the most


@dataclass(frozen=True)
class Move:
    """One move from rest.

    Attributes:
        kind: forward, sideways or turning.
        speed: that is held, m/s or rad/s; negative for the way back.
        acceleration: magnitude, m/s^2 or rad/s^2.
        held_s: how long the speed is held.
        rolls_out: whether the motors are let go then, instead of braking.
    """

    kind: str
    speed: float
    acceleration: float
    held_s: float
    rolls_out: bool

    @property
    def times(self) -> tuple[float, float, float]:
        """At which the speed is reached, no longer held, and zero again if the robot brakes, s."""
        ramp = abs(self.speed) / self.acceleration
        reached = REST_S + ramp
        return reached, reached + self.held_s, reached + self.held_s + ramp

    @property
    def frames(self) -> int:
        """Of the whole move."""
        _, let_go, stopped = self.times
        return int(np.ceil((let_go + ROLLING if self.rolls_out else stopped + AFTER_S) / PERIOD_S))

    @property
    def direction(self) -> Array:
        """Body twist (3,) of the speed 1."""
        direction: Array = np.eye(3)[AXES[self.kind]]
        return direction

    def commands(self, frames: int) -> Array:
        """Return twists (frames, 3): in each frame what is wanted at its end."""
        share = np.interp(PERIOD_S * np.arange(1, frames + 1), [REST_S, *self.times], [0.0, 1.0, 1.0, 0.0])
        share[self.free(frames)] = 0.0
        return self.speed * share[:, None] * self.direction

    def free(self, frames: int) -> np.ndarray:
        """Return in which frames (frames,) the motors are let go."""
        return self.rolls_out & _within(frames, self.times[1], np.inf)

    def accelerating(self, frames: int) -> np.ndarray:
        """Return in which frames (frames,) speed is to be gained, from start to end."""
        return _within(frames, REST_S, self.times[0])

    def holding(self, frames: int) -> np.ndarray:
        """Return in which frames (frames,) the speed is to be held."""
        return _within(frames, *self.times[:2])


def straight(kind: str, speed: float, rolls_out: bool, acceleration: float = ACCELERATION_M_S2) -> Move:
    """A move over the whole way, or to where a robot is let go."""
    way = WAY_M - (ROLL_OUT_S if rolls_out else abs(speed) / acceleration / 2) * abs(speed)
    return Move(kind, speed, acceleration, way / abs(speed) - abs(speed) / acceleration / 2, rolls_out)


def identification() -> list[Move]:
    """All moves of one robot."""
    moves = [
        straight(kind, sign * speed, rolls_out)
        for kind, rolls_out in (("forward", True), ("forward", False), ("sideways", False))
        for speed in SPEEDS_M_S
        for sign in (1, -1)
    ]
    return moves + [
        Move("turning", sign * rate, TURN_ACCELERATION_RAD_S2, HELD_S, True)
        for rate in TURN_RATES_RAD_S
        for sign in (1, -1)
    ]


def longest(moves: Sequence[Move]) -> int:
    """Frames in which all of them are done."""
    return max(move.frames for move in moves)


def _within(frames: int, start: float, end: float) -> np.ndarray:
    """Return which frames begin and end between two times."""
    begins = PERIOD_S * np.arange(frames, dtype=float) + 1e-9
    return (begins >= start) & (begins + PERIOD_S <= end)
