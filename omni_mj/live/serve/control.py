"""Teleports, presence of robots, the ball and the field, as the simulator's control port accepts them."""

import math
from collections.abc import Iterable

import numpy as np

from omni_control.kinematics import wrap_angle
from omni_mj.live.serve.cameras import RobotName
from omni_mj.live.serve.commands import Refusal
from omni_mj.live.serve.pitch import Pitch, Placement, label
from omni_mj.live.wire.simulation_pb2 import SimulatorError, Team, TeleportBall, TeleportRobot

MAX_SPEED_M_S, MAX_RATE_RAD_S = 20.0, 100.0  # of a robot that is put down
MAX_DISTANCE_M = 100.0  # of the ball from the field's centre
MAX_NUMBER = 15  # of a robot: there are 16 patterns
REFUSED = {  # fields of a configuration -> code and reason
    "robot_specs": ("ROBOT_SPECS", "robots are those of their files: start serve with --robot and --set"),
    "realism_config": ("REALISM", "realism is a scenario's: start serve with --scenario and --set"),
}


def teleport_robots(pitch: Pitch, teleports: Iterable[TeleportRobot]) -> list[SimulatorError]:
    """Put robots down and take others away. Return errors."""
    errors, placements, leaving = list[SimulatorError](), dict[RobotName, Placement](), set[RobotName]()
    for teleport in teleports:
        try:
            name = _name(teleport)
            if teleport.HasField("present") and not teleport.present:
                leaving.add(name)
                placements.pop(name, None)
            elif (placement := _placement(pitch, name, teleport)) is not None:
                leaving.discard(name)
                placements[name] = placement
        except Refusal as refusal:
            errors.append(refusal.error)
    return errors + pitch.place(placements, leaving)


def teleport_ball(pitch: Pitch, ball: TeleportBall) -> None:
    """Put the ball somewhere, where it lies.

    Raises:
        Refusal: It is too far away, or is given a velocity or height, which it does not take.
    """
    x, y = pitch.ball
    position = np.array([ball.x if ball.HasField("x") else x, ball.y if ball.HasField("y") else y])
    if not (np.abs(position) <= MAX_DISTANCE_M).all():
        raise Refusal("BALL", f"the ball lies within {MAX_DISTANCE_M:g} m, not at {position.tolist()}")
    pitch.ball = position
    if ball.vx or ball.vy or ball.vz or ball.z:
        raise Refusal("BALL_LIES", "the ball lies where it is put; it neither rolls nor flies here")


def _name(teleport: TeleportRobot) -> RobotName:
    number, team = teleport.id.id, teleport.id.team
    if not teleport.id.HasField("id") or number > MAX_NUMBER or team not in (Team.BLUE, Team.YELLOW):
        raise Refusal("ROBOT_ID", f"a robot has a number from 0 to {MAX_NUMBER} and a team, blue or yellow")
    return team, number


def _placement(pitch: Pitch, name: RobotName, teleport: TeleportRobot) -> Placement | None:
    """Return pose and twist that a robot shall have; None if it stays as it is."""
    if teleport.by_force:
        raise Refusal("BY_FORCE", f"{label(name)}: robots are put down at once, not pushed; leave by_force out")
    before, fields = pitch.poses().get(name), {field.name for field, _ in teleport.ListFields()}
    if before is None:
        if not teleport.present or not {"x", "y"} <= fields:
            raise Refusal("ABSENT", f"{label(name)} is not on the field; send present = true with x and y")
        before = np.zeros(3)
    elif not fields - {"id", "present", "by_force"}:
        return None
    pose, twist = before.copy(), np.array([teleport.v_x, teleport.v_y, teleport.v_angular])
    for i, field in enumerate(("x", "y", "orientation")):
        if field in fields:
            pose[i] = getattr(teleport, field)
    is_slow = math.hypot(*twist[:2]) <= MAX_SPEED_M_S and abs(twist[2]) <= MAX_RATE_RAD_S
    if not np.isfinite(pose).all() or not is_slow:
        limits = f"velocities up to {MAX_SPEED_M_S:g} m/s and {MAX_RATE_RAD_S:g} rad/s"
        raise Refusal("TELEPORT", f"{label(name)}: places are finite, {limits}")
    pose[2] = wrap_angle(pose[2])
    return pose, twist
