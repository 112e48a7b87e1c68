"""The moves with which TIGERs Mannheim identify a robot, and what the robot logs of them.

There and back between two ends 3 m apart, each way on its own: speed up at 2 m/s^2, hold, and
either brake and stop or, half a second's way before the end, let the motors go and roll out;
forward and sideways. On the spot: speed up at 12 rad/s^2, hold for 3 s, roll out. Source:
`IdentifyBotModelRole.java` of Sumatra.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from omni_control.controllers.base import Controller
from omni_control.kinematics import Array, world_to_body
from omni_mj.config.rows import Row
from omni_mj.config.scenario import Scenario
from omni_mj.config.settings import PERIOD_S
from omni_mj.plants.mujoco import MujocoPlant
from omni_mj.simulation.simulation import Simulation
from omni_mj.studies.study_runner import AfterFrame, open_loop_settings, send_twists

AXES = ("forward", "sideways", "turning")
SPEEDS_M_S, ACCELERATION_M_S2, WAY_M, ROLL_OUT_S = (0.5, 1.0, 1.25, 1.5), 2.0, 3.0, 0.5
TURN_RATES_RAD_S, TURN_ACCELERATION_RAD_S2, HELD_S = (4.0, 6.0, 8.0, 10.0), 12.0, 3.0
REST_S = 0.1  # at the start
AFTER_S, ROLLING_S = 0.25, 1.5  # to come to rest after braking, and for a roll-out


@dataclass(frozen=True)
class Move:
    """One move from rest.

    Attributes:
        kind: forward, sideways or turning.
        speed: That is held, m/s or rad/s; negative for the way back.
        acceleration: Magnitude, m/s^2 or rad/s^2.
        held_s: How long the speed is held.
        rolls_out: Whether the motors are let go then, instead of braking.
    """

    kind: str
    speed: float
    acceleration: float
    held_s: float
    rolls_out: bool

    @property
    def times(self) -> tuple[float, float, float, float]:
        """When it starts, reaches the speed, no longer holds it, and stops if the robot brakes, s."""
        ramp = abs(self.speed) / self.acceleration
        reached = REST_S + ramp
        return REST_S, reached, reached + self.held_s, reached + self.held_s + ramp

    @property
    def frames(self) -> int:
        """Number of frames of the whole move."""
        _, _, let_go, stopped = self.times
        return int(
            np.ceil((let_go + ROLLING_S if self.rolls_out else stopped + AFTER_S) / PERIOD_S)
        )

    def command(self, frames: int) -> Array:
        """Return twists (frames, 3): in each frame what is wanted at its end."""
        share = np.interp(PERIOD_S * np.arange(1, frames + 1), self.times, [0.0, 1.0, 1.0, 0.0])
        share[self.is_free(frames)] = 0.0
        return self.speed * share[:, None] * np.eye(3)[AXES.index(self.kind)]

    def is_free(self, frames: int) -> np.ndarray:
        """Return in which frames (frames,) the motors are let go."""
        return self.rolls_out & (PERIOD_S * np.arange(frames) + 1e-9 >= self.times[2])


@dataclass(frozen=True)
class Record:
    """What n robots log in F frames, body frame: means over a frame each.

    Means, since commands are new in every frame, and what wheels do in it is no straight line.

    Attributes:
        wheels: Twist by the encoders, (F, n, 3).
        body: Its true twist, (F, n, 3). TIGERs take a filter's, which errs by 0.1 % of the speed.
        simulation: That was run.
        stopped: Why it ended before its time, or None.
    """

    wheels: Array
    body: Array
    simulation: Simulation
    stopped: str | None


def straight(
    kind: str, speed: float, rolls_out: bool, acceleration: float = ACCELERATION_M_S2
) -> Move:
    """Return a move over the whole way, or to where a robot is let go."""
    way = WAY_M - (ROLL_OUT_S if rolls_out else abs(speed) / acceleration / 2) * abs(speed)
    return Move(
        kind, speed, acceleration, way / abs(speed) - abs(speed) / acceleration / 2, rolls_out
    )


def identification() -> list[Move]:
    """Return all moves of one robot."""
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


def count_frames(moves: Sequence[Move]) -> int:
    """Return in how many frames all moves are done; one more records where the last command led."""
    return max(move.frames for move in moves)


def drive(scenario: Scenario, moves: Sequence[Move], after_frame: AfterFrame) -> Record:
    """Drive moves side by side.

    Args:
        scenario: The robot and all else.
        moves: One for each robot.
        after_frame: Called with each frame's number; it may raise `StoppedError`.
    """
    frames = count_frames(moves) + 1
    settings = open_loop_settings(scenario.settings, frames + 1, reference={"lead_s": 0.0})
    chosen = scenario.replace(settings=settings, plant="mujoco", paper_table=0, seeds=1)
    rows = [
        Row(i, 0, Controller.__name__, chosen.seed + i, settings, chosen.robot)
        for i in range(len(moves))
    ]
    simulation = Simulation(chosen, [Controller], rows=rows)
    plant, kinematics = simulation.plant, settings.wheels.kinematics
    assert isinstance(plant, MujocoPlant)

    def twists() -> Iterator[Array]:
        free = np.stack([move.is_free(frames) for move in moves], axis=1)
        held = np.where(free, 0.0, np.nan)[..., None].repeat(len(kinematics.azimuths), -1)
        for frame, twist in enumerate(np.stack([move.command(frames) for move in moves], axis=1)):
            plant.hold(held[frame])
            yield twist

    stopped = send_twists(simulation, twists(), after_frame)
    pose, angle = simulation.log.channel("pose"), simulation.log.channel("wheel_angle")
    per_rad = settings.sensors.encoder_counts * settings.motor.gear / (2 * np.pi)
    counts = np.diff(np.floor(angle * per_rad), axis=0)
    return Record(
        wheels=kinematics.body_twist(counts / (per_rad * PERIOD_S)),
        body=world_to_body(
            np.diff(pose, axis=0) / PERIOD_S, (pose[1:, :, 2] + pose[:-1, :, 2]) / 2
        ),
        simulation=simulation,
        stopped=stopped,
    )
