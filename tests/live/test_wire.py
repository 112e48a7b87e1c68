"""Messages of the league against tables and bytes by hand."""

from benches import wire

# Names, numbers, types and labels are facts of ssl-vision, src/shared/proto, and
# ssl-simulation-protocol, folder proto (commit 65ad614, July 2026). Label (! required, ? optional,
# * repeated), number, type, name.
TABLES = {
    "DetectedBall": "!1 float confidence, ?2 uint32 area, !3 float x, !4 float y, ?5 float z, !6 "
    "float pixel_x, "
    "!7 float pixel_y",
    "DetectedRobot": "!1 float confidence, ?2 uint32 robot_id, !3 float x, !4 float y, ?5 float "
    "orientation, "
    "!6 float pixel_x, !7 float pixel_y, ?8 float height",
    "Detection": "!1 uint32 frame_number, !2 double t_capture, !3 double t_sent, !4 uint32 "
    "camera_id, "
    "*5 DetectedBall balls, *6 DetectedRobot robots_yellow, *7 DetectedRobot robots_blue, ?8 "
    "double t_capture_camera",
    "Point": "!1 float x, !2 float y",
    "FieldLine": "!1 string name, !2 Point p1, !3 Point p2, !4 float thickness, ?5 Shape type",
    "FieldArc": "!1 string name, !2 Point center, !3 float radius, !4 float a1, !5 float a2, !6 "
    "float thickness, "
    "?7 Shape type",
    "FieldSize": "!1 int32 field_length, !2 int32 field_width, !3 int32 goal_width, !4 int32 "
    "goal_depth, "
    "!5 int32 boundary_width, *6 FieldLine field_lines, *7 FieldArc field_arcs, ?8 int32 "
    "penalty_area_depth, "
    "?9 int32 penalty_area_width, ?10 int32 center_circle_radius, ?11 int32 line_thickness, "
    "?12 int32 goal_center_to_penalty_mark, ?13 int32 goal_height, ?14 float ball_radius, ?15 "
    "float max_robot_radius",
    "Calibration": "!1 uint32 camera_id, !2 float focal_length, !3 float principal_point_x, "
    "!4 float principal_point_y, !5 float distortion, !6 float q0, !7 float q1, !8 float q2, !9 "
    "float q3, "
    "!10 float tx, !11 float ty, !12 float tz, ?13 float derived_camera_world_tx, ?14 float "
    "derived_camera_world_ty, "
    "?15 float derived_camera_world_tz, ?16 uint32 pixel_image_width, ?17 uint32 "
    "pixel_image_height",
    "Geometry": "!1 FieldSize field, *2 Calibration calib",
    "VisionPacket": "?1 Detection detection, ?2 Geometry geometry",
    "RobotId": "?1 uint32 id, ?2 Team team",
    "SimulatorError": "?1 string code, ?2 string message",
    "WheelVelocity": "!1 float front_right, !2 float back_right, !3 float back_left, !4 float "
    "front_left",
    "LocalVelocity": "!1 float forward, !2 float left, !3 float angular",
    "GlobalVelocity": "!1 float x, !2 float y, !3 float angular",
    "MoveCommand": "?1 WheelVelocity wheel_velocity, ?2 LocalVelocity local_velocity, "
    "?3 GlobalVelocity global_velocity",
    "RobotCommand": "!1 uint32 id, ?2 MoveCommand move_command, ?3 float kick_speed, ?4 float "
    "kick_angle, "
    "?5 float dribbler_speed",
    "RobotControl": "*1 RobotCommand robot_commands",
    "RobotFeedback": "!1 uint32 id, ?2 bool dribbler_ball_contact",
    "RobotControlResponse": "*1 SimulatorError errors, *2 RobotFeedback feedback",
    "TeleportBall": "?1 float x, ?2 float y, ?3 float z, ?4 float vx, ?5 float vy, ?6 float vz, "
    "?7 bool teleport_safely, ?8 bool roll, ?9 bool by_force",
    "TeleportRobot": "!1 RobotId id, ?2 float x, ?3 float y, ?4 float orientation, ?5 float v_x, "
    "?6 float v_y, "
    "?7 float v_angular, ?8 bool present, ?9 bool by_force",
    "SimulatorControl": "?1 TeleportBall teleport_ball, *2 TeleportRobot teleport_robot, ?3 float "
    "simulation_speed",
    "RobotLimits": "?1 float acc_speedup_absolute_max, ?2 float acc_speedup_angular_max, "
    "?3 float acc_brake_absolute_max, ?4 float acc_brake_angular_max, ?5 float vel_absolute_max, "
    "?6 float vel_angular_max",
    "WheelAngles": "!1 float front_right, !2 float back_right, !3 float back_left, !4 float "
    "front_left",
    "AnyMessage": "?1 bytes type_url, ?2 bytes value",
    "RobotSpecs": "!1 RobotId id, ?2 float radius, ?3 float height, ?4 float mass, ?7 float "
    "max_linear_kick_speed, ?8 float max_chip_kick_speed, ?9 float center_to_dribbler, "
    "?10 RobotLimits limits, ?13 WheelAngles wheel_angles, *14 AnyMessage custom",
    "ErForceRealism": "?2 float stddev_robot_p, ?3 float stddev_robot_phi, ?7 float "
    "camera_overlap, ?10 float robot_command_loss, ?13 int64 vision_delay, ?17 float "
    "missing_robot_detections",
    "RealismConfig": "*1 AnyMessage custom",
    "SimulatorConfig": "?1 Geometry geometry, *2 RobotSpecs robot_specs, ?3 RealismConfig "
    "realism_config, ?4 uint32 vision_port",
    "SimulatorCommand": "?1 SimulatorControl control, ?2 SimulatorConfig config",
    "SimulatorResponse": "*1 SimulatorError errors",
}


def test_messages_have_the_fields_of_the_protocols() -> None:
    assert {name: wire.table(name) for name in wire.MESSAGES} == TABLES
    sizes = {"Shape": 14, "Team": 3}
    assert {name: list(range(size)) for name, size in sizes.items()} == {
        name: sorted(value.number for value in kind.values)
        for name, kind in wire.ENUMERATIONS.items()
    }


def test_bytes_by_hand_are_read_and_written() -> None:
    """(field << 3 | wire type), value. Required zeros are written (for ER-Force)."""
    stand = bytes.fromhex(
        "0a15"
        + "0800"
        + "1211"
        + "120f"
        + "0d"
        + "00000000"
        + "15"
        + "0000c0bf"
        + "1d"
        + "00000000"
    )
    control = wire.read("RobotControl", stand)
    move = control.robot_commands[0].move_command
    assert (move.local_velocity.forward, move.local_velocity.left) == (0.0, -1.5)
    assert control.SerializeToString() == stand


def test_a_message_without_a_required_field_is_refused() -> None:
    """Velocities of a robot without its number; a robot's velocity without its turn rate."""
    assert (
        wire.read(
            "RobotControl",
            bytes.fromhex("0a13" + "1211" + "120f" + "0d00000000150000c0bf1d00000000"),
        )
        is None
    )
    assert (
        wire.read(
            "RobotControl",
            bytes.fromhex("0a10" + "0800" + "120c" + "120a" + "0d00000000150000c0bf"),
        )
        is None
    )
