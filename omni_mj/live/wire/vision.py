"""What SSL-Vision sends to a multicast group: detections of each camera, now and then the geometry.

Lengths are in m and angles in rad here, lengths in mm on the wire. The numbers and kinds of the fields are those of
https://github.com/RoboCup-SSL/ssl-vision, src/shared/proto; what is not here (models of the ball) is skipped.
"""

from enum import IntEnum
from typing import Annotated, NamedTuple

from omni_mj.live.wire.format import optional, repeated, required
from omni_mj.live.wire.kinds import DOUBLE, FLOAT, MILLIMETRES, TEXT, UINT32, WHOLE_MILLIMETRES

VISION_GROUP = "224.5.23.2"
VISION_PORT = 10006
SIMULATED_VISION_PORT = 10020


class Source(IntEnum):
    """Who says that he sent a packet."""

    UNKNOWN = 0
    OTHER = 1
    SSL_VISION = 2
    VISION_PROCESSOR = 3
    GRSIM = 4
    ERFORCE_SIM = 5


class Shape(IntEnum):
    """What a line or arc of the field is."""

    UNDEFINED = 0
    CENTRE_CIRCLE = 1
    TOP_TOUCH_LINE = 2
    BOTTOM_TOUCH_LINE = 3
    LEFT_GOAL_LINE = 4
    RIGHT_GOAL_LINE = 5
    HALFWAY_LINE = 6
    CENTRE_LINE = 7
    LEFT_PENALTY_STRETCH = 8
    RIGHT_PENALTY_STRETCH = 9
    LEFT_FIELD_LEFT_PENALTY_STRETCH = 10
    LEFT_FIELD_RIGHT_PENALTY_STRETCH = 11
    RIGHT_FIELD_LEFT_PENALTY_STRETCH = 12
    RIGHT_FIELD_RIGHT_PENALTY_STRETCH = 13


class DetectedBall(NamedTuple):
    """A ball: confidence from 0 to 1, area in pixels, place in m, place in the image in pixels."""

    x: Annotated[float, required(3, MILLIMETRES)]
    y: Annotated[float, required(4, MILLIMETRES)]
    z: Annotated[float | None, optional(5, MILLIMETRES)] = None
    confidence: Annotated[float, required(1, FLOAT)] = 1.0
    area: Annotated[int | None, optional(2, UINT32)] = None
    pixel_x: Annotated[float, required(6, FLOAT)] = 0.0
    pixel_y: Annotated[float, required(7, FLOAT)] = 0.0


class DetectedRobot(NamedTuple):
    """A robot: its number, place in m, heading in rad counter-clockwise from x; pixels; its pattern's height in m."""

    robot_id: Annotated[int | None, optional(2, UINT32)]
    x: Annotated[float, required(3, MILLIMETRES)]
    y: Annotated[float, required(4, MILLIMETRES)]
    orientation: Annotated[float | None, optional(5, FLOAT)] = None
    confidence: Annotated[float, required(1, FLOAT)] = 1.0
    pixel_x: Annotated[float, required(6, FLOAT)] = 0.0
    pixel_y: Annotated[float, required(7, FLOAT)] = 0.0
    height: Annotated[float | None, optional(8, MILLIMETRES)] = None


class Detection(NamedTuple):
    """What a camera saw in an image; times in s of the sender's clock, that of the camera of a clock of its own."""

    frame_number: Annotated[int, required(1, UINT32)]
    t_capture: Annotated[float, required(2, DOUBLE)]
    t_sent: Annotated[float, required(3, DOUBLE)]
    camera_id: Annotated[int, required(4, UINT32)]
    balls: Annotated[tuple[DetectedBall, ...], repeated(5, DetectedBall)] = ()
    robots_yellow: Annotated[tuple[DetectedRobot, ...], repeated(6, DetectedRobot)] = ()
    robots_blue: Annotated[tuple[DetectedRobot, ...], repeated(7, DetectedRobot)] = ()
    t_capture_camera: Annotated[float | None, optional(8, DOUBLE)] = None


class Point(NamedTuple):
    """A place on the field, m."""

    x: Annotated[float, required(1, MILLIMETRES)]
    y: Annotated[float, required(2, MILLIMETRES)]


class FieldLine(NamedTuple):
    """A marking from p1 to p2 along its middle, with its thickness; m."""

    name: Annotated[str, required(1, TEXT)]
    p1: Annotated[Point, required(2, Point)]
    p2: Annotated[Point, required(3, Point)]
    thickness: Annotated[float, required(4, MILLIMETRES)]
    type: Annotated[Shape | None, optional(5, Shape)] = None


class FieldArc(NamedTuple):
    """A marking around a centre from angle a1 to a2, counter-clockwise; m, rad."""

    name: Annotated[str, required(1, TEXT)]
    center: Annotated[Point, required(2, Point)]
    radius: Annotated[float, required(3, MILLIMETRES)]
    a1: Annotated[float, required(4, FLOAT)]
    a2: Annotated[float, required(5, FLOAT)]
    thickness: Annotated[float, required(6, MILLIMETRES)]
    type: Annotated[Shape | None, optional(7, Shape)] = None


class FieldSize(NamedTuple):
    """The field: lengths in m, in whole mm on the wire; between the middles of lines, up to the walls."""

    field_length: Annotated[float, required(1, WHOLE_MILLIMETRES)]
    field_width: Annotated[float, required(2, WHOLE_MILLIMETRES)]
    goal_width: Annotated[float, required(3, WHOLE_MILLIMETRES)]
    goal_depth: Annotated[float, required(4, WHOLE_MILLIMETRES)]
    boundary_width: Annotated[float, required(5, WHOLE_MILLIMETRES)]
    field_lines: Annotated[tuple[FieldLine, ...], repeated(6, FieldLine)] = ()
    field_arcs: Annotated[tuple[FieldArc, ...], repeated(7, FieldArc)] = ()
    penalty_area_depth: Annotated[float | None, optional(8, WHOLE_MILLIMETRES)] = None
    penalty_area_width: Annotated[float | None, optional(9, WHOLE_MILLIMETRES)] = None
    center_circle_radius: Annotated[float | None, optional(10, WHOLE_MILLIMETRES)] = None
    line_thickness: Annotated[float | None, optional(11, WHOLE_MILLIMETRES)] = None
    goal_center_to_penalty_mark: Annotated[float | None, optional(12, WHOLE_MILLIMETRES)] = None
    goal_height: Annotated[float | None, optional(13, WHOLE_MILLIMETRES)] = None
    ball_radius: Annotated[float | None, optional(14, MILLIMETRES)] = None
    max_robot_radius: Annotated[float | None, optional(15, MILLIMETRES)] = None


class Calibration(NamedTuple):
    """A camera: focal length, principal point and image in pixels; rotation as a quaternion x, y, z, w; places in m."""

    camera_id: Annotated[int, required(1, UINT32)]
    focal_length: Annotated[float, required(2, FLOAT)]
    principal_point_x: Annotated[float, required(3, FLOAT)]
    principal_point_y: Annotated[float, required(4, FLOAT)]
    distortion: Annotated[float, required(5, FLOAT)]
    q0: Annotated[float, required(6, FLOAT)]
    q1: Annotated[float, required(7, FLOAT)]
    q2: Annotated[float, required(8, FLOAT)]
    q3: Annotated[float, required(9, FLOAT)]
    tx: Annotated[float, required(10, MILLIMETRES)]
    ty: Annotated[float, required(11, MILLIMETRES)]
    tz: Annotated[float, required(12, MILLIMETRES)]
    derived_camera_world_tx: Annotated[float | None, optional(13, MILLIMETRES)] = None
    derived_camera_world_ty: Annotated[float | None, optional(14, MILLIMETRES)] = None
    derived_camera_world_tz: Annotated[float | None, optional(15, MILLIMETRES)] = None
    pixel_image_width: Annotated[int | None, optional(16, UINT32)] = None
    pixel_image_height: Annotated[int | None, optional(17, UINT32)] = None


class Geometry(NamedTuple):
    """The field and the cameras above it."""

    field: Annotated[FieldSize, required(1, FieldSize)]
    calib: Annotated[tuple[Calibration, ...], repeated(2, Calibration)] = ()


class VisionPacket(NamedTuple):
    """A datagram of SSL-Vision."""

    detection: Annotated[Detection | None, optional(1, Detection)] = None
    geometry: Annotated[Geometry | None, optional(2, Geometry)] = None
    source: Annotated[Source | None, optional(3, Source)] = None
