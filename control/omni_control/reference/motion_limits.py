"""Limits of motions and commands: velocity, acceleration and jerk (section 3-A of the paper).

The highest accelerations forward and sideways differ (section 3-A: "not the same because of the
robot's structure"). In between, the limit is an ellipse in the body's axes. In stretched
coordinates the ellipse is a circle, and one limit holds for all directions: see
`MotionLimits.to_isotropic`.
"""

import math
from dataclasses import dataclass, replace

import numpy as np

from omni_control.arguments import check_types, explain_types, fits_annotation
from omni_control.errors import OmniError
from omni_control.kinematics import Array
from omni_control.traction_limits import WheelLimits


@explain_types
@check_types
@dataclass(frozen=True)
class MotionLimits:
    """Limits of a reference or of commands.

    The default speed and acceleration are those of the paper's reference (section 2), and the
    limits of turning are chosen to match. The last four limits apply to references only.

    Args:
        speed: Highest speed in any direction, m/s.
        acceleration: Highest acceleration while speeding up, braking or in curves, m/s^2.
        turn_rate: Highest turn rate, rad/s.
        turn_acceleration: Highest turn acceleration, rad/s^2.
        side_acceleration: Highest acceleration along the body's y axis, m/s^2; `acceleration` is
            then the highest along its x axis, with an ellipse in between. Default: the same in all
            directions.
        jerk: Highest rate of change of the acceleration vector in the world frame, m/s^3. Default:
            not limited.
        turn_jerk: Highest rate of change of the turn acceleration, rad/s^3. Default: not limited.
        wheels: Combined limits of the wheels. Default: none.

    Raises:
        OmniError: A limit is not a positive number.
    """

    speed: float = 3.159
    acceleration: float = 0.826
    turn_rate: float = 6.0
    turn_acceleration: float = 12.0
    side_acceleration: float | None = None
    jerk: float | None = None
    turn_jerk: float | None = None
    wheels: WheelLimits | None = None

    def __post_init__(self) -> None:
        """Check the limits."""
        for name, value in vars(self).items():
            if fits_annotation(value, float) and not 0 < value < np.inf:
                raise OmniError(f"MotionLimits.{name} must be a positive number, got {value}")

    @property
    def acceleration_ratio(self) -> float:
        """Highest acceleration forward over that sideways."""
        return 1.0 if self.side_acceleration is None else self.acceleration / self.side_acceleration

    def to_isotropic(self, vector: Array, heading: Array) -> Array:
        """Return accelerations in coordinates in which `acceleration` limits their norm.

        These are the body's axes with y stretched. With one limit for all directions the vectors
        are returned unchanged.

        Args:
            vector: Accelerations (n, 2), world frame.
            heading: Headings of the robots, (n,) rad.
        """
        if self.acceleration_ratio == 1:
            return vector
        c, s = np.cos(heading), np.sin(heading)
        x, y = vector[:, 0], vector[:, 1]
        return np.stack([c * x + s * y, self.acceleration_ratio * (c * y - s * x)], axis=1)

    def compute_time_scale(self, poses: Array, period: float) -> float:
        """Return the factor by which the duration of a trajectory must grow to keep the limits.

        The factor is at most 1 if the trajectory keeps them. The limits apply to finite differences
        of poses. The limits of the wheels are not checked: see
        `WheelLimits.compute_peak_utilization`.

        Args:
            poses: Pose of each frame, (frames, 3), from rest to rest.
            period: Length of a frame, s.
        """
        velocity = np.pad(np.diff(poses, axis=0) / period, ((2, 2), (0, 0)))
        change = np.diff(velocity, axis=0) / period
        jerk, turn_jerk = _max_norms(np.diff(change, axis=0) / period)
        change[1:-1, :2] = self.to_isotropic(change[1:-1, :2], poses[:, 2])
        speed, turn_rate = _max_norms(velocity)
        acceleration, turn_acceleration = _max_norms(change)
        return max(
            speed / self.speed,
            turn_rate / self.turn_rate,
            math.sqrt(acceleration / self.acceleration),
            math.sqrt(turn_acceleration / self.turn_acceleration),
            math.cbrt(jerk / (self.jerk or np.inf)),
            math.cbrt(turn_jerk / (self.turn_jerk or np.inf)),
        )

    def reduce_for_wheels(self) -> "MotionLimits":
        """Return limits of which the wheels can reach all at once, in any direction."""
        if self.wheels is None:
            return self
        side = self.side_acceleration or self.acceleration
        margin = self.wheels.compute_acceleration_margin(
            self.acceleration, side, self.turn_acceleration
        )
        rim_speed = self.speed + self.wheels.kinematics.arm * self.turn_rate
        acceleration_scale = min(margin, 1.0)
        speed_scale = min(self.wheels.max_rim_speed / rim_speed, 1.0)
        return replace(
            self,
            speed=self.speed * speed_scale,
            turn_rate=self.turn_rate * speed_scale,
            acceleration=self.acceleration * acceleration_scale,
            turn_acceleration=self.turn_acceleration * acceleration_scale,
            side_acceleration=self.side_acceleration and side * acceleration_scale,
        )

    def compute_min_acceleration(
        self, offset: Array, heading: Array, target_heading: Array
    ) -> float | Array:
        """Return the lowest limit of acceleration along an offset while the robot turns.

        From the weaker to the stronger axis of the body, the limit rises steadily. Over a range of
        headings it is therefore lowest at one of the ends, or where the weaker axis is parallel to
        the offset.

        Args:
            offset: Vectors in the directions of interest, (n, 2), world frame.
            heading: Headings at the start of the turn, (n,) rad.
            target_heading: Headings at the end of the turn, (n,) rad.

        Returns:
            One limit for all robots, or (n, 1), m/s^2.
        """
        if self.acceleration_ratio == 1:
            return self.acceleration
        weak_axis = 0.0 if self.acceleration_ratio < 1 else np.pi / 2
        bearings = np.arctan2(offset[:, 1], offset[:, 0]) - np.stack([heading, target_heading])
        limits = self.acceleration / np.hypot(
            np.cos(bearings), self.acceleration_ratio * np.sin(bearings)
        )
        half_turns = np.floor((bearings - weak_axis) / np.pi)
        lowest = self.acceleration / max(self.acceleration_ratio, 1.0)
        return np.where(half_turns[0] == half_turns[1], limits.min(0), lowest)[:, None]

    def compute_max_component(self, offset: Array, heading: Array) -> float | Array:
        """Return the largest component along an offset of any acceleration within the limits.

        Between the axes of the body, the acceleration with the largest component is not parallel to
        the offset.

        Args:
            offset: Vectors in the directions of interest, (n, 2), world frame.
            heading: Headings of the robots, (n,) rad.

        Returns:
            One component for all robots, or (n, 1), m/s^2.
        """
        if self.acceleration_ratio == 1:
            return self.acceleration
        bearing = np.arctan2(offset[:, 1], offset[:, 0]) - heading
        ratio = np.hypot(np.cos(bearing), np.sin(bearing) / self.acceleration_ratio)
        return self.acceleration * ratio[:, None]


def _max_norms(vectors: Array) -> tuple[float, float]:
    """Return the largest norm of the translation and of the rotation of vectors (n, 3)."""
    translation = np.hypot(vectors[:, 0], vectors[:, 1])
    return float(translation.max()), float(np.abs(vectors[:, 2]).max())
