"""Cameras of `serve`: SSL-Vision messages with detections and the field geometry.

Each camera takes images by its own clock and covers part of the field.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from omni_control.kinematics import Array
from omni_mj.config import CYCLE_RATE_HZ, CYCLES_PER_FRAME
from omni_mj.config.rows import Row
from omni_mj.config.world_settings import WorldSettings
from omni_mj.live.wire import MM_PER_M
from omni_mj.live.wire.league_pb2 import Calibration, Detection, FieldSize, Point, Shape, Team
from omni_mj.mjcf import field
from omni_mj.network.camera import Camera, ImageTiming
from omni_mj.network.camera_calibration import CAMERA_GRIDS, SEED_OFFSET, CameraErrors
from omni_mj.network.random_streams import Noise, Seed, Stream

BALL_RADIUS_M = 0.0215
CAMERA_HEIGHT_M = 4.0
IMAGE_SIZE = np.array([1920, 1200])  # pixels

RobotName = tuple[int, int]  # team (a value of `Team`) and number


class Image(NamedTuple):
    """An image of one camera.

    Attributes:
        sent_s: Simulated time at which it is sent, s; infinite if it is lost.
        cycle: Cycle in which it was taken.
        names: Names of the n robots.
        poses: Measured poses, shape (n, 3); NaN for robots that the camera does not detect.
        detection: The SSL-Vision message.
    """

    sent_s: float
    cycle: int
    names: Sequence[RobotName]
    poses: Array
    detection: Detection


class FieldCamera:
    """One camera above the field.

    The first camera takes images at 0, 1/rate, ..., with the noise of `run`. Each other camera has
    a random phase and its own noise. A camera covers one cell of a grid over the carpet, and a
    strip of the neighboring cells.

    Args:
        number: Number of the camera, from 0. Cameras are numbered along x, then along y, from the
            lowest coordinates.
        rows: One per robot. The first row has the settings of the camera itself.

    Attributes:
        due: Cycle in which the next image is taken.
    """

    def __init__(self, number: int, rows: Sequence[Row]) -> None:
        self._number, self._frame = number, 0
        self._seeds: list[Seed] = [(rows[0].seed, SEED_OFFSET + number)]
        self.set_robots(rows, 0)
        clock = Noise(self._seeds, Stream.CAMERA_CLOCK, 4, "standard_normal")
        *_, clock_offset, phase = clock.next()[0].tolist()
        self._errors = CameraErrors([rows[0].settings], self._seeds)
        self._clock_offset_s = self._vision.clock_offset_s * clock_offset
        # The fraction of a widely scaled normal number is uniformly distributed.
        self._phase_s = 0.0 if number == 0 else phase * 1e3 % 1.0 / self._vision.rate_hz
        self.due = self._cycle_of(0)

    def set_robots(self, rows: Sequence[Row], cycle: int) -> None:
        """Observe other robots from a cycle on; times of faults are relative to this cycle.

        The size of the field may be another one.
        """
        settings = rows[0].settings
        self._first_cycle, self._vision = cycle, settings.vision
        carpet_size = np.array(settings.world.carpet_size_m)
        grid = CAMERA_GRIDS[self._vision.cameras]
        cell_size = carpet_size / grid
        cell_y, cell_x = divmod(self._number, grid[0])
        self._center = cell_size * (cell_x + 0.5, cell_y + 0.5) - carpet_size / 2
        self._half_size = (cell_size + self._vision.overlap_m) / 2
        self._timing = ImageTiming([settings], self._seeds, [rows[0].faults])
        seeds = [
            row.noise_seed if self._number == 0 else (*row.noise_seed, SEED_OFFSET + self._number)
            for row in rows
        ]
        self._camera = Camera(
            [row.settings for row in rows],
            seeds,
            [row.faults for row in rows],
            self._number,
        )

    def take_image(
        self, cycle: int, names: Sequence[RobotName], poses: Array, ball: Array, epoch_s: float
    ) -> Image:
        """Take the image that is due.

        Args:
            cycle: Number of the cycle.
            names: Names of the n robots.
            poses: True poses, shape (n, 3); NaN for robots that are not on the field.
            ball: Position, shape (2,), m.
            epoch_s: Time of a correct clock at simulated time 0, s.
        """
        begun_s, elapsed = self._first_cycle / CYCLE_RATE_HZ, cycle - self._first_cycle
        frame, elapsed_s = elapsed // CYCLES_PER_FRAME, elapsed / CYCLE_RATE_HZ
        measured = self._camera(poses, frame)
        measured[~self._covers(poses[:, :2])] = np.nan
        (arrival_s,), (clock_lag_s,) = self._timing.schedule_arrival(frame, elapsed_s)
        sent_s = begun_s + float(arrival_s)
        epoch_s += self._clock_offset_s - clock_lag_s
        detection = Detection(
            frame_number=self._frame,
            t_capture=epoch_s + cycle / CYCLE_RATE_HZ,
            t_sent=epoch_s + sent_s,
            camera_id=self._number,
        )
        if self._covers(ball[None])[0]:
            x, y = MM_PER_M * (ball + self._errors(ball[None], self._number)[0])
            detection.balls.add(confidence=1.0, x=x, y=y, pixel_x=0.0, pixel_y=0.0)
        for (team, number), (x, y, heading) in sorted(zip(names, measured.tolist(), strict=True)):
            if not math.isnan(x):
                robots = detection.robots_blue if team == Team.BLUE else detection.robots_yellow
                robots.add(
                    confidence=1.0,
                    robot_id=number,
                    x=MM_PER_M * x,
                    y=MM_PER_M * y,
                    orientation=heading,
                    pixel_x=0.0,
                    pixel_y=0.0,
                    height=MM_PER_M * field.ROBOT_HEIGHT_M,  # of the pattern above the carpet
                )
        self._frame += 1
        self.due = self._cycle_of(self._frame)
        return Image(sent_s, cycle, tuple(names), measured, detection)

    def calibration(self) -> Calibration:
        """Return the calibration: the camera looks straight down, without distortion."""
        (x, y), z = MM_PER_M * self._center, MM_PER_M * CAMERA_HEIGHT_M
        width, height = IMAGE_SIZE
        return Calibration(
            camera_id=self._number,
            focal_length=CAMERA_HEIGHT_M * np.min(IMAGE_SIZE / (2 * self._half_size)),
            principal_point_x=width / 2,
            principal_point_y=height / 2,
            distortion=0.0,
            q0=1.0,
            q1=0.0,
            q2=0.0,
            q3=0.0,
            tx=-x,
            ty=y,
            tz=z,
            derived_camera_world_tx=x,
            derived_camera_world_ty=y,
            derived_camera_world_tz=z,
            pixel_image_width=width,
            pixel_image_height=height,
        )

    def _covers(self, points: Array) -> np.ndarray:
        """Return whether each point, shape (n, 2), is in the camera's field of view."""
        return np.asarray((np.abs(points - self._center) <= self._half_size).all(1))

    def _cycle_of(self, frame: int) -> int:
        """Return the first cycle at or after the time of an image."""
        return math.ceil((frame / self._vision.rate_hz + self._phase_s) * CYCLE_RATE_HZ - 1e-6)


def describe_field(world: WorldSettings) -> FieldSize:
    """Return the message with the geometry of a field and its lines."""
    division = field.get_division(world)
    lengths_m = {
        "field_length": world.field_length_m,
        "field_width": world.field_width_m,
        "goal_width": division.goal_width,
        "goal_depth": field.GOAL_DEPTH_M,
        "goal_height": field.GOAL_HEIGHT_M,
        "boundary_width": world.field_margin_m,
        "penalty_area_depth": division.penalty_area_depth,
        "penalty_area_width": division.penalty_area_width,
        "center_circle_radius": field.CENTER_CIRCLE_RADIUS_M,
        "line_thickness": field.LINE_WIDTH_M,
    }
    size = FieldSize(
        ball_radius=MM_PER_M * BALL_RADIUS_M, max_robot_radius=MM_PER_M * field.ROBOT_RADIUS_M
    )
    for name, value in lengths_m.items():
        setattr(size, name, round(MM_PER_M * value))
    for shape, ends in field.get_field_lines(world).items():
        x1, y1, x2, y2 = (MM_PER_M * end for end in ends)
        size.field_lines.add(
            name=shape.title().replace("_", ""),
            p1=Point(x=x1, y=y1),
            p2=Point(x=x2, y=y2),
            thickness=size.line_thickness,
            type=shape,
        )
    size.field_arcs.add(
        name="CenterCircle",
        center=Point(x=0, y=0),
        radius=size.center_circle_radius,
        a1=0.0,
        a2=2 * math.pi,
        thickness=size.line_thickness,
        type=Shape.CENTER_CIRCLE,
    )
    return size
