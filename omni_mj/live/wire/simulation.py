"""What ssl-simulation-protocol has: commands to a simulator and to its robots, and what they answer.

All in m, m/s, rad and rad/s, but for the geometry (mm on the wire) and the kick's angle, which is only passed on
(degrees). The numbers and kinds of the fields are those of https://github.com/RoboCup-SSL/ssl-simulation-protocol,
folder proto. What a simulator has for itself alone is carried as bytes, or skipped (of robots' specs).
"""

from enum import IntEnum
from typing import Annotated, NamedTuple

from omni_mj.live.wire.format import one_of, optional, repeated, required
from omni_mj.live.wire.kinds import BOOL, BYTES, FLOAT, TEXT, UINT32
from omni_mj.live.wire.vision import Detection, Geometry

SIMULATOR_PORT = 10300
BLUE_PORT = 10301
YELLOW_PORT = 10302


class Team(IntEnum):
    """Whose robot."""

    UNKNOWN = 0
    YELLOW = 1
    BLUE = 2


class RobotId(NamedTuple):
    """A robot's number and team."""

    id: Annotated[int | None, optional(1, UINT32)] = None
    team: Annotated[Team | None, optional(2, Team)] = None


class SimulatorError(NamedTuple):
    """Why a simulator did not do as it was told: a code for programs, a message for people."""

    code: Annotated[str | None, optional(1, TEXT)] = None
    message: Annotated[str | None, optional(2, TEXT)] = None


class WheelVelocity(NamedTuple):
    """Speeds of the wheels' rims, m/s."""

    front_right: Annotated[float, required(1, FLOAT)]
    back_right: Annotated[float, required(2, FLOAT)]
    back_left: Annotated[float, required(3, FLOAT)]
    front_left: Annotated[float, required(4, FLOAT)]


class LocalVelocity(NamedTuple):
    """In the robot's own frame: m/s forward and to the left, rad/s counter-clockwise."""

    forward: Annotated[float, required(1, FLOAT)]
    left: Annotated[float, required(2, FLOAT)]
    angular: Annotated[float, required(3, FLOAT)]


class GlobalVelocity(NamedTuple):
    """In the frame of the field: m/s along x and y, rad/s counter-clockwise."""

    x: Annotated[float, required(1, FLOAT)]
    y: Annotated[float, required(2, FLOAT)]
    angular: Annotated[float, required(3, FLOAT)]


class MoveCommand(NamedTuple):
    """One way of telling a robot how fast to move."""

    wheel_velocity: Annotated[WheelVelocity | None, one_of(1, WheelVelocity)] = None
    local_velocity: Annotated[LocalVelocity | None, one_of(2, LocalVelocity)] = None
    global_velocity: Annotated[GlobalVelocity | None, one_of(3, GlobalVelocity)] = None


class RobotCommand(NamedTuple):
    """What one robot is to do; kick in m/s and degrees above the floor, dribbler in revolutions per minute."""

    id: Annotated[int, required(1, UINT32)]
    move_command: Annotated[MoveCommand | None, optional(2, MoveCommand)] = None
    kick_speed: Annotated[float | None, optional(3, FLOAT)] = None
    kick_angle: Annotated[float | None, optional(4, FLOAT)] = None
    dribbler_speed: Annotated[float | None, optional(5, FLOAT)] = None


class RobotControl(NamedTuple):
    """A datagram to a team's robots, at that team's port."""

    robot_commands: Annotated[tuple[RobotCommand, ...], repeated(1, RobotCommand)] = ()


class RobotFeedback(NamedTuple):
    """What a robot says of itself; its number alone, as in its command: the port says which team's."""

    id: Annotated[int, required(1, UINT32)]
    dribbler_ball_contact: Annotated[bool | None, optional(2, BOOL)] = None
    custom: Annotated[bytes | None, optional(3, BYTES)] = None


class RobotControlResponse(NamedTuple):
    """The answer to `RobotControl`."""

    errors: Annotated[tuple[SimulatorError, ...], repeated(1, SimulatorError)] = ()
    feedback: Annotated[tuple[RobotFeedback, ...], repeated(2, RobotFeedback)] = ()


class TeleportBall(NamedTuple):
    """Put the ball somewhere, with a velocity; what is None stays as it is. m, m/s."""

    x: Annotated[float | None, optional(1, FLOAT)] = None
    y: Annotated[float | None, optional(2, FLOAT)] = None
    z: Annotated[float | None, optional(3, FLOAT)] = None
    vx: Annotated[float | None, optional(4, FLOAT)] = None
    vy: Annotated[float | None, optional(5, FLOAT)] = None
    vz: Annotated[float | None, optional(6, FLOAT)] = None
    teleport_safely: Annotated[bool | None, optional(7, BOOL)] = None
    roll: Annotated[bool | None, optional(8, BOOL)] = None
    by_force: Annotated[bool | None, optional(9, BOOL)] = None


class TeleportRobot(NamedTuple):
    """Put a robot somewhere, with a velocity in the field's frame; add or remove it. m, rad, m/s, rad/s."""

    id: Annotated[RobotId, required(1, RobotId)]
    x: Annotated[float | None, optional(2, FLOAT)] = None
    y: Annotated[float | None, optional(3, FLOAT)] = None
    orientation: Annotated[float | None, optional(4, FLOAT)] = None
    v_x: Annotated[float | None, optional(5, FLOAT)] = None
    v_y: Annotated[float | None, optional(6, FLOAT)] = None
    v_angular: Annotated[float | None, optional(7, FLOAT)] = None
    present: Annotated[bool | None, optional(8, BOOL)] = None
    by_force: Annotated[bool | None, optional(9, BOOL)] = None


class SimulatorControl(NamedTuple):
    """Move things by hand; how many times as fast as real time the simulation goes."""

    teleport_ball: Annotated[TeleportBall | None, optional(1, TeleportBall)] = None
    teleport_robot: Annotated[tuple[TeleportRobot, ...], repeated(2, TeleportRobot)] = ()
    simulation_speed: Annotated[float | None, optional(3, FLOAT)] = None


class RobotLimits(NamedTuple):
    """The most a robot can do, m/s^2, rad/s^2, m/s, rad/s."""

    acc_speedup_absolute_max: Annotated[float | None, optional(1, FLOAT)] = None
    acc_speedup_angular_max: Annotated[float | None, optional(2, FLOAT)] = None
    acc_brake_absolute_max: Annotated[float | None, optional(3, FLOAT)] = None
    acc_brake_angular_max: Annotated[float | None, optional(4, FLOAT)] = None
    vel_absolute_max: Annotated[float | None, optional(5, FLOAT)] = None
    vel_angular_max: Annotated[float | None, optional(6, FLOAT)] = None


class WheelAngles(NamedTuple):
    """Where the wheels are, rad clockwise from forward."""

    front_right: Annotated[float, required(1, FLOAT)]
    back_right: Annotated[float, required(2, FLOAT)]
    back_left: Annotated[float, required(3, FLOAT)]
    front_left: Annotated[float, required(4, FLOAT)]


class RobotSpecs(NamedTuple):
    """What a robot is like: m, kg, m/s."""

    id: Annotated[RobotId, required(1, RobotId)]
    radius: Annotated[float | None, optional(2, FLOAT)] = None
    height: Annotated[float | None, optional(3, FLOAT)] = None
    mass: Annotated[float | None, optional(4, FLOAT)] = None
    max_linear_kick_speed: Annotated[float | None, optional(7, FLOAT)] = None
    max_chip_kick_speed: Annotated[float | None, optional(8, FLOAT)] = None
    center_to_dribbler: Annotated[float | None, optional(9, FLOAT)] = None
    limits: Annotated[RobotLimits | None, optional(10, RobotLimits)] = None
    wheel_angles: Annotated[WheelAngles | None, optional(13, WheelAngles)] = None


class SimulatorConfig(NamedTuple):
    """What the simulated world is like, and where its vision is sent."""

    geometry: Annotated[Geometry | None, optional(1, Geometry)] = None
    robot_specs: Annotated[tuple[RobotSpecs, ...], repeated(2, RobotSpecs)] = ()
    realism_config: Annotated[bytes | None, optional(3, BYTES)] = None
    vision_port: Annotated[int | None, optional(4, UINT32)] = None


class SimulatorCommand(NamedTuple):
    """A datagram to the simulator."""

    control: Annotated[SimulatorControl | None, optional(1, SimulatorControl)] = None
    config: Annotated[SimulatorConfig | None, optional(2, SimulatorConfig)] = None


class SimulatorResponse(NamedTuple):
    """The answer to `SimulatorCommand`."""

    errors: Annotated[tuple[SimulatorError, ...], repeated(1, SimulatorError)] = ()


class SyncRequest(NamedTuple):
    """A step of so many s of a simulation that waits for its client, and what to do before it."""

    sim_step: Annotated[float | None, optional(1, FLOAT)] = None
    simulator_command: Annotated[SimulatorCommand | None, optional(2, SimulatorCommand)] = None
    robot_control: Annotated[RobotControl | None, optional(3, RobotControl)] = None


class SyncResponse(NamedTuple):
    """What all cameras see after the step."""

    detection: Annotated[tuple[Detection, ...], repeated(1, Detection)] = ()
    robot_control_response: Annotated[RobotControlResponse | None, optional(2, RobotControlResponse)] = None
