"""What the simulator is told at its control port: teleports, presence, speed, geometry."""

import math
from dataclasses import dataclass, field

import numpy as np

from omni_control.errors import OmniError
from omni_control.kinematics import wrap_angle
from omni_mj.live.serve.cameras import Name
from omni_mj.live.serve.commands import Refusal
from omni_mj.live.serve.pitch import Pitch, label
from omni_mj.live.wire import encode
from omni_mj.live.wire.simulation import (
    SimulatorCommand,
    SimulatorConfig,
    SimulatorControl,
    Team,
    TeleportBall,
    TeleportRobot,
)
from omni_mj.live.wire.vision import VisionPacket

FASTEST_TIMES = 1000.0  # as real time
FASTEST_M_S, FASTEST_RAD_S = 20.0, 100.0  # at which a robot is put down
FARTHEST_M = 100.0  # from the field's centre
HIGHEST = 15  # number of a robot: there are as many patterns
_PLACES = {"x", "y", "orientation"}
_MOTION = {"v_x", "v_y", "v_angular"}


@dataclass
class Wishes:
    """What a command asks of the server itself, and what of it all is refused.

    Attributes:
        speed: times as fast as real time, or None for as before.
        vision_port: where detections go, or None for as before.
        geometry: whether it is another.
        refused: each with its reason.
    """

    speed: float | None = None
    vision_port: int | None = None
    geometry: bool = False
    refused: list[Refusal] = field(default_factory=list)


def obey(pitch: Pitch, command: SimulatorCommand) -> Wishes:
    """Do what can be done on the pitch; say what remains, and what cannot be done."""
    wishes = Wishes()
    if command.config is not None:
        _configure(pitch, command.config, wishes)
    if command.control is not None:
        _control(pitch, command.control, wishes)
    return wishes


def _configure(pitch: Pitch, config: SimulatorConfig, wishes: Wishes) -> None:
    if config.geometry is not None:
        try:
            encode(VisionPacket(geometry=config.geometry))  # it will be sent on
            pitch.resize(config.geometry.field)
            wishes.geometry = True
        except OmniError as error:
            wishes.refused.append(Refusal("GEOMETRY", str(error)))
    if config.robot_specs:
        text = "robots are those of their files: start serve with --robot and --set to have others"
        wishes.refused.append(Refusal("ROBOT_SPECS", text))
    if config.realism_config is not None:
        text = "realism is a scenario's: start serve with --scenario and --set to have another"
        wishes.refused.append(Refusal("REALISM", text))
    if config.vision_port is not None:
        if 0 < config.vision_port < 65_536:
            wishes.vision_port = config.vision_port
        else:
            wishes.refused.append(Refusal("VISION_PORT", f"ports are 1 to 65535, not {config.vision_port}"))


def _control(pitch: Pitch, control: SimulatorControl, wishes: Wishes) -> None:
    if control.teleport_ball is not None:
        _ball(pitch, control.teleport_ball, wishes)
    wanted, leaving = dict[Name, tuple[np.ndarray, np.ndarray]](), set[Name]()
    for teleport in control.teleport_robot:
        if (name := _name(teleport, wishes)) is None:
            continue
        if teleport.present is False:
            leaving.add(name)
            wanted.pop(name, None)
        elif isinstance(put := _put(pitch, name, teleport), Refusal):
            wishes.refused.append(put)
        elif put is not None:
            leaving.discard(name)
            wanted[name] = put
    if wanted or leaving:
        wishes.refused += pitch.place(wanted, leaving)
    if control.simulation_speed is not None:
        if 0 <= control.simulation_speed <= FASTEST_TIMES:
            wishes.speed = control.simulation_speed
        else:
            text = f"a simulation goes 0 to {FASTEST_TIMES:g} times as fast as time, not {control.simulation_speed:g}"
            wishes.refused.append(Refusal("SPEED", text))


def _ball(pitch: Pitch, ball: TeleportBall, wishes: Wishes) -> None:
    """Put the ball somewhere; it lies there, whatever velocity it is given."""
    before = (0.0, 0.0) if pitch.ball is None else pitch.ball
    place = [old if new is None else new for new, old in zip((ball.x, ball.y), before, strict=True)]
    if not (np.abs(place) <= FARTHEST_M).all():
        wishes.refused.append(Refusal("BALL", f"the ball lies within {FARTHEST_M:g} m, not at {tuple(place)}"))
        return
    pitch.ball = np.array(place)
    if any((ball.vx, ball.vy, ball.vz, ball.z)):
        wishes.refused.append(Refusal("BALL_LIES", "the ball lies where it is put; it neither rolls nor flies here"))


def _name(teleport: TeleportRobot, wishes: Wishes) -> Name | None:
    number, team = teleport.id
    if number is None or number > HIGHEST or team not in (Team.BLUE, Team.YELLOW):
        text = f"a robot has a number from 0 to {HIGHEST} and a team, blue or yellow"
        wishes.refused.append(Refusal("ROBOT_ID", text))
        return None
    return team, number


def _put(pitch: Pitch, name: Name, teleport: TeleportRobot) -> tuple[np.ndarray, np.ndarray] | Refusal | None:
    """Pose and twist that a robot shall have; None if it stays as it is."""
    if teleport.by_force:
        return Refusal("BY_FORCE", f"{label(name)}: robots are put down at once, not pushed; leave by_force out")
    given = {key for key, value in teleport._asdict().items() if value is not None}
    pose = pitch.pose(name)
    if pose is None and not teleport.present:
        return Refusal("ABSENT", f"{label(name)} is not on the field; send present = true with x, y and orientation")
    if pose is None and not {"x", "y"} <= given:
        return Refusal("NOWHERE", f"{label(name)} comes to the field: send x and y")
    if pose is not None and not given & (_PLACES | _MOTION):
        return None
    before = np.zeros(3) if pose is None else pose
    wanted = (teleport.x, teleport.y, teleport.orientation)
    place = np.array([old if new is None else new for new, old in zip(wanted, before, strict=True)])
    twist = np.array([value or 0.0 for value in (teleport.v_x, teleport.v_y, teleport.v_angular)])
    if not np.isfinite(place).all() or not math.hypot(*twist[:2]) <= FASTEST_M_S or not abs(twist[2]) <= FASTEST_RAD_S:
        return Refusal(
            "TELEPORT",
            f"{label(name)}: places are finite, velocities up to {FASTEST_M_S:g} m/s and {FASTEST_RAD_S:g} rad/s",
        )
    place[2] = wrap_angle(place[2])
    return place, twist
