"""Requests of the simulation protocol: commands, which become radio packets, and teleports."""

import math
from collections.abc import Mapping

import numpy as np
from google.protobuf.message import Message

from omni_control.kinematics import Array, wrap_angle
from omni_mj.config import CYCLES_PER_FRAME
from omni_mj.live.serve.detections import RobotName
from omni_mj.live.serve.served_plant import HEADING_MEMORY_FRAMES
from omni_mj.live.wire.league_pb2 import (
    RobotCommand,
    RobotId,
    SimulatorControl,
    SimulatorError,
    Team,
    TeleportBall,
    TeleportRobot,
)
from omni_mj.network.radio import ReceivedCommand

# Columns of a packet: velocities [vx, vy, w]; the measured heading, and the cycle of its image;
# whether the velocities are in the body frame; rim speeds, NaN if not commanded.
HEADING, IMAGE_CYCLE, IS_LOCAL, WHEELS = 3, 4, 5, 6
MAX_VELOCITY = 1e3  # of a command, m/s and rad/s
MAX_SPEED_M_S, MAX_RATE_RAD_S = 20.0, 100.0  # of a robot that is placed
MAX_NUMBER = 15  # robot numbers are 0 to 15, because there are 16 patterns
MAX_COMMANDS = 2 * (MAX_NUMBER + 1)  # of a packet: one to each robot of both teams

Placement = tuple[Array, Array]  # pose and twist in the world frame, shape (3,) each


class Refusal(Exception):  # noqa: N818
    """A refused request.

    Args:
        code: Machine-readable code.
        reason: Message for users.
    """

    def __init__(self, code: str, reason: str) -> None:
        super().__init__(reason)
        self.error = SimulatorError(code=code, message=reason)


def find_unknown_fields(message: Message) -> list[SimulatorError]:
    """Return an error if a message has fields that `league.proto` lacks, and remove them."""
    size = message.ByteSize()
    message.DiscardUnknownFields()
    if message.ByteSize() == size:
        return []
    name = message.DESCRIPTOR.name
    return [Refusal("UNKNOWN_FIELD", f"{name} has fields that serve ignores").error]


def robot_label(name: RobotName) -> str:
    """Return the name of a robot in messages, such as "blue 3"."""
    return f"{Team.Name(name[0]).lower()} {name[1]}"


def empty_packet(n_wheels: int) -> list[float]:
    """Return the packet that a robot applies before its first command."""
    return [0.0, 0.0, 0.0, np.nan, 0.0, 0.0, *[np.nan] * n_wheels]


def encode_packet(command: RobotCommand, n_wheels: int) -> list[float] | None:
    """Return the packet of a command, or None if the command has no velocity.

    Positive rim speeds turn the robot counter-clockwise. Our wheels are numbered from the front
    left, counter-clockwise; the protocol's wheels from the front right, clockwise.

    Raises:
        Refusal: The command is invalid for this robot.
    """
    move, packet = command.move_command, empty_packet(n_wheels)
    form = move.WhichOneof("command")
    if form is None:
        return None
    values = [value for _, value in getattr(move, form).ListFields()]
    if form == "wheel_velocity":
        if n_wheels != 4:
            raise Refusal(
                "WHEELS", f"robot {command.id} has {n_wheels} wheels; wheel velocities need four"
            )
        packet[WHEELS:] = reversed(values)
    else:
        packet[:3], packet[IS_LOCAL] = values, float(form == "local_velocity")
    if not all(abs(value) < MAX_VELOCITY for value in values):
        limit = f"velocities must be below {MAX_VELOCITY:g} m/s and rad/s"
        raise Refusal("VELOCITY", f"robot {command.id}: {limit}, got {values}")
    return packet


def decode_packets(packets: Array, is_new: np.ndarray, cycle: int) -> ReceivedCommand:
    """Return the commands that robots apply.

    Args:
        packets: Packets, shape (n, k).
        is_new: Which packets have just arrived, shape (n,).
        cycle: Cycle in which robots compare the measured headings with their own.
    """
    age = np.rint((cycle - packets[:, IMAGE_CYCLE]) / CYCLES_PER_FRAME).astype(int)
    is_known = is_new & (age <= HEADING_MEMORY_FRAMES)
    is_local, rims = packets[:, IS_LOCAL] > 0, packets[:, WHEELS:]
    return ReceivedCommand(
        command=packets[:, :3],
        heading=np.where(is_known, packets[:, HEADING], np.nan),
        age=age * is_known,
        is_new=is_new,
        in_body_frame=is_local if is_local.any() else None,
        rim_speeds=None if np.isnan(rims).all() else rims,
    )


def read_name(robot: RobotId) -> RobotName:
    """Return the name of a robot.

    Raises:
        Refusal: The number or the team is invalid.
    """
    if (
        not robot.HasField("id")
        or robot.id > MAX_NUMBER
        or robot.team not in (Team.BLUE, Team.YELLOW)
    ):
        raise Refusal(
            "ROBOT_ID", f"a robot needs a number from 0 to {MAX_NUMBER} and a team, blue or yellow"
        )
    return robot.team, robot.id


def list_ignored_options(control: SimulatorControl) -> list[SimulatorError]:
    """Return errors for the options of teleports that do not apply; they are done without them."""
    ball = control.teleport_ball
    options = {
        f"teleport_ball.{field}": getattr(ball, field)
        for field in ("teleport_safely", "roll", "by_force")
    }
    options["teleport_robot.by_force"] = any(robot.by_force for robot in control.teleport_robot)
    errors = [
        Refusal("OPTION", f"{name} does not apply: teleports are done at once").error
        for name, is_set in options.items()
        if is_set
    ]
    motion = [field for field in ("z", "vx", "vy", "vz") if getattr(ball, field)]
    if motion:
        reason = f"the ball lies on the carpet where it is put; {', '.join(motion)} do not apply"
        errors.append(Refusal("BALL", reason).error)
    return errors


def read_teleport(
    teleport: TeleportRobot, poses: Mapping[RobotName, Array]
) -> tuple[RobotName, Placement | None]:
    """Return the name of the robot, and its new pose and twist; None if it is removed.

    Args:
        teleport: The request.
        poses: Robot name -> pose, shape (3,). It supplies fields that the request lacks.

    Raises:
        Refusal: The robot or the pose is invalid.
    """
    name = read_name(teleport.id)
    if teleport.HasField("present") and not teleport.present:
        return name, None
    if name not in poses and not (
        teleport.present and teleport.HasField("x") and teleport.HasField("y")
    ):
        raise Refusal(
            "ABSENT", f"{robot_label(name)} is not on the field; send present = true with x and y"
        )
    pose = poses.get(name, np.zeros(3)).copy()
    twist = np.array([teleport.v_x, teleport.v_y, teleport.v_angular])
    for i, field in enumerate(("x", "y", "orientation")):
        if teleport.HasField(field):
            pose[i] = getattr(teleport, field)
    is_slow = math.hypot(*twist[:2]) <= MAX_SPEED_M_S and abs(twist[2]) <= MAX_RATE_RAD_S
    if not np.isfinite(pose).all() or not is_slow:
        limits = f"velocities up to {MAX_SPEED_M_S:g} m/s and {MAX_RATE_RAD_S:g} rad/s"
        raise Refusal("TELEPORT", f"{robot_label(name)}: poses must be finite, {limits}")
    pose[2] = wrap_angle(pose[2])
    return name, (pose, twist)


def read_ball(ball: TeleportBall, position: Array) -> Array:
    """Return the new position of the ball, shape (2,), m.

    Args:
        ball: The request.
        position: Present position of the ball, shape (2,), m.

    Raises:
        Refusal: The position is not finite.
    """
    target = np.array(
        [
            ball.x if ball.HasField("x") else position[0],
            ball.y if ball.HasField("y") else position[1],
        ]
    )
    if not np.isfinite(target).all():
        raise Refusal("BALL", "the ball needs a finite position")
    return target
