"""The moves with which TIGERs Mannheim identify a robot, and what the robot records.

A straight move goes from one end of a 3 m track to the other: accelerate at 2 m/s^2, and hold the
speed. Then either brake to a stop at the end, or switch the motors off at a distance of 0.5 s times
the speed from the end, and roll out. Moves are forward and sideways, in both directions. A turn on
the spot accelerates at 12 rad/s^2, holds the turn rate for 3 s, and rolls out. Source:
`IdentifyBotModelRole.java` of Sumatra, which has no roll-outs sideways.

Straight moves hold the heading. Without that, robots turn in sideways moves, because front and rear
wheels differ. While the robot rolls out, motor currents exert a moment, but no force.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from omni_control.kinematics import Array, world_to_body
from omni_mj.config import PERIOD_S
from omni_mj.config.scenario import Scenario
from omni_mj.config.settings import Settings
from omni_mj.plants.mujoco_plant import MujocoPlant
from omni_mj.results.result import Outcome
from omni_mj.simulation.simulation import Simulation
from omni_mj.studies.open_loop import build_open_loop, open_loop_settings, run_open_loop
from omni_mj.studies.run_scenario import StartProgress

AXES = ("forward", "sideways", "turning")
SPEEDS_M_S = (0.5, 1.0, 1.25, 1.5)
ACCELERATION_M_S2 = 2.0
TRACK_M = 3.0
ROLL_OUT_DISTANCE_S = 0.5  # distance to the end at which a roll-out starts, as a time at full speed
TURN_RATES_RAD_S = (4.0, 6.0, 8.0, 10.0)
TURN_ACCELERATION_RAD_S2 = 12.0
TURN_HOLD_S = 3.0
REST_S = 0.1  # before the move
BRAKED_REST_S = 0.25  # after braking
ROLL_OUT_S = 1.5  # duration of a roll-out
HEADING_GAIN_S = 10.0  # turn rate per heading error of straight moves, 1/s


@dataclass(frozen=True)
class Move:
    """One move that starts at rest.

    Attributes:
        axis: "forward", "sideways" or "turning".
        speed: Held speed, m/s or rad/s; negative in the opposite direction.
        acceleration: Magnitude, m/s^2 or rad/s^2.
        hold_s: Time at constant speed, s.
        rolls_out: Whether the motors are switched off at the end, instead of braking.
    """

    axis: str
    speed: float
    acceleration: float
    hold_s: float
    rolls_out: bool

    @property
    def direction(self) -> Array:
        """Unit vector of the twist, (3,)."""
        return np.sign(self.speed) * np.eye(3)[AXES.index(self.axis)]

    @property
    def phase_times(self) -> tuple[float, float, float, float]:
        """Times at which ramp up, full speed and ramp down begin, and at which it ends, s."""
        ramp = abs(self.speed) / self.acceleration
        full_speed = REST_S + ramp
        return REST_S, full_speed, full_speed + self.hold_s, full_speed + self.hold_s + ramp

    @property
    def frames(self) -> int:
        """Number of frames of the move."""
        _, _, full_speed_end, stop = self.phase_times
        end = full_speed_end + ROLL_OUT_S if self.rolls_out else stop + BRAKED_REST_S
        return int(np.ceil(end / PERIOD_S))

    def command(self, frames: int) -> Array:
        """Return the twist at the end of each frame, (frames, 3)."""
        fraction = np.interp(
            PERIOD_S * np.arange(1, frames + 1), self.phase_times, [0.0, 1.0, 1.0, 0.0]
        )
        fraction[self.is_coasting(frames)] = 0.0
        return abs(self.speed) * fraction[:, None] * self.direction

    def is_coasting(self, frames: int) -> np.ndarray:
        """Return whether the motors are off, for each frame, (frames,)."""
        return self.rolls_out & (PERIOD_S * np.arange(frames) + 1e-9 >= self.phase_times[2])


@dataclass(frozen=True)
class MoveRecord:
    """Twists of n robots in F frames, body frame.

    They are means over each frame, because commands change every frame and wheel speeds do not
    change linearly in between.

    Attributes:
        wheel_twists: Twist by the encoders, (F, n, 3).
        body_twists: True twist, (F, n, 3). TIGERs Mannheim use the estimate of a filter, whose
            error is 0.1 % of the speed.
        outcome: Outcome of the simulation.
    """

    wheel_twists: Array
    body_twists: Array
    outcome: Outcome


def straight_move(axis: str, speed: float, rolls_out: bool) -> Move:
    """Return a move over the whole track, or to the point where the motors are switched off."""
    half_ramp_s = abs(speed) / ACCELERATION_M_S2 / 2
    end_s = ROLL_OUT_DISTANCE_S if rolls_out else half_ramp_s
    hold_s = (TRACK_M - end_s * abs(speed)) / abs(speed) - half_ramp_s
    return Move(axis, speed, ACCELERATION_M_S2, hold_s, rolls_out)


def identification_moves() -> list[Move]:
    """Return all moves of one robot."""
    moves = [
        straight_move(axis, sign * speed, rolls_out)
        for axis in ("forward", "sideways")
        for rolls_out in (True, False)
        for speed in SPEEDS_M_S
        for sign in (1, -1)
    ]
    return moves + [
        Move("turning", sign * rate, TURN_ACCELERATION_RAD_S2, TURN_HOLD_S, True)
        for rate in TURN_RATES_RAD_S
        for sign in (1, -1)
    ]


def record_moves(
    scenario: Scenario, moves: Sequence[Move], start_progress: StartProgress
) -> MoveRecord:
    """Drive all moves, one robot each, and record encoders and poses.

    Args:
        scenario: The robot and its settings.
        moves: The move of each robot.
        start_progress: See `slip_study.measure_slip`.
    """
    # The last frame only records the pose that the last command led to.
    frames = max(move.frames for move in moves) + 1
    settings = open_loop_settings(scenario.settings, frames)
    scenario = scenario.replace(settings=settings, plant="mujoco", paper_table=0, seeds=1)
    simulation = build_open_loop(
        scenario, [(scenario.seed + i, settings) for i in range(len(moves))]
    )
    commands = _command_moves(simulation, moves, frames)
    after_frame = start_progress(scenario.name, frames)
    outcome = run_open_loop(simulation.scenario, simulation, commands, after_frame)
    kinematics = settings.wheels.kinematics
    pose, angle = simulation.log.channel("pose"), simulation.log.channel("wheel_angle")
    counts_per_rad = settings.sensors.encoder_counts * settings.motor.gear_ratio / (2 * np.pi)
    counts = np.diff(np.floor(angle * counts_per_rad), axis=0)
    heading = (pose[1:, :, 2] + pose[:-1, :, 2]) / 2
    return MoveRecord(
        wheel_twists=kinematics.body_twist(counts / (counts_per_rad * PERIOD_S)),
        body_twists=world_to_body(np.diff(pose, axis=0) / PERIOD_S, heading),
        outcome=outcome,
    )


def _command_moves(simulation: Simulation, moves: Sequence[Move], frames: int) -> Iterator[Array]:
    """Yield the twists (n, 3) of each frame, and set the motor currents of coasting robots.

    Straight moves hold the heading 0. Its error decays at the rate `HEADING_GAIN_S`.
    """
    plant = simulation.plant
    assert isinstance(plant, MujocoPlant)
    currents_per_turn_acceleration = _compute_turning_currents(simulation.rows[0].settings)
    is_straight = np.array([move.axis != "turning" for move in moves])
    is_coasting = np.stack([move.is_coasting(frames) for move in moves], axis=1)
    twists = np.stack([move.command(frames) for move in moves], axis=1)
    for frame, twist in enumerate(twists):
        turn_rate = -HEADING_GAIN_S * plant.pose()[:, 2] * is_straight
        missing_turn_rate = turn_rate - plant.twist()[:, 2] * is_straight
        turn_acceleration = 2 * HEADING_GAIN_S * missing_turn_rate
        currents = turn_acceleration[:, None] * currents_per_turn_acceleration
        plant.set_motor_currents(np.where(is_coasting[frame][:, None], currents, np.nan))
        yield twist + turn_rate[:, None] * [0.0, 0.0, 1.0]


def _compute_turning_currents(settings: Settings) -> Array:
    """Return motor currents (W,) per turn acceleration that exert no force, A s^2/rad."""
    wheels, motor = settings.wheels.kinematics, settings.motor
    rim_forces_per_moment = np.linalg.pinv(wheels.matrix.T)[:, 2]
    currents_per_moment = rim_forces_per_moment * wheels.radius / motor.wheel_back_emf_v_s
    return np.asarray(settings.body.yaw_inertia_kg_m2 * currents_per_moment, float)
