"""What wheels can push on a carpet: the acceleration that friction allows, which limits what is worth asking for.

Wheels that slide give no more than Coulomb's friction along their rims, mu times what they bear, and across them their
rollers give nothing. The forces must add up to one in the direction wanted and to no moment, or the robot would turn.
The most of it is a linear program. What wheels bear is what statics leaves them, which is not the same for all: of
wheels at 60, 135, 225 and 300 degrees those in front stand nearer below the centre and bear 29 % of the weight each,
those behind 21 %.
"""

import math

import numpy as np
from scipy.optimize import linprog

from omni_control.errors import OmniError
from omni_control.kinematics import Array, Kinematics


def traction_limits(
    kinematics: Kinematics, friction: float, centre_height: float = 0.0, gravity: float = 9.81
) -> tuple[float, float]:
    """Highest acceleration (forward, sideways) in m/s^2, along the body's x and y axes, for speeding up and braking.

    The ellipse through them, as `MotionLimits` keeps it, is more than friction allows in between: see `traction`.

    Args:
        kinematics: of the wheels.
        friction: coefficient of friction between rollers and carpet.
        centre_height: of the centre of mass above the carpet, m, by which acceleration shifts load from wheel to wheel;
            0 neglects that.
        gravity: m/s^2.

    Raises:
        OmniError: the robot does not stand on these wheels.
    """
    ahead, back, left, right = (
        traction(kinematics, friction, bearing, centre_height, gravity)
        for bearing in (0.0, math.pi, math.pi / 2, -math.pi / 2)
    )
    return min(ahead, back), min(left, right)


def traction(
    kinematics: Kinematics, friction: float, bearing: float, centre_height: float = 0.0, gravity: float = 9.81
) -> float:
    """Highest acceleration without turning towards `bearing` (rad from the body's x axis), m/s^2; 0 if there is none.

    The centre of mass is over the middle of the wheels. Motors are taken to be strong enough, and drag is neglected.

    Args:
        kinematics: of the wheels.
        friction: as for `traction_limits`.
        bearing: as above.
        centre_height: as for `traction_limits`.
        gravity: same.

    Raises:
        OmniError: the robot does not stand on these wheels.
    """
    wheels, direction = len(kinematics.azimuths), np.array([math.cos(bearing), math.sin(bearing)])
    standing, shifting = _loads(kinematics, direction, centre_height)
    if standing.min() <= 0:
        raise OmniError("the wheels do not stand around the robot's centre, so that it would topple")
    # Unknown are the forces along the rims and the acceleration a that they give, all per mass.
    pushed = np.column_stack([kinematics.matrix.T, [*-direction, 0.0]])
    shifted = -friction * shifting
    borne = [np.column_stack([sign * np.eye(wheels), shifted]) for sign in (1, -1)]
    found = linprog(
        [0.0] * wheels + [-1.0],
        A_ub=np.vstack(borne),
        b_ub=np.tile(friction * gravity * standing, 2),
        A_eq=pushed,
        b_eq=np.zeros(3),
        bounds=[(None, None)] * wheels + [(0, None)],
    )
    return float(found.x[-1])


def _loads(kinematics: Kinematics, direction: Array, centre_height: float) -> tuple[Array, Array]:
    """Shares of the weight (wheels,) that wheels bear at rest, and loads per mass and acceleration that are added.

    Four equal springs, or any number, under a rigid body: of all loads in balance those with the least squares.
    """
    levers = kinematics.arm * np.stack([np.cos(kinematics.azimuths), np.sin(kinematics.azimuths)])
    spread = np.linalg.pinv(np.vstack([np.ones(len(kinematics.azimuths)), levers]))
    return spread[:, 0], -centre_height * spread[:, 1:] @ direction
