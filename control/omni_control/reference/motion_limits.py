"""The limits of a motion, and the one rule by which a reference moves within them (section 3-A).

`approach` moves a point towards a set-point as fast as the limits let it and stops it there exactly, in whole frames.

Ahead and aside a robot's wheels push differently (section 3-A: "not the same because of the robot's structure"). What
it manages in between is an ellipse about the axes of its body, and an ellipse is a circle in stretched coordinates:
`MotionLimits.stretched` leads there, and what is true of vectors and one limit holds again.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from omni_control.errors import OmniError
from omni_control.kinematics import Array
from omni_control.traction import WheelLimits


@dataclass(frozen=True)
class MotionLimits:
    """Limits of a reference or of commands: m/s and m/s^2 along the path, rad/s and rad/s^2 in heading.

    The defaults are those of the paper's reference (section 2), with a turn rate and acceleration
    to match.

    Args:
        speed, turn_rate, turn_acceleration: highest, whatever the direction.
        acceleration: highest change of velocity per second, speeding up, braking or in bends.
        side_acceleration: the same along the body's y axis; then `acceleration` is that along its x
            axis, and between them is the ellipse. None: one limit for all directions.
        jerk: highest change of the acceleration, a vector in the world, per second, m/s^3. None: no
            limit.
        turn_jerk: the same of the turn acceleration, rad/s^3.
        wheels: what driving and turning may ask of the wheels together, beside the limits of each.
            None: not regarded.

    The last four are for references; commands know one limit of acceleration only.
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
        """Check the limits.

        Raises:
            OmniError: a limit is not a positive number.
        """
        for name, value in vars(self).items():
            if isinstance(value, float | int) and not 0 < value < np.inf:
                raise OmniError(
                    f"the limit of {name.replace('_', ' ')} must be a positive number, not {value}"
                )

    @property
    def stretch(self) -> float:
        """How many times more acceleration is allowed ahead than aside."""
        return 1.0 if self.side_acceleration is None else self.acceleration / self.side_acceleration

    def stretched(self, vector: Array, heading: Array) -> Array:
        """World accelerations (n, 2) of robots with `heading` (n,), as vectors (n, 2) that may be `acceleration` long.

        They are turned into the body's axes, and y is stretched; with one limit for all directions,
        neither is needed.
        """
        if self.stretch == 1:
            return vector
        c, s = np.cos(heading), np.sin(heading)
        x, y = vector[:, 0], vector[:, 1]
        return np.stack([c * x + s * y, self.stretch * (c * y - s * x)], axis=1)

    def required_time_scale(self, poses: Array, period: float) -> float:
        """Factor by which a drive from rest to rest must take longer, for differences of its poses to keep the limits.

        Those of the wheels are not looked at: see `WheelLimits.shares`.

        Args:
            poses: one per frame, (frames, 3).
            period: length of a frame, s.
        """
        velocity = np.pad(np.diff(poses, axis=0) / period, ((2, 2), (0, 0)))
        change = np.diff(velocity, axis=0) / period
        jerk, turn_jerk = _largest(np.diff(change, axis=0) / period)
        change[1:-1, :2] = self.stretched(change[1:-1, :2], poses[:, 2])
        (speed, turn_rate), (acceleration, turn_acceleration) = _largest(velocity), _largest(change)
        return max(
            speed / self.speed,
            turn_rate / self.turn_rate,
            math.sqrt(acceleration / self.acceleration),
            math.sqrt(turn_acceleration / self.turn_acceleration),
            math.cbrt(jerk / (self.jerk or np.inf)),
            math.cbrt(turn_jerk / (self.turn_jerk or np.inf)),
        )

    def eased(self, acceleration: float, speed: float) -> "MotionLimits":
        """The same with accelerations and speeds, of turning too, that are so many times as high."""
        aside = self.side_acceleration and self.side_acceleration * acceleration
        return replace(
            self,
            speed=self.speed * speed,
            turn_rate=self.turn_rate * speed,
            acceleration=self.acceleration * acceleration,
            turn_acceleration=self.turn_acceleration * acceleration,
            side_acceleration=aside,
        )

    def at_once(self) -> "MotionLimits":
        """The same, eased until the wheels can do all that they allow at once, whatever the directions."""
        if self.wheels is None:
            return self
        side = self.side_acceleration or self.acceleration
        spare = self.wheels.compute_acceleration_margin(
            self.acceleration, side, self.turn_acceleration
        )
        rims = self.speed + self.wheels.kinematics.arm * self.turn_rate
        return self.eased(min(spare, 1.0), min(self.wheels.max_rim_speed / rims, 1.0))

    def on_the_way(self, offset: Array, heading: Array, later: Array) -> float | Array:
        """Highest acceleration (n, 1) along world vectors `offset` (n, 2) at all headings from `heading` to `later`.

        Away from the weaker axis of the body, the limit only rises, up to the other: of a range of
        headings, the lowest is at one of its ends, or at the weaker axis if that comes to point
        along the offset.
        """
        if self.stretch == 1:
            return self.acceleration
        weaker = 0.0 if self.stretch < 1 else np.pi / 2
        bearings = _bearing(offset) - np.stack([heading, later])
        ends = self.acceleration / np.hypot(np.cos(bearings), self.stretch * np.sin(bearings))
        before, after = np.floor((bearings - weaker) / np.pi)
        lowest = self.acceleration / max(self.stretch, 1.0)
        return np.where(before == after, ends.min(0), lowest)[:, None]

    def onwards(self, offset: Array, heading: Array) -> float | Array:
        """Largest component (n, 1) along world vectors `offset` (n, 2) of any acceleration allowed at `heading` (n,).

        Between the axes the point of the ellipse that is farthest onwards lies beside the offset.
        """
        if self.stretch == 1:
            return self.acceleration
        bearing = _bearing(offset) - heading
        return (
            self.acceleration * np.hypot(np.cos(bearing), np.sin(bearing) / self.stretch)[:, None]
        )


def stopping_speed(distance: Array, acceleration: float | Array, period: float) -> Array:
    """Highest speed (m/s) from which `distance` (m, >= 0) is covered exactly while braking at most at `acceleration`.

    A point that moves s, s - 1, s - 2, ... units of a T^2 in successive frames of length T covers m
    (m + 1) / 2 in m frames; between these distances the speed is linear, which makes it fall by
    exactly one unit each frame but the last.
    """
    unit = acceleration * period**2
    d = np.asarray(distance, float) / unit
    m = np.floor(np.sqrt(0.25 + 2 * d) - 0.5)
    return (m + (d - m * (m + 1) / 2) / (m + 1)) * unit / period


def approach(
    offset: Array, velocity: Array, speed: float, acceleration: float, period: float
) -> Array:
    """Velocity for the next frame of a point that shall stop at a set-point.

    Args:
        offset: set-point minus position, (n, d) m, d = 1 or 2.
        velocity: velocity of the last frame, (n, d) m/s.
        speed: highest speed, m/s.
        acceleration: highest change of velocity per second, m/s^2.
        period: length of a frame, s.

    Returns:
        (n, d) m/s: no faster than `speed`, changed by at most `acceleration * period`. That is
            shared between braking
        what leads past the set-point and the speed towards it, whose gain counts for no more than
        one frame's.
    """
    step = acceleration * period
    change = _change(
        offset,
        velocity,
        np.minimum(speed, stopping_speed(_size(offset), acceleration, period)),
        step,
    )
    return velocity + change * (step / np.maximum(_size(change), step))


def _change(offset: Array, velocity: Array, wanted: Array, gain: float | Array) -> Array:
    """The change of velocity (n, d) that a frame would like to make, of which it makes as much as its limit allows.

    Args:
        offset: as for `approach`.
        velocity: same.
        wanted: speed (n, 1) towards the set-point.
        gain: of that speed in a frame, at most. Nothing less than the largest of all changes
            allowed will do: what is moving and can be stopped in this frame is, also if a rounding
            error is all that gives the offset direction.
    """
    distance = _size(offset)
    direction = np.divide(offset, distance, out=np.zeros_like(offset), where=distance > 0)
    along = _summed(velocity * direction)
    across = velocity - along * direction
    return np.minimum(wanted - along, gain) * direction - across


def approach_pose(
    pose: Array, twist: Array, target: Array, limits: MotionLimits, period: float
) -> Array:
    """`approach` for position and heading of (n, 3) poses, each within its own limits; headings count full turns.

    Braking is planned with the lowest limit of the headings still to come, which rises as they
    become fewer, so that what is planned can always be kept: exact if the robot does not turn, and
    no more than careful if it does. What a frame changes is held against the heading that the robot
    has in it.
    """
    offset = target - pose
    way, velocity, heading = offset[:, :2], twist[:, :2], pose[:, 2]
    braking = limits.on_the_way(way, heading, target[:, 2])
    wanted = np.minimum(limits.speed, stopping_speed(_size(way), braking, period))
    change = _change(way, velocity, wanted, limits.onwards(way, heading) * period)
    step = limits.acceleration * period
    xy = velocity + change * (step / np.maximum(_size(limits.stretched(change, heading)), step))
    turn = approach(offset[:, 2:], twist[:, 2:], limits.turn_rate, limits.turn_acceleration, period)
    return np.concatenate([xy, turn], axis=1)


def validate_waypoints(waypoints: Sequence[Sequence[float]]) -> Array:
    """Way-points as an array (points, 3).

    Raises:
        OmniError: there are none, or one is not three finite numbers.
    """
    if (
        not len(waypoints)
        or any(len(point) != 3 for point in waypoints)
        or not np.isfinite(waypoints).all()
    ):
        raise OmniError(
            "a reference needs at least one way-point, each three finite numbers [x, y, heading]"
        )
    return np.array(waypoints, float)


def _largest(rows: Array) -> tuple[float, float]:
    """Sizes of the longest translation and of the largest rotation of rows (n, 3)."""
    return float(np.hypot(rows[:, 0], rows[:, 1]).max()), float(np.abs(rows[:, 2]).max())


def _bearing(vector: Array) -> Array:
    return np.arctan2(vector[:, 1], vector[:, 0])


def _size(vector: Array) -> Array:
    return np.sqrt(_summed(vector * vector))


def _summed(parts: Array) -> Array:
    """The sum of one or two columns, (n, 1): `sum` takes longer than all else here."""
    return parts[:, :1] + parts[:, 1:] if parts.shape[1] == 2 else parts
