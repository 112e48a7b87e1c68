"""Driving moves and seeing them as the robot's own log does: encoders, the filter of its velocity, motors' currents."""

from dataclasses import dataclass

import numpy as np

from omni_control.controllers.base import Controller
from omni_control.kinematics import Array, world_to_body
from omni_mj.plants.mujoco import MujocoPlant
from omni_mj.scenarios.rows import Row
from omni_mj.scenarios.scenario import Scenario
from omni_mj.scenarios.settings import PERIOD_S, Settings
from omni_mj.simulate.simulation import Simulation
from omni_mj.studies.outcome import AfterFrame, StoppedError, nothing, standing


class Moves(Controller):
    """Stands where a controller would be named; what the robots are sent are the moves."""


@dataclass(frozen=True)
class Record:
    """What n robots log in F frames, body frame: means over a frame each.

    Means, since commands are new in every frame, and what wheels do in it is no straight line.

    Attributes:
        wheels: twist by the encoders, (F, n, 3).
        body: its twist, (F, n, 3).
        force: force and torque that the currents should give through the motors' datasheet, (F, n, 3) N and N m.
        simulation: that was run.
        stopped: why it ended before its time, or None.
    """

    wheels: Array
    body: Array
    force: Array
    simulation: Simulation
    stopped: str | None


def drive(scenario: Scenario, commands: Array, free: np.ndarray, after_frame: AfterFrame = nothing) -> Record:
    """Send robots commands, a row each.

    Args:
        scenario: the robot and all else.
        commands: twists (F, n, 3), world frame; robots start with heading 0.
        free: where motors carry no current, (F, n).
        after_frame: called with each frame's number; it may raise `StoppedError`.
    """
    frames, n, _ = commands.shape
    settings = standing(scenario.settings, frames + 2, reference={"lead_s": 0.0})
    chosen = scenario.replace(settings=settings, plant="mujoco", paper_table=0, seeds=1)
    rows = [Row(i, 0, Moves.__name__, chosen.seed + i, settings, chosen.robot) for i in range(n)]
    simulation, stopped, currents = Simulation(chosen, [Moves], rows=rows), None, list[Array]()
    plant = simulation.plant
    assert isinstance(plant, MujocoPlant)
    held = np.where(free, 0.0, np.nan)[..., None].repeat(len(settings.wheels.azimuths_deg), -1)
    try:
        for frame, command in enumerate([*commands, np.zeros((n, 3))]):  # the last only records where the others led
            if frame < frames and free.any():
                plant.hold(held[frame])
            simulation.step(command)
            currents.append(plant.telemetry().current_mean)
            after_frame(frame)
    except StoppedError as error:
        stopped = error.reason
    log = simulation.log
    return Record(
        by_encoders(log.channel("wheel_angle"), settings),
        by_body(log.channel("pose")),
        by_currents(np.array(currents)[: log.length - 1], settings),
        simulation,
        stopped,
    )


def by_encoders(angles: Array, settings: Settings) -> Array:
    """Body twists (F, n, 3) from wheel angles (F + 1, n, wheels) in rad, in counts, over a frame each."""
    per_rad = settings.sensors.encoder_counts * settings.motor.gear / (2 * np.pi)
    counts = np.floor(angles * per_rad)
    return settings.wheels.kinematics.body_twist(np.diff(counts, axis=0) / (per_rad * PERIOD_S))


def by_body(pose: Array) -> Array:
    """Return mean body twists (F, n, 3) in each frame, of true poses (F + 1, n, 3).

    TIGERs fit to the velocity of their robots' filter of gyro, accelerometer and vision. What such a filter errs by,
    1.3 mm of vision's noise to 1 mm/s, is 0.1 % of the speed.
    """
    return world_to_body(np.diff(pose, axis=0) / PERIOD_S, (pose[1:, :, 2] + pose[:-1, :, 2]) / 2)


def by_currents(currents: Array, settings: Settings) -> Array:
    """Force and torque on the body (F, n, 3) from mean currents (F, n, wheels) in A: J^T (i k gear / R)."""
    wheels, motor = settings.wheels.kinematics, settings.motor
    pull = currents * (motor.constant_nm_a * motor.gear / wheels.radius)
    force: Array = (pull[..., None] * wheels.matrix).sum(-2)
    return force
