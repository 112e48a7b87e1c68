"""Requests of the simulation protocol: commands as packets of the radio, and teleports."""

import math
from collections.abc import Mapping

import numpy as np

from omni_control.kinematics import Array, wrap_angle
from omni_mj.live.serve.detections import CYCLES_PER_FRAME, RobotName
from omni_mj.live.serve.served_plant import HEADING_MEMORY_FRAMES
from omni_mj.live.wire.league_pb2 import (
    RobotCommand,
    SimulatorError,
    Team,
    TeleportBall,
    TeleportRobot,
)
from omni_mj.network.radio import ReceivedCommand

# Columns of a packet: velocities [vx, vy, w]; the heading that vision saw, and the cycle of its
# image; whether the velocities are in the robot's frame; rim speeds, NaN where there are none.
HEADING, IMAGE_CYCLE, IS_LOCAL, WHEELS = 3, 4, 5, 6
MAX_VELOCITY = 1e3  # m/s and rad/s, of a command
MAX_SPEED_M_S, MAX_RATE_RAD_S = 20.0, 100.0  # of a robot that is put down
MAX_NUMBER = 15  # of a robot: there are 16 patterns

Placement = tuple[Array, Array]  # pose and twist in the world frame, shape (3,) each


class Refusal(Exception):  # noqa: N818
    """A request that is not granted.

    Args:
        code: For programs.
        reason: For people.
    """

    def __init__(self, code: str, reason: str) -> None:
        super().__init__(reason)
        self.error = SimulatorError(code=code, message=reason)


def label(name: RobotName) -> str:
    """Return what a robot is called in messages."""
    return f"{Team.Name(name[0]).lower()} {name[1]}"


def empty_packet(n_wheels: int) -> list[float]:
    """Return what a robot holds before the first command."""
    return [0.0, 0.0, 0.0, np.nan, 0.0, 0.0, *[np.nan] * n_wheels]


def encode_packet(command: RobotCommand, n_wheels: int) -> list[float] | None:
    """Return the packet for a robot, or None if the command does not say how to move.

    Rim speeds turn the robot counter-clockwise if they are positive. Wheels of the robot count from
    the front left, counter-clockwise; those of the protocol from the front right, clockwise.

    Raises:
        Refusal: The robot cannot obey.
    """
    move, packet = command.move_command, empty_packet(n_wheels)
    form = move.WhichOneof("command")
    if form is None:
        return None
    values = [value for _, value in getattr(move, form).ListFields()]
    if form == "wheel_velocity":
        if n_wheels != 4:
            raise Refusal(
                "WHEELS", f"robot {command.id} has {n_wheels} wheels; rim speeds are for four"
            )
        packet[WHEELS:] = reversed(values)
    else:
        packet[:3], packet[IS_LOCAL] = values, float(form == "local_velocity")
    if not all(abs(value) < MAX_VELOCITY for value in values):
        limit = f"velocities must be numbers below {MAX_VELOCITY:g} m/s and rad/s"
        raise Refusal("VELOCITY", f"robot {command.id}: {limit}, not {values}")
    return packet


def decode_packets(packets: Array, is_new: np.ndarray, cycle: int) -> ReceivedCommand:
    """Return what robots hold.

    Args:
        packets: Shape (n, k).
        is_new: Which arrived now, shape (n,).
        cycle: In which robots compare the headings that vision saw with their own.
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


def read_teleport(
    teleport: TeleportRobot, poses: Mapping[RobotName, Array]
) -> tuple[RobotName, Placement | None]:
    """Return which robot is meant, and its pose and twist; None for one that leaves.

    Args:
        teleport: The request.
        poses: Of the robots on the field, shape (3,). Fields that the request lacks are taken from
            there.

    Raises:
        Refusal: There is no such robot, or no such place.
    """
    number, team = teleport.id.id, teleport.id.team
    if (
        not teleport.id.HasField("id")
        or number > MAX_NUMBER
        or team not in (Team.BLUE, Team.YELLOW)
    ):
        raise Refusal(
            "ROBOT_ID", f"a robot has a number from 0 to {MAX_NUMBER} and a team, blue or yellow"
        )
    name = team, number
    if teleport.HasField("present") and not teleport.present:
        return name, None
    if name not in poses and not (
        teleport.present and teleport.HasField("x") and teleport.HasField("y")
    ):
        raise Refusal(
            "ABSENT", f"{label(name)} is not on the field; send present = true with x and y"
        )
    pose, twist = (
        poses.get(name, np.zeros(3)).copy(),
        np.array([teleport.v_x, teleport.v_y, teleport.v_angular]),
    )
    for i, field in enumerate(("x", "y", "orientation")):
        if teleport.HasField(field):
            pose[i] = getattr(teleport, field)
    is_slow = math.hypot(*twist[:2]) <= MAX_SPEED_M_S and abs(twist[2]) <= MAX_RATE_RAD_S
    if not np.isfinite(pose).all() or not is_slow:
        limits = f"velocities up to {MAX_SPEED_M_S:g} m/s and {MAX_RATE_RAD_S:g} rad/s"
        raise Refusal("TELEPORT", f"{label(name)}: places are finite, {limits}")
    pose[2] = wrap_angle(pose[2])
    return name, (pose, twist)


def read_ball(ball: TeleportBall, position: Array) -> Array:
    """Return where the ball shall lie, shape (2,), m, from where it lies.

    Raises:
        Refusal: It is nowhere, or shall move, which it does not here.
    """
    target = np.array(
        [
            ball.x if ball.HasField("x") else position[0],
            ball.y if ball.HasField("y") else position[1],
        ]
    )
    if ball.vx or ball.vy or ball.vz or ball.z or not np.isfinite(target).all():
        raise Refusal("BALL", "the ball lies at a finite place; it neither rolls nor flies here")
    return target
