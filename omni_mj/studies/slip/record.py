"""Driving moves and seeing them as the robot's own log does: encoders, the filter of its velocity, motors' currents."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from omni_control.controllers.base import Controller
from omni_control.kinematics import Array, world_to_body
from omni_mj.plants.mujoco import MujocoPlant
from omni_mj.scenarios.rows import Row
from omni_mj.scenarios.scenario import Scenario
from omni_mj.scenarios.settings import PERIOD_S, Settings
from omni_mj.simulate.simulation import Simulation
from omni_mj.studies.outcome import AfterFrame, StoppedError, nothing
from omni_mj.worlds.build import kinematics

# With which vision corrects the integrated acceleration: a filter of second order, 2 rad/s, damped by 0.7.
_RATE, _DAMPING = 2.0, 0.7


class Moves(Controller):
    """Stands where a controller would be named; what the robots are sent are the moves."""


@dataclass(frozen=True)
class Record:
    """What n robots log in F frames, taken in the middle of each, body frame.

    Attributes:
        wheels: twist by the encoders, (F, n, 3).
        body: twist by the filter of acceleration, gyro and vision, (F, n, 3).
        force: force and torque that the currents should give through the motors' datasheet, (F, n, 3) N and N m.
        simulation: that was run.
        stopped: why it ended before its time, or None.
    """

    wheels: Array
    body: Array
    force: Array
    simulation: Simulation
    stopped: str | None


def drive(scenario: Scenario, commands: Array, held: Array | None = None, after_frame: AfterFrame = nothing) -> Record:
    """Send robots commands, a row each.

    Args:
        scenario: the robot and all else.
        commands: twists (F, n, 3), world frame; robots start with heading 0.
        held: currents (F, n) or (F, n, wheels) A that drivers hold instead; not a number where there is none.
        after_frame: called with each frame's number; it may raise `StoppedError`.
    """
    frames, n, _ = commands.shape
    chosen = _open_loop(scenario, frames + 2)
    rows = [Row(i, 0, Moves.__name__, chosen.seed + i, chosen.settings, chosen.robot) for i in range(n)]
    simulation, stopped = Simulation(chosen, [Moves], rows=rows), None
    plant = simulation.plant
    assert isinstance(plant, MujocoPlant)
    wheels = len(kinematics(chosen.settings.wheels).azimuths)
    twists, currents = [plant.twist().copy()], list[Array]()
    try:
        for frame, command in enumerate([*commands, np.zeros((n, 3))]):  # the last only records where the others led
            if held is not None and frame < frames:
                plant.hold(np.broadcast_to(held[frame].reshape(n, -1), (n, wheels)))
            simulation.step(command)
            twists.append(plant.twist().copy())
            currents.append(plant.currents.mean(0))
            after_frame(frame)
    except StoppedError as error:
        stopped = error.reason
    log = simulation.log
    pose, done = log.channel("pose"), log.length - 1
    return Record(
        by_encoders(log.channel("wheel_angle"), chosen.settings),
        by_filter(log.channel("vision"), np.array(twists)[: done + 1], pose[..., 2]),
        by_currents(np.array(currents)[:done], chosen.settings),
        simulation,
        stopped,
    )


def by_encoders(angles: Array, settings: Settings) -> Array:
    """Body twists (F, n, 3) from wheel angles (F + 1, n, wheels) in rad, in counts, over a frame each."""
    per_rad = settings.sensors.encoder_counts * settings.motor.gear / (2 * np.pi)
    counts = np.floor(angles * per_rad)
    return kinematics(settings.wheels).body_twist(np.diff(counts, axis=0) / (per_rad * PERIOD_S))


def by_filter(vision: Array, twist: Array, heading: Array) -> Array:
    """Body twists (F, n, 3) as a robot's filter has them: acceleration integrated, and corrected by vision.

    TIGERs fit to the velocity of their robots' filter of gyro, accelerometer and vision. Our robots have no
    accelerometer; the change of the true velocity stands for it, and the true turn rate and heading for those of the
    gyro, whose noise is 0.1 % of what turns here.

    Args:
        vision: poses seen (F + 1, n, 3), not a number where there were none.
        twist: true (F + 1, n, 3), world frame.
        heading: (F + 1, n) rad.
    """
    position, velocity = vision[0, :, :2].copy(), twist[0, :, :2].copy()
    filtered = twist.copy()
    for k in range(1, len(vision)):
        gained = twist[k, :, :2] - twist[k - 1, :, :2]
        position += PERIOD_S * (velocity + gained / 2)
        wrong = np.nan_to_num(vision[k, :, :2] - position)
        position += 2 * _DAMPING * _RATE * PERIOD_S * wrong
        velocity += gained + _RATE**2 * PERIOD_S * wrong
        filtered[k, :, :2] = velocity
    body = world_to_body(filtered, heading)
    middle: Array = (body[1:] + body[:-1]) / 2
    return middle


def by_currents(currents: Array, settings: Settings) -> Array:
    """Force and torque on the body (F, n, 3) from mean currents (F, n, wheels) in A: J^T (i k gear / R)."""
    wheels, motor = kinematics(settings.wheels), settings.motor
    pull = currents * (motor.constant_nm_a * motor.gear / wheels.radius)
    force: Array = (pull[..., None] * wheels.matrix).sum(-2)
    return force


def shares(force: Sequence[float], settings: Settings) -> Array:
    """Currents (wheels,) in A that should give a force and torque (3,) on the body, the smallest ones."""
    wheels, motor = kinematics(settings.wheels), settings.motor
    pull: Array = np.linalg.pinv(wheels.matrix.T) @ np.asarray(force)
    return pull * (wheels.radius / (motor.constant_nm_a * motor.gear))


def _open_loop(scenario: Scenario, frames: int) -> Scenario:
    """The scenario without dead time and controllers, alone on the carpet, as long as `frames`."""
    settings = scenario.settings.replace(
        reference={
            "shape": "waypoints",
            "waypoints": [[0, 0], [0, 0]],
            "mode": "timed",
            "lead_s": 0.0,
            "settle_s": frames * PERIOD_S,
        },
        radio={"delay_frames": 0, "jitter_frames": 0},
        world={"places": [[0, 0, 0]]},
    )
    return scenario.replace(settings=settings, plant="mujoco", paper_table=0, seeds=1)
