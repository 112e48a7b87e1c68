"""What wheels can do at once: push a robot and turn it, within what friction allows, and roll, within their speed.

Wheels that slide give no more than Coulomb's friction along their rims, mu times what they bear, and across them their
rollers give nothing. So each adds a segment, there and back along what its push does to the body, [ax, ay, moment], and
all together give the sum of these segments: a zonotope, each of whose faces is spanned by two of them (McMullen 1971,
On zonotopes). Which side of its faces a demand lies on says whether there are forces for it, and how much is left.

What wheels bear is what statics leaves them, which is not the same for all: of wheels at 60, 135, 225 and 300 degrees
those in front stand nearer below the centre and bear 29 % of the weight each, those behind 21 %. What they must push
besides the body is what drags it: see `WheelLimits`.
"""

import math
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations
from typing import Literal

import numpy as np

from omni_control.errors import OmniError
from omni_control.kinematics import Array, Kinematics, world_to_body

GRAVITY = 9.81  # m/s^2
_NEAR = 2  # cells either way
_PARALLEL = 1e-9  # two wheels that do the same span no face


def traction_limits(
    kinematics: Kinematics, friction: float, centre_height: float = 0.0
) -> tuple[float, float]:
    """Highest acceleration (forward, sideways) in m/s^2, along the body's x and y axes, for speeding up and braking.

    The ellipse through them, as `MotionLimits` keeps it, is more than friction allows in between:
    see `traction_limit`.

    Args:
        kinematics: of the wheels.
        friction: coefficient of friction between rollers and carpet.
        centre_height: of the centre of mass above the carpet, m, by which acceleration shifts load
            from wheel to wheel; 0 neglects that.

    Raises:
        OmniError: the robot does not stand on these wheels.
    """
    ahead, back, left, right = (
        traction_limit(kinematics, friction, bearing, centre_height)
        for bearing in (0.0, math.pi, math.pi / 2, -math.pi / 2)
    )
    return min(ahead, back), min(left, right)


def traction_limit(
    kinematics: Kinematics, friction: float, bearing: float, centre_height: float = 0.0
) -> float:
    """Highest acceleration without turning towards `bearing` (rad from the body's x axis), m/s^2; 0 if there is none.

    The centre of mass is over the middle of the wheels. Motors are taken to be strong enough, and
    drag is neglected.

    Args:
        kinematics: of the wheels.
        friction: as for `traction_limits`.
        bearing: as above.
        centre_height: as for `traction_limits`.

    Raises:
        OmniError: the robot does not stand on these wheels.
    """
    wheels = WheelLimits(kinematics, friction, gyration_radius=1.0, centre_height=centre_height)
    towards = np.array([[math.cos(bearing), math.sin(bearing), 0.0]])
    return float(1 / wheels.friction_utilization(towards, np.zeros((1, 3))).max())


@dataclass(frozen=True)
class WheelLimits:
    """What wheels can do at once, as a team believes it. Motors are taken to be strong enough.

    Args:
        kinematics: of the wheels; the centre of mass is over their middle.
        friction: coefficient of friction between rollers and carpet.
        gyration_radius: the robot's radius of gyration about the vertical axis, m: the root of its inertia
            over its mass.
        centre_height: as for `traction_limits`.
        carpet_drag: what the carpet resists against the travel of each wheel, a share of its load.
        roller_friction: what the rollers' bearings resist against travel along its axle, same; it
            also takes its part of the circle of friction.
        max_rim_speed: highest speed of a rim, m/s.

    Raises:
        OmniError: a number is not what it can be, the robot does not stand on these wheels, or they
            cannot even pull what drags them.
    """

    kinematics: Kinematics
    friction: float
    gyration_radius: float
    centre_height: float = 0.0
    carpet_drag: float = 0.0
    roller_friction: float = 0.0
    max_rim_speed: float = np.inf

    def __post_init__(self) -> None:
        """Check that anything can be driven with them.

        Raises:
            OmniError: see above.
        """
        for name in ("friction", "gyration_radius", "max_rim_speed"):
            if not getattr(self, name) > 0:
                raise OmniError(
                    f"the {name.replace('_', ' ')} of wheels must be positive, not {getattr(self, name)}"
                )
        for name in ("centre_height", "carpet_drag", "roller_friction"):
            if not getattr(self, name) >= 0:
                raise OmniError(
                    f"the {name.replace('_', ' ')} of wheels must not be below 0: {getattr(self, name)}"
                )
        if self.max_drag_fraction >= 1:
            raise OmniError(
                f"on a carpet of friction {self.friction:g} wheels cannot pull what drags them, "
                f"{self.max_drag_fraction:.3g} times what they can"
            )

    @property
    def max_drag_fraction(self) -> float:
        """How much of their friction drag may take, wherever they go: an upper bound, some per cent too high."""
        return float(self._dragged.max())

    def shares(self, poses: Array, period: float) -> tuple[float, float]:
        """How much of their friction and of their rim speed a drive asks of the wheels at most; 1 is all of it.

        Args:
            poses: one per frame, (frames, 3), from rest to rest; accelerations are second
                differences of them.
            period: length of a frame, s.
        """
        heading, velocity = poses[:, 2], np.diff(poses, axis=0) / period
        rims = self.rims(world_to_body(velocity, (heading[1:] + heading[:-1]) / 2))
        velocity = np.pad(velocity, ((1, 1), (0, 0)))
        asked = world_to_body(np.diff(velocity, axis=0) / period, heading)
        travel = world_to_body((velocity[1:] + velocity[:-1]) / 2, heading)
        return float(self.friction_utilization(asked, travel).max()), float(
            rims.max(initial=0) / self.max_rim_speed
        )

    def friction_utilization(self, acceleration: Array, travel: Array) -> Array:
        """How much of their friction wheels need (n,) for body accelerations (n, 3), travelling at twists (n, 3)."""
        rows, dragged = self.faces(travel)
        return np.asarray((acceleration @ rows.T + dragged).max(1))

    def faces(self, travel: Array) -> tuple[Array, Array]:
        """Rows (faces, 3) and (n, faces): of friction, body accelerations a (n, 3) take the highest of rows a + those.

        The latter are what drag takes of it while the wheels travel at twists (n, 3).
        """
        allowed, pushed = self._faces
        return allowed * [1.0, 1.0, self.gyration_radius**2], -self._drag(travel) @ pushed.T

    def spare(
        self, acceleration: float, side_acceleration: float, turn_acceleration: float
    ) -> float:
        """How many times these wheels can do at once, whatever the directions, while anything drags them.

        The accelerations in m/s^2 are those ahead and aside, with the ellipse between them, that in
        rad/s^2 either way.
        """
        ahead, aside, turning = np.abs(self._faces[0]).T
        reach = np.hypot(acceleration * ahead, side_acceleration * aside)
        reach += self.gyration_radius**2 * turn_acceleration * turning
        return float(1 / (reach / (1 - self._dragged)).max())

    def rims(self, twist: Array) -> Array:
        """Speeds of the rims (n, wheels) in m/s, either way, at body twists (n, 3)."""
        return np.abs(twist @ self.kinematics.matrix.T)

    def _drag(self, travel: Array) -> Array:
        """What the carpet does to the body, [ax, ay, moment per mass] (n, 3), against its travel at twists (n, 3)."""
        along, across = travel @ self.kinematics.matrix.T, travel @ self.kinematics.axles.T
        load, speed = GRAVITY * self._loads[0], np.hypot(along, across)
        carpet_drag = np.divide(self.carpet_drag, speed, out=np.zeros_like(speed), where=speed > 0)
        against = carpet_drag * across + self.roller_friction * np.sign(across)
        return (
            -(load * carpet_drag * along) @ self.kinematics.matrix
            - (load * against) @ self.kinematics.axles
        )

    @cached_property
    def _faces(self) -> tuple[Array, Array]:
        """What the faces of the zonotope allow, two times (faces, 3): those times a, less these times drag, up to 1.

        Of a wheel k, m_k = [-sin, cos, arm] is what its push does per force, and its load is g n_k
        + s_k a, the second part being what the acceleration a = [ax, ay, gyration^2 b] shifts.
        Along a normal v, a zonotope of these pushes reaches sum |m_k v| mu (g n_k + s_k a), and has
        to reach v (a - drag). Nor do wheels bear less than nothing.
        """
        pushes, (standing, shifting) = self.kinematics.matrix, self._loads
        if standing.min() <= 0:
            raise OmniError(
                "the wheels do not stand around the robot's centre, so that it would topple"
            )
        spanned = np.array([np.cross(*pair) for pair in combinations(pushes, 2)])
        spanned = spanned[np.linalg.norm(spanned, axis=1) > _PARALLEL]
        normals = np.concatenate([spanned, -spanned])
        grip = math.sqrt(max(self.friction**2 - self.roller_friction**2, _PARALLEL))
        reach = grip * np.abs(normals @ pushes.T)
        pushed = np.concatenate([normals, np.zeros_like(shifting)])
        borne = np.concatenate([reach, np.eye(len(standing))])
        most = GRAVITY * (borne @ standing)[:, None]
        return (pushed - borne @ shifting) / most, pushed / most

    @cached_property
    def _dragged(self) -> Array:
        """The most that drag takes of what each face allows (faces,), every wheel going the worst way."""
        pushed = self._faces[1]
        along, across = (
            np.abs(pushed @ self.kinematics.matrix.T),
            np.abs(pushed @ self.kinematics.axles.T),
        )
        taken = self.carpet_drag * np.hypot(along, across) + self.roller_friction * across
        return np.asarray(taken @ (GRAVITY * self._loads[0]))

    @cached_property
    def _loads(self) -> tuple[Array, Array]:
        return load_distribution(self.kinematics, self.centre_height)


def load_distribution(kinematics: Kinematics, centre_height: float) -> tuple[Array, Array]:
    """Shares of the weight (wheels,) that wheels bear at rest, and what accelerations add, (wheels, 3) per mass.

    Args:
        kinematics: of the wheels; the centre of mass is over their middle.
        centre_height: of it, m.
    """
    shares = load_matrix(kinematics)
    return shares[:, 0], np.pad(-centre_height * shares[:, 1:], ((0, 0), (0, 1)))


def load_matrix(kinematics: Kinematics) -> Array:
    """What wheels bear (wheels, 3) of a force down, and per moments of forces times their places x and y, 1/m.

    Equal springs under a rigid body: of all loads in balance those with the least squares.
    """
    places = np.insert(kinematics.arm * kinematics.axles[:, :2], 0, 1.0, axis=1)
    return np.asarray(np.linalg.pinv(places.T))


def around(dragged: Array, ends: Literal["edge", "wrap"]) -> Array:
    """The most of what drag takes (cells, faces) in cells close by along a path that ends, or comes round again.

    Where a path crosses the direction of an axle, rollers' bearings drag the other way, which may
    be within a frame.
    """
    padded = np.pad(dragged, ((_NEAR, _NEAR), (0, 0)), mode=ends)
    return np.asarray(
        np.lib.stride_tricks.sliding_window_view(padded, 2 * _NEAR + 1, axis=0).max(-1)
    )
