from google.protobuf.internal import containers as _containers
from google.protobuf.internal import enum_type_wrapper as _enum_type_wrapper
from google.protobuf import descriptor as _descriptor
from google.protobuf import message as _message
from collections.abc import Iterable as _Iterable, Mapping as _Mapping
from typing import ClassVar as _ClassVar, Optional as _Optional, Union as _Union

DESCRIPTOR: _descriptor.FileDescriptor

class Shape(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    UNDEFINED: _ClassVar[Shape]
    CENTER_CIRCLE: _ClassVar[Shape]
    TOP_TOUCH_LINE: _ClassVar[Shape]
    BOTTOM_TOUCH_LINE: _ClassVar[Shape]
    LEFT_GOAL_LINE: _ClassVar[Shape]
    RIGHT_GOAL_LINE: _ClassVar[Shape]
    HALFWAY_LINE: _ClassVar[Shape]
    CENTER_LINE: _ClassVar[Shape]
    LEFT_PENALTY_STRETCH: _ClassVar[Shape]
    RIGHT_PENALTY_STRETCH: _ClassVar[Shape]
    LEFT_FIELD_LEFT_PENALTY_STRETCH: _ClassVar[Shape]
    LEFT_FIELD_RIGHT_PENALTY_STRETCH: _ClassVar[Shape]
    RIGHT_FIELD_LEFT_PENALTY_STRETCH: _ClassVar[Shape]
    RIGHT_FIELD_RIGHT_PENALTY_STRETCH: _ClassVar[Shape]

class Team(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    UNKNOWN: _ClassVar[Team]
    YELLOW: _ClassVar[Team]
    BLUE: _ClassVar[Team]
UNDEFINED: Shape
CENTER_CIRCLE: Shape
TOP_TOUCH_LINE: Shape
BOTTOM_TOUCH_LINE: Shape
LEFT_GOAL_LINE: Shape
RIGHT_GOAL_LINE: Shape
HALFWAY_LINE: Shape
CENTER_LINE: Shape
LEFT_PENALTY_STRETCH: Shape
RIGHT_PENALTY_STRETCH: Shape
LEFT_FIELD_LEFT_PENALTY_STRETCH: Shape
LEFT_FIELD_RIGHT_PENALTY_STRETCH: Shape
RIGHT_FIELD_LEFT_PENALTY_STRETCH: Shape
RIGHT_FIELD_RIGHT_PENALTY_STRETCH: Shape
UNKNOWN: Team
YELLOW: Team
BLUE: Team

class DetectedBall(_message.Message):
    __slots__ = ("confidence", "area", "x", "y", "z", "pixel_x", "pixel_y")
    CONFIDENCE_FIELD_NUMBER: _ClassVar[int]
    AREA_FIELD_NUMBER: _ClassVar[int]
    X_FIELD_NUMBER: _ClassVar[int]
    Y_FIELD_NUMBER: _ClassVar[int]
    Z_FIELD_NUMBER: _ClassVar[int]
    PIXEL_X_FIELD_NUMBER: _ClassVar[int]
    PIXEL_Y_FIELD_NUMBER: _ClassVar[int]
    confidence: float
    area: int
    x: float
    y: float
    z: float
    pixel_x: float
    pixel_y: float
    def __init__(self, confidence: _Optional[float] = ..., area: _Optional[int] = ..., x: _Optional[float] = ..., y: _Optional[float] = ..., z: _Optional[float] = ..., pixel_x: _Optional[float] = ..., pixel_y: _Optional[float] = ...) -> None: ...

class DetectedRobot(_message.Message):
    __slots__ = ("confidence", "robot_id", "x", "y", "orientation", "pixel_x", "pixel_y", "height")
    CONFIDENCE_FIELD_NUMBER: _ClassVar[int]
    ROBOT_ID_FIELD_NUMBER: _ClassVar[int]
    X_FIELD_NUMBER: _ClassVar[int]
    Y_FIELD_NUMBER: _ClassVar[int]
    ORIENTATION_FIELD_NUMBER: _ClassVar[int]
    PIXEL_X_FIELD_NUMBER: _ClassVar[int]
    PIXEL_Y_FIELD_NUMBER: _ClassVar[int]
    HEIGHT_FIELD_NUMBER: _ClassVar[int]
    confidence: float
    robot_id: int
    x: float
    y: float
    orientation: float
    pixel_x: float
    pixel_y: float
    height: float
    def __init__(self, confidence: _Optional[float] = ..., robot_id: _Optional[int] = ..., x: _Optional[float] = ..., y: _Optional[float] = ..., orientation: _Optional[float] = ..., pixel_x: _Optional[float] = ..., pixel_y: _Optional[float] = ..., height: _Optional[float] = ...) -> None: ...

class Detection(_message.Message):
    __slots__ = ("frame_number", "t_capture", "t_sent", "camera_id", "balls", "robots_yellow", "robots_blue", "t_capture_camera")
    FRAME_NUMBER_FIELD_NUMBER: _ClassVar[int]
    T_CAPTURE_FIELD_NUMBER: _ClassVar[int]
    T_SENT_FIELD_NUMBER: _ClassVar[int]
    CAMERA_ID_FIELD_NUMBER: _ClassVar[int]
    BALLS_FIELD_NUMBER: _ClassVar[int]
    ROBOTS_YELLOW_FIELD_NUMBER: _ClassVar[int]
    ROBOTS_BLUE_FIELD_NUMBER: _ClassVar[int]
    T_CAPTURE_CAMERA_FIELD_NUMBER: _ClassVar[int]
    frame_number: int
    t_capture: float
    t_sent: float
    camera_id: int
    balls: _containers.RepeatedCompositeFieldContainer[DetectedBall]
    robots_yellow: _containers.RepeatedCompositeFieldContainer[DetectedRobot]
    robots_blue: _containers.RepeatedCompositeFieldContainer[DetectedRobot]
    t_capture_camera: float
    def __init__(self, frame_number: _Optional[int] = ..., t_capture: _Optional[float] = ..., t_sent: _Optional[float] = ..., camera_id: _Optional[int] = ..., balls: _Optional[_Iterable[_Union[DetectedBall, _Mapping]]] = ..., robots_yellow: _Optional[_Iterable[_Union[DetectedRobot, _Mapping]]] = ..., robots_blue: _Optional[_Iterable[_Union[DetectedRobot, _Mapping]]] = ..., t_capture_camera: _Optional[float] = ...) -> None: ...

class Point(_message.Message):
    __slots__ = ("x", "y")
    X_FIELD_NUMBER: _ClassVar[int]
    Y_FIELD_NUMBER: _ClassVar[int]
    x: float
    y: float
    def __init__(self, x: _Optional[float] = ..., y: _Optional[float] = ...) -> None: ...

class FieldLine(_message.Message):
    __slots__ = ("name", "p1", "p2", "thickness", "type")
    NAME_FIELD_NUMBER: _ClassVar[int]
    P1_FIELD_NUMBER: _ClassVar[int]
    P2_FIELD_NUMBER: _ClassVar[int]
    THICKNESS_FIELD_NUMBER: _ClassVar[int]
    TYPE_FIELD_NUMBER: _ClassVar[int]
    name: str
    p1: Point
    p2: Point
    thickness: float
    type: Shape
    def __init__(self, name: _Optional[str] = ..., p1: _Optional[_Union[Point, _Mapping]] = ..., p2: _Optional[_Union[Point, _Mapping]] = ..., thickness: _Optional[float] = ..., type: _Optional[_Union[Shape, str]] = ...) -> None: ...

class FieldArc(_message.Message):
    __slots__ = ("name", "center", "radius", "a1", "a2", "thickness", "type")
    NAME_FIELD_NUMBER: _ClassVar[int]
    CENTER_FIELD_NUMBER: _ClassVar[int]
    RADIUS_FIELD_NUMBER: _ClassVar[int]
    A1_FIELD_NUMBER: _ClassVar[int]
    A2_FIELD_NUMBER: _ClassVar[int]
    THICKNESS_FIELD_NUMBER: _ClassVar[int]
    TYPE_FIELD_NUMBER: _ClassVar[int]
    name: str
    center: Point
    radius: float
    a1: float
    a2: float
    thickness: float
    type: Shape
    def __init__(self, name: _Optional[str] = ..., center: _Optional[_Union[Point, _Mapping]] = ..., radius: _Optional[float] = ..., a1: _Optional[float] = ..., a2: _Optional[float] = ..., thickness: _Optional[float] = ..., type: _Optional[_Union[Shape, str]] = ...) -> None: ...

class FieldSize(_message.Message):
    __slots__ = ("field_length", "field_width", "goal_width", "goal_depth", "boundary_width", "field_lines", "field_arcs", "penalty_area_depth", "penalty_area_width", "center_circle_radius", "line_thickness", "goal_center_to_penalty_mark", "goal_height", "ball_radius", "max_robot_radius")
    FIELD_LENGTH_FIELD_NUMBER: _ClassVar[int]
    FIELD_WIDTH_FIELD_NUMBER: _ClassVar[int]
    GOAL_WIDTH_FIELD_NUMBER: _ClassVar[int]
    GOAL_DEPTH_FIELD_NUMBER: _ClassVar[int]
    BOUNDARY_WIDTH_FIELD_NUMBER: _ClassVar[int]
    FIELD_LINES_FIELD_NUMBER: _ClassVar[int]
    FIELD_ARCS_FIELD_NUMBER: _ClassVar[int]
    PENALTY_AREA_DEPTH_FIELD_NUMBER: _ClassVar[int]
    PENALTY_AREA_WIDTH_FIELD_NUMBER: _ClassVar[int]
    CENTER_CIRCLE_RADIUS_FIELD_NUMBER: _ClassVar[int]
    LINE_THICKNESS_FIELD_NUMBER: _ClassVar[int]
    GOAL_CENTER_TO_PENALTY_MARK_FIELD_NUMBER: _ClassVar[int]
    GOAL_HEIGHT_FIELD_NUMBER: _ClassVar[int]
    BALL_RADIUS_FIELD_NUMBER: _ClassVar[int]
    MAX_ROBOT_RADIUS_FIELD_NUMBER: _ClassVar[int]
    field_length: int
    field_width: int
    goal_width: int
    goal_depth: int
    boundary_width: int
    field_lines: _containers.RepeatedCompositeFieldContainer[FieldLine]
    field_arcs: _containers.RepeatedCompositeFieldContainer[FieldArc]
    penalty_area_depth: int
    penalty_area_width: int
    center_circle_radius: int
    line_thickness: int
    goal_center_to_penalty_mark: int
    goal_height: int
    ball_radius: float
    max_robot_radius: float
    def __init__(self, field_length: _Optional[int] = ..., field_width: _Optional[int] = ..., goal_width: _Optional[int] = ..., goal_depth: _Optional[int] = ..., boundary_width: _Optional[int] = ..., field_lines: _Optional[_Iterable[_Union[FieldLine, _Mapping]]] = ..., field_arcs: _Optional[_Iterable[_Union[FieldArc, _Mapping]]] = ..., penalty_area_depth: _Optional[int] = ..., penalty_area_width: _Optional[int] = ..., center_circle_radius: _Optional[int] = ..., line_thickness: _Optional[int] = ..., goal_center_to_penalty_mark: _Optional[int] = ..., goal_height: _Optional[int] = ..., ball_radius: _Optional[float] = ..., max_robot_radius: _Optional[float] = ...) -> None: ...

class Calibration(_message.Message):
    __slots__ = ("camera_id", "focal_length", "principal_point_x", "principal_point_y", "distortion", "q0", "q1", "q2", "q3", "tx", "ty", "tz", "derived_camera_world_tx", "derived_camera_world_ty", "derived_camera_world_tz", "pixel_image_width", "pixel_image_height")
    CAMERA_ID_FIELD_NUMBER: _ClassVar[int]
    FOCAL_LENGTH_FIELD_NUMBER: _ClassVar[int]
    PRINCIPAL_POINT_X_FIELD_NUMBER: _ClassVar[int]
    PRINCIPAL_POINT_Y_FIELD_NUMBER: _ClassVar[int]
    DISTORTION_FIELD_NUMBER: _ClassVar[int]
    Q0_FIELD_NUMBER: _ClassVar[int]
    Q1_FIELD_NUMBER: _ClassVar[int]
    Q2_FIELD_NUMBER: _ClassVar[int]
    Q3_FIELD_NUMBER: _ClassVar[int]
    TX_FIELD_NUMBER: _ClassVar[int]
    TY_FIELD_NUMBER: _ClassVar[int]
    TZ_FIELD_NUMBER: _ClassVar[int]
    DERIVED_CAMERA_WORLD_TX_FIELD_NUMBER: _ClassVar[int]
    DERIVED_CAMERA_WORLD_TY_FIELD_NUMBER: _ClassVar[int]
    DERIVED_CAMERA_WORLD_TZ_FIELD_NUMBER: _ClassVar[int]
    PIXEL_IMAGE_WIDTH_FIELD_NUMBER: _ClassVar[int]
    PIXEL_IMAGE_HEIGHT_FIELD_NUMBER: _ClassVar[int]
    camera_id: int
    focal_length: float
    principal_point_x: float
    principal_point_y: float
    distortion: float
    q0: float
    q1: float
    q2: float
    q3: float
    tx: float
    ty: float
    tz: float
    derived_camera_world_tx: float
    derived_camera_world_ty: float
    derived_camera_world_tz: float
    pixel_image_width: int
    pixel_image_height: int
    def __init__(self, camera_id: _Optional[int] = ..., focal_length: _Optional[float] = ..., principal_point_x: _Optional[float] = ..., principal_point_y: _Optional[float] = ..., distortion: _Optional[float] = ..., q0: _Optional[float] = ..., q1: _Optional[float] = ..., q2: _Optional[float] = ..., q3: _Optional[float] = ..., tx: _Optional[float] = ..., ty: _Optional[float] = ..., tz: _Optional[float] = ..., derived_camera_world_tx: _Optional[float] = ..., derived_camera_world_ty: _Optional[float] = ..., derived_camera_world_tz: _Optional[float] = ..., pixel_image_width: _Optional[int] = ..., pixel_image_height: _Optional[int] = ...) -> None: ...

class Geometry(_message.Message):
    __slots__ = ("field", "calib")
    FIELD_FIELD_NUMBER: _ClassVar[int]
    CALIB_FIELD_NUMBER: _ClassVar[int]
    field: FieldSize
    calib: _containers.RepeatedCompositeFieldContainer[Calibration]
    def __init__(self, field: _Optional[_Union[FieldSize, _Mapping]] = ..., calib: _Optional[_Iterable[_Union[Calibration, _Mapping]]] = ...) -> None: ...

class VisionPacket(_message.Message):
    __slots__ = ("detection", "geometry")
    DETECTION_FIELD_NUMBER: _ClassVar[int]
    GEOMETRY_FIELD_NUMBER: _ClassVar[int]
    detection: Detection
    geometry: Geometry
    def __init__(self, detection: _Optional[_Union[Detection, _Mapping]] = ..., geometry: _Optional[_Union[Geometry, _Mapping]] = ...) -> None: ...

class RobotId(_message.Message):
    __slots__ = ("id", "team")
    ID_FIELD_NUMBER: _ClassVar[int]
    TEAM_FIELD_NUMBER: _ClassVar[int]
    id: int
    team: Team
    def __init__(self, id: _Optional[int] = ..., team: _Optional[_Union[Team, str]] = ...) -> None: ...

class SimulatorError(_message.Message):
    __slots__ = ("code", "message")
    CODE_FIELD_NUMBER: _ClassVar[int]
    MESSAGE_FIELD_NUMBER: _ClassVar[int]
    code: str
    message: str
    def __init__(self, code: _Optional[str] = ..., message: _Optional[str] = ...) -> None: ...

class WheelVelocity(_message.Message):
    __slots__ = ("front_right", "back_right", "back_left", "front_left")
    FRONT_RIGHT_FIELD_NUMBER: _ClassVar[int]
    BACK_RIGHT_FIELD_NUMBER: _ClassVar[int]
    BACK_LEFT_FIELD_NUMBER: _ClassVar[int]
    FRONT_LEFT_FIELD_NUMBER: _ClassVar[int]
    front_right: float
    back_right: float
    back_left: float
    front_left: float
    def __init__(self, front_right: _Optional[float] = ..., back_right: _Optional[float] = ..., back_left: _Optional[float] = ..., front_left: _Optional[float] = ...) -> None: ...

class LocalVelocity(_message.Message):
    __slots__ = ("forward", "left", "angular")
    FORWARD_FIELD_NUMBER: _ClassVar[int]
    LEFT_FIELD_NUMBER: _ClassVar[int]
    ANGULAR_FIELD_NUMBER: _ClassVar[int]
    forward: float
    left: float
    angular: float
    def __init__(self, forward: _Optional[float] = ..., left: _Optional[float] = ..., angular: _Optional[float] = ...) -> None: ...

class GlobalVelocity(_message.Message):
    __slots__ = ("x", "y", "angular")
    X_FIELD_NUMBER: _ClassVar[int]
    Y_FIELD_NUMBER: _ClassVar[int]
    ANGULAR_FIELD_NUMBER: _ClassVar[int]
    x: float
    y: float
    angular: float
    def __init__(self, x: _Optional[float] = ..., y: _Optional[float] = ..., angular: _Optional[float] = ...) -> None: ...

class MoveCommand(_message.Message):
    __slots__ = ("wheel_velocity", "local_velocity", "global_velocity")
    WHEEL_VELOCITY_FIELD_NUMBER: _ClassVar[int]
    LOCAL_VELOCITY_FIELD_NUMBER: _ClassVar[int]
    GLOBAL_VELOCITY_FIELD_NUMBER: _ClassVar[int]
    wheel_velocity: WheelVelocity
    local_velocity: LocalVelocity
    global_velocity: GlobalVelocity
    def __init__(self, wheel_velocity: _Optional[_Union[WheelVelocity, _Mapping]] = ..., local_velocity: _Optional[_Union[LocalVelocity, _Mapping]] = ..., global_velocity: _Optional[_Union[GlobalVelocity, _Mapping]] = ...) -> None: ...

class RobotCommand(_message.Message):
    __slots__ = ("id", "move_command", "kick_speed", "kick_angle", "dribbler_speed")
    ID_FIELD_NUMBER: _ClassVar[int]
    MOVE_COMMAND_FIELD_NUMBER: _ClassVar[int]
    KICK_SPEED_FIELD_NUMBER: _ClassVar[int]
    KICK_ANGLE_FIELD_NUMBER: _ClassVar[int]
    DRIBBLER_SPEED_FIELD_NUMBER: _ClassVar[int]
    id: int
    move_command: MoveCommand
    kick_speed: float
    kick_angle: float
    dribbler_speed: float
    def __init__(self, id: _Optional[int] = ..., move_command: _Optional[_Union[MoveCommand, _Mapping]] = ..., kick_speed: _Optional[float] = ..., kick_angle: _Optional[float] = ..., dribbler_speed: _Optional[float] = ...) -> None: ...

class RobotControl(_message.Message):
    __slots__ = ("robot_commands",)
    ROBOT_COMMANDS_FIELD_NUMBER: _ClassVar[int]
    robot_commands: _containers.RepeatedCompositeFieldContainer[RobotCommand]
    def __init__(self, robot_commands: _Optional[_Iterable[_Union[RobotCommand, _Mapping]]] = ...) -> None: ...

class RobotFeedback(_message.Message):
    __slots__ = ("id", "dribbler_ball_contact")
    ID_FIELD_NUMBER: _ClassVar[int]
    DRIBBLER_BALL_CONTACT_FIELD_NUMBER: _ClassVar[int]
    id: int
    dribbler_ball_contact: bool
    def __init__(self, id: _Optional[int] = ..., dribbler_ball_contact: _Optional[bool] = ...) -> None: ...

class RobotControlResponse(_message.Message):
    __slots__ = ("errors", "feedback")
    ERRORS_FIELD_NUMBER: _ClassVar[int]
    FEEDBACK_FIELD_NUMBER: _ClassVar[int]
    errors: _containers.RepeatedCompositeFieldContainer[SimulatorError]
    feedback: _containers.RepeatedCompositeFieldContainer[RobotFeedback]
    def __init__(self, errors: _Optional[_Iterable[_Union[SimulatorError, _Mapping]]] = ..., feedback: _Optional[_Iterable[_Union[RobotFeedback, _Mapping]]] = ...) -> None: ...

class TeleportBall(_message.Message):
    __slots__ = ("x", "y", "z", "vx", "vy", "vz", "teleport_safely", "roll", "by_force")
    X_FIELD_NUMBER: _ClassVar[int]
    Y_FIELD_NUMBER: _ClassVar[int]
    Z_FIELD_NUMBER: _ClassVar[int]
    VX_FIELD_NUMBER: _ClassVar[int]
    VY_FIELD_NUMBER: _ClassVar[int]
    VZ_FIELD_NUMBER: _ClassVar[int]
    TELEPORT_SAFELY_FIELD_NUMBER: _ClassVar[int]
    ROLL_FIELD_NUMBER: _ClassVar[int]
    BY_FORCE_FIELD_NUMBER: _ClassVar[int]
    x: float
    y: float
    z: float
    vx: float
    vy: float
    vz: float
    teleport_safely: bool
    roll: bool
    by_force: bool
    def __init__(self, x: _Optional[float] = ..., y: _Optional[float] = ..., z: _Optional[float] = ..., vx: _Optional[float] = ..., vy: _Optional[float] = ..., vz: _Optional[float] = ..., teleport_safely: _Optional[bool] = ..., roll: _Optional[bool] = ..., by_force: _Optional[bool] = ...) -> None: ...

class TeleportRobot(_message.Message):
    __slots__ = ("id", "x", "y", "orientation", "v_x", "v_y", "v_angular", "present", "by_force")
    ID_FIELD_NUMBER: _ClassVar[int]
    X_FIELD_NUMBER: _ClassVar[int]
    Y_FIELD_NUMBER: _ClassVar[int]
    ORIENTATION_FIELD_NUMBER: _ClassVar[int]
    V_X_FIELD_NUMBER: _ClassVar[int]
    V_Y_FIELD_NUMBER: _ClassVar[int]
    V_ANGULAR_FIELD_NUMBER: _ClassVar[int]
    PRESENT_FIELD_NUMBER: _ClassVar[int]
    BY_FORCE_FIELD_NUMBER: _ClassVar[int]
    id: RobotId
    x: float
    y: float
    orientation: float
    v_x: float
    v_y: float
    v_angular: float
    present: bool
    by_force: bool
    def __init__(self, id: _Optional[_Union[RobotId, _Mapping]] = ..., x: _Optional[float] = ..., y: _Optional[float] = ..., orientation: _Optional[float] = ..., v_x: _Optional[float] = ..., v_y: _Optional[float] = ..., v_angular: _Optional[float] = ..., present: _Optional[bool] = ..., by_force: _Optional[bool] = ...) -> None: ...

class SimulatorControl(_message.Message):
    __slots__ = ("teleport_ball", "teleport_robot", "simulation_speed")
    TELEPORT_BALL_FIELD_NUMBER: _ClassVar[int]
    TELEPORT_ROBOT_FIELD_NUMBER: _ClassVar[int]
    SIMULATION_SPEED_FIELD_NUMBER: _ClassVar[int]
    teleport_ball: TeleportBall
    teleport_robot: _containers.RepeatedCompositeFieldContainer[TeleportRobot]
    simulation_speed: float
    def __init__(self, teleport_ball: _Optional[_Union[TeleportBall, _Mapping]] = ..., teleport_robot: _Optional[_Iterable[_Union[TeleportRobot, _Mapping]]] = ..., simulation_speed: _Optional[float] = ...) -> None: ...

class RobotLimits(_message.Message):
    __slots__ = ("acc_speedup_absolute_max", "acc_speedup_angular_max", "acc_brake_absolute_max", "acc_brake_angular_max", "vel_absolute_max", "vel_angular_max")
    ACC_SPEEDUP_ABSOLUTE_MAX_FIELD_NUMBER: _ClassVar[int]
    ACC_SPEEDUP_ANGULAR_MAX_FIELD_NUMBER: _ClassVar[int]
    ACC_BRAKE_ABSOLUTE_MAX_FIELD_NUMBER: _ClassVar[int]
    ACC_BRAKE_ANGULAR_MAX_FIELD_NUMBER: _ClassVar[int]
    VEL_ABSOLUTE_MAX_FIELD_NUMBER: _ClassVar[int]
    VEL_ANGULAR_MAX_FIELD_NUMBER: _ClassVar[int]
    acc_speedup_absolute_max: float
    acc_speedup_angular_max: float
    acc_brake_absolute_max: float
    acc_brake_angular_max: float
    vel_absolute_max: float
    vel_angular_max: float
    def __init__(self, acc_speedup_absolute_max: _Optional[float] = ..., acc_speedup_angular_max: _Optional[float] = ..., acc_brake_absolute_max: _Optional[float] = ..., acc_brake_angular_max: _Optional[float] = ..., vel_absolute_max: _Optional[float] = ..., vel_angular_max: _Optional[float] = ...) -> None: ...

class WheelAngles(_message.Message):
    __slots__ = ("front_right", "back_right", "back_left", "front_left")
    FRONT_RIGHT_FIELD_NUMBER: _ClassVar[int]
    BACK_RIGHT_FIELD_NUMBER: _ClassVar[int]
    BACK_LEFT_FIELD_NUMBER: _ClassVar[int]
    FRONT_LEFT_FIELD_NUMBER: _ClassVar[int]
    front_right: float
    back_right: float
    back_left: float
    front_left: float
    def __init__(self, front_right: _Optional[float] = ..., back_right: _Optional[float] = ..., back_left: _Optional[float] = ..., front_left: _Optional[float] = ...) -> None: ...

class AnyMessage(_message.Message):
    __slots__ = ("type_url", "value")
    TYPE_URL_FIELD_NUMBER: _ClassVar[int]
    VALUE_FIELD_NUMBER: _ClassVar[int]
    type_url: bytes
    value: bytes
    def __init__(self, type_url: _Optional[bytes] = ..., value: _Optional[bytes] = ...) -> None: ...

class RobotSpecs(_message.Message):
    __slots__ = ("id", "radius", "height", "mass", "max_linear_kick_speed", "max_chip_kick_speed", "center_to_dribbler", "limits", "wheel_angles", "custom")
    ID_FIELD_NUMBER: _ClassVar[int]
    RADIUS_FIELD_NUMBER: _ClassVar[int]
    HEIGHT_FIELD_NUMBER: _ClassVar[int]
    MASS_FIELD_NUMBER: _ClassVar[int]
    MAX_LINEAR_KICK_SPEED_FIELD_NUMBER: _ClassVar[int]
    MAX_CHIP_KICK_SPEED_FIELD_NUMBER: _ClassVar[int]
    CENTER_TO_DRIBBLER_FIELD_NUMBER: _ClassVar[int]
    LIMITS_FIELD_NUMBER: _ClassVar[int]
    WHEEL_ANGLES_FIELD_NUMBER: _ClassVar[int]
    CUSTOM_FIELD_NUMBER: _ClassVar[int]
    id: RobotId
    radius: float
    height: float
    mass: float
    max_linear_kick_speed: float
    max_chip_kick_speed: float
    center_to_dribbler: float
    limits: RobotLimits
    wheel_angles: WheelAngles
    custom: _containers.RepeatedCompositeFieldContainer[AnyMessage]
    def __init__(self, id: _Optional[_Union[RobotId, _Mapping]] = ..., radius: _Optional[float] = ..., height: _Optional[float] = ..., mass: _Optional[float] = ..., max_linear_kick_speed: _Optional[float] = ..., max_chip_kick_speed: _Optional[float] = ..., center_to_dribbler: _Optional[float] = ..., limits: _Optional[_Union[RobotLimits, _Mapping]] = ..., wheel_angles: _Optional[_Union[WheelAngles, _Mapping]] = ..., custom: _Optional[_Iterable[_Union[AnyMessage, _Mapping]]] = ...) -> None: ...

class ErForceRealism(_message.Message):
    __slots__ = ("stddev_robot_p", "stddev_robot_phi", "camera_overlap", "robot_command_loss", "vision_delay", "missing_robot_detections")
    STDDEV_ROBOT_P_FIELD_NUMBER: _ClassVar[int]
    STDDEV_ROBOT_PHI_FIELD_NUMBER: _ClassVar[int]
    CAMERA_OVERLAP_FIELD_NUMBER: _ClassVar[int]
    ROBOT_COMMAND_LOSS_FIELD_NUMBER: _ClassVar[int]
    VISION_DELAY_FIELD_NUMBER: _ClassVar[int]
    MISSING_ROBOT_DETECTIONS_FIELD_NUMBER: _ClassVar[int]
    stddev_robot_p: float
    stddev_robot_phi: float
    camera_overlap: float
    robot_command_loss: float
    vision_delay: int
    missing_robot_detections: float
    def __init__(self, stddev_robot_p: _Optional[float] = ..., stddev_robot_phi: _Optional[float] = ..., camera_overlap: _Optional[float] = ..., robot_command_loss: _Optional[float] = ..., vision_delay: _Optional[int] = ..., missing_robot_detections: _Optional[float] = ...) -> None: ...

class RealismConfig(_message.Message):
    __slots__ = ("custom",)
    CUSTOM_FIELD_NUMBER: _ClassVar[int]
    custom: _containers.RepeatedCompositeFieldContainer[AnyMessage]
    def __init__(self, custom: _Optional[_Iterable[_Union[AnyMessage, _Mapping]]] = ...) -> None: ...

class SimulatorConfig(_message.Message):
    __slots__ = ("geometry", "robot_specs", "realism_config", "vision_port")
    GEOMETRY_FIELD_NUMBER: _ClassVar[int]
    ROBOT_SPECS_FIELD_NUMBER: _ClassVar[int]
    REALISM_CONFIG_FIELD_NUMBER: _ClassVar[int]
    VISION_PORT_FIELD_NUMBER: _ClassVar[int]
    geometry: Geometry
    robot_specs: _containers.RepeatedCompositeFieldContainer[RobotSpecs]
    realism_config: RealismConfig
    vision_port: int
    def __init__(self, geometry: _Optional[_Union[Geometry, _Mapping]] = ..., robot_specs: _Optional[_Iterable[_Union[RobotSpecs, _Mapping]]] = ..., realism_config: _Optional[_Union[RealismConfig, _Mapping]] = ..., vision_port: _Optional[int] = ...) -> None: ...

class SimulatorCommand(_message.Message):
    __slots__ = ("control", "config")
    CONTROL_FIELD_NUMBER: _ClassVar[int]
    CONFIG_FIELD_NUMBER: _ClassVar[int]
    control: SimulatorControl
    config: SimulatorConfig
    def __init__(self, control: _Optional[_Union[SimulatorControl, _Mapping]] = ..., config: _Optional[_Union[SimulatorConfig, _Mapping]] = ...) -> None: ...

class SimulatorResponse(_message.Message):
    __slots__ = ("errors",)
    ERRORS_FIELD_NUMBER: _ClassVar[int]
    errors: _containers.RepeatedCompositeFieldContainer[SimulatorError]
    def __init__(self, errors: _Optional[_Iterable[_Union[SimulatorError, _Mapping]]] = ...) -> None: ...
