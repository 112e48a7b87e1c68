"""The league's messages as somebody else's tables, and as classes of protobuf's own runtime: an oracle for our codec.

Names, numbers, kinds and labels are facts of https://github.com/RoboCup-SSL/ssl-vision, src/shared/proto (what a
camera and the field are), and https://github.com/RoboCup-SSL/ssl-simulation-protocol, folder proto, commit 65ad614 of
July 2026. Shares no code with `omni_mj.live.wire`; classes of messages have our names.
"""

from functools import cache
from typing import Any

from google.protobuf.descriptor_pb2 import FieldDescriptorProto, FileDescriptorProto
from google.protobuf.descriptor_pool import DescriptorPool
from google.protobuf.message import Message
from google.protobuf.message_factory import GetMessageClass

ENUMERATIONS = {"Source": range(6), "Shape": range(14), "Team": range(3)}

# Of each field: label (! required, ? optional, | one of, * repeated), number, kind, name. Kinds with /1000 are floats
# and integers in mm, where our messages have m. What a simulator has for itself is bytes to those who look no further.
MESSAGES = {
    "DetectedBall": "!1 float confidence, ?2 uint32 area, !3 float/1000 x, !4 float/1000 y, ?5 float/1000 z, "
    "!6 float pixel_x, !7 float pixel_y",
    "DetectedRobot": "!1 float confidence, ?2 uint32 robot_id, !3 float/1000 x, !4 float/1000 y, ?5 float orientation, "
    "!6 float pixel_x, !7 float pixel_y, ?8 float/1000 height",
    "Detection": "!1 uint32 frame_number, !2 double t_capture, !3 double t_sent, !4 uint32 camera_id, "
    "*5 DetectedBall balls, *6 DetectedRobot robots_yellow, *7 DetectedRobot robots_blue, "
    "?8 double t_capture_camera",
    "Point": "!1 float/1000 x, !2 float/1000 y",
    "FieldLine": "!1 string name, !2 Point p1, !3 Point p2, !4 float/1000 thickness, ?5 Shape type",
    "FieldArc": "!1 string name, !2 Point center, !3 float/1000 radius, !4 float a1, !5 float a2, "
    "!6 float/1000 thickness, ?7 Shape type",
    "FieldSize": "!1 int32/1000 field_length, !2 int32/1000 field_width, !3 int32/1000 goal_width, "
    "!4 int32/1000 goal_depth, !5 int32/1000 boundary_width, *6 FieldLine field_lines, "
    "*7 FieldArc field_arcs, ?8 int32/1000 penalty_area_depth, ?9 int32/1000 penalty_area_width, "
    "?10 int32/1000 center_circle_radius, ?11 int32/1000 line_thickness, "
    "?12 int32/1000 goal_center_to_penalty_mark, ?13 int32/1000 goal_height, ?14 float/1000 ball_radius, "
    "?15 float/1000 max_robot_radius",
    "Calibration": "!1 uint32 camera_id, !2 float focal_length, !3 float principal_point_x, "
    "!4 float principal_point_y, "
    "!5 float distortion, !6 float q0, !7 float q1, !8 float q2, !9 float q3, !10 float/1000 tx, "
    "!11 float/1000 ty, !12 float/1000 tz, ?13 float/1000 derived_camera_world_tx, "
    "?14 float/1000 derived_camera_world_ty, ?15 float/1000 derived_camera_world_tz, "
    "?16 uint32 pixel_image_width, ?17 uint32 pixel_image_height",
    "StraightKick": "!1 double acc_slide, !2 double acc_roll, !3 double k_switch",
    "ChipKick": "!1 double damping_xy_first_hop, !2 double damping_xy_other_hops, !3 double damping_z",
    "BallModels": "?1 StraightKick straight_two_phase, ?2 ChipKick chip_fixed_loss",
    "Geometry": "!1 FieldSize field, *2 Calibration calib, ?3 BallModels models",
    "VisionPacket": "?1 Detection detection, ?2 Geometry geometry, ?3 Source source",
    "RobotId": "?1 uint32 id, ?2 Team team",
    "SimulatorError": "?1 string code, ?2 string message",
    "WheelVelocity": "!1 float front_right, !2 float back_right, !3 float back_left, !4 float front_left",
    "LocalVelocity": "!1 float forward, !2 float left, !3 float angular",
    "GlobalVelocity": "!1 float x, !2 float y, !3 float angular",
    "MoveCommand": "|1 WheelVelocity wheel_velocity, |2 LocalVelocity local_velocity, "
    "|3 GlobalVelocity global_velocity",
    "RobotCommand": "!1 uint32 id, ?2 MoveCommand move_command, ?3 float kick_speed, ?4 float kick_angle, "
    "?5 float dribbler_speed",
    "RobotControl": "*1 RobotCommand robot_commands",
    "RobotFeedback": "!1 uint32 id, ?2 bool dribbler_ball_contact, ?3 bytes custom",
    "RobotControlResponse": "*1 SimulatorError errors, *2 RobotFeedback feedback",
    "TeleportBall": "?1 float x, ?2 float y, ?3 float z, ?4 float vx, ?5 float vy, ?6 float vz, "
    "?7 bool teleport_safely, "
    "?8 bool roll, ?9 bool by_force",
    "TeleportRobot": "!1 RobotId id, ?2 float x, ?3 float y, ?4 float orientation, ?5 float v_x, ?6 float v_y, "
    "?7 float v_angular, ?8 bool present, ?9 bool by_force",
    "SimulatorControl": "?1 TeleportBall teleport_ball, *2 TeleportRobot teleport_robot, ?3 float simulation_speed",
    "RobotLimits": "?1 float acc_speedup_absolute_max, ?2 float acc_speedup_angular_max, "
    "?3 float acc_brake_absolute_max, ?4 float acc_brake_angular_max, ?5 float vel_absolute_max, "
    "?6 float vel_angular_max",
    "WheelAngles": "!1 float front_right, !2 float back_right, !3 float back_left, !4 float front_left",
    "RobotSpecs": "!1 RobotId id, ?2 float radius, ?3 float height, ?4 float mass, ?7 float max_linear_kick_speed, "
    "?8 float max_chip_kick_speed, ?9 float center_to_dribbler, ?10 RobotLimits limits, "
    "?13 WheelAngles wheel_angles, *14 bytes custom",
    "SimulatorConfig": "?1 Geometry geometry, *2 RobotSpecs robot_specs, ?3 bytes realism_config, "
    "?4 uint32 vision_port",
    "SimulatorCommand": "?1 SimulatorControl control, ?2 SimulatorConfig config",
    "SimulatorResponse": "*1 SimulatorError errors",
    "SyncRequest": "?1 float sim_step, ?2 SimulatorCommand simulator_command, ?3 RobotControl robot_control",
    "SyncResponse": "*1 Detection detection, ?2 RobotControlResponse robot_control_response",
}

EXTRA = ", ?900 int64 later_a, ?901 bytes later_b, ?902 double later_c, ?903 fixed32 later_d, ?904 RobotId later_e"

Row = tuple[str, int, str, float, str]  # label, number, kind, what is sent over what is meant, name


@cache
def rows(message: str) -> tuple[Row, ...]:
    """The table of a message."""
    found = []
    for row in (MESSAGES[message] + EXTRA).split(", "):
        number, kind, name = row[1:].split()
        kind, _, scale = kind.partition("/")
        found.append((row[0], int(number), kind, float(scale or 1), name))
    return tuple(found)


@cache
def _pool() -> DescriptorPool:
    """All messages, in a pool of their own; `EXTRA` stands for what later versions may add."""
    file = FileDescriptorProto(name="league.proto", package="league", syntax="proto2")
    for name, numbers in ENUMERATIONS.items():
        enumeration = file.enum_type.add(name=name)
        for number in numbers:
            enumeration.value.add(name=f"{name}_{number}", number=number)
    for name in MESSAGES:
        message = file.message_type.add(name=name)
        for label, number, kind, _, field in rows(name):
            added = message.field.add(name=field, number=number)
            word = {"!": "REQUIRED", "*": "REPEATED"}.get(label, "OPTIONAL")
            added.label = FieldDescriptorProto.Label.Value(f"LABEL_{word}")
            if kind in MESSAGES or kind in ENUMERATIONS:
                what = "MESSAGE" if kind in MESSAGES else "ENUM"
                added.type_name = f".league.{kind}"
            else:
                what = kind.upper()
            added.type = FieldDescriptorProto.Type.Value(f"TYPE_{what}")
            if label == "|":
                if not message.oneof_decl:
                    message.oneof_decl.add(name="command")
                added.oneof_index = 0
    pool = DescriptorPool()
    pool.AddSerializedFile(file.SerializeToString())
    return pool


@cache
def message_class(name: str) -> type[Message]:
    """protobuf's class of a message."""
    return GetMessageClass(_pool().FindMessageTypeByName(f"league.{name}"))


def filled(message: tuple[Any, ...]) -> Message:
    """One of our messages as protobuf's."""
    made = message_class(type(message).__name__)()
    _fill(made, message)
    return made


def _fill(made: Message, message: tuple[Any, ...]) -> None:
    for label, _, kind, scale, name in rows(type(message).__name__):
        value = getattr(message, name, None)
        if label == "*":
            for each in value or ():
                _fill(getattr(made, name).add(), each)
        elif value is not None and kind in MESSAGES:
            getattr(made, name).SetInParent()
            _fill(getattr(made, name), value)
        elif value is not None:
            setattr(made, name, round(value * scale) if kind == "int32" else value if scale == 1 else value * scale)


def values(made: Message) -> dict[str, Any]:
    """What a message of protobuf says, in our units; what is not there is None."""
    found: dict[str, Any] = {}
    for label, _, kind, scale, name in rows(made.DESCRIPTOR.name):
        value = getattr(made, name)
        if label == "*":
            found[name] = [values(each) if kind in MESSAGES else each for each in value]
        elif not made.HasField(name):
            found[name] = None
        elif kind in MESSAGES:
            found[name] = values(value)
        else:
            found[name] = value if scale == 1 else value / scale
    return found


def extend(made: Message, number: int, data: bytes) -> None:
    """Give a message, and all that it holds, what later versions may add; and a group, which protobuf only keeps."""
    for field, value in made.ListFields():
        if field.message_type is not None:
            for each in [value] if isinstance(value, Message) else value:
                extend(each, number, data)
    made.later_a, made.later_b, made.later_c, made.later_d = number, data, float(number), number & 0xFFFF_FFFF
    made.later_e.SetInParent()
    made.MergeFromString(b"\xbb\x3e\x08\x01\x13\x14\xbc\x3e")  # group 999: a number and a group
