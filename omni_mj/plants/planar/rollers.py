"""What rollers on a carpet that gives way do to a wheel: where it rolls, and what it costs.

The full plant has all of this from its contacts (`omni_mj.worlds.contact`); here it is what they come to. A roller at
the angle phi from the bottom, a barrel of the radius r and the half length sqrt(R r) on a wheel of the radius R, is as
far below the axle as its support function says,

    h(phi) = (R - r) cos phi + sqrt(r^2 cos^2 phi + R r sin^2 phi).

With the axle at the height z every roller with h > z stands on a spring K (h - z). Wheels pass over rollers faster than
robots bounce, so z is the height at which the mean over phi carries the load. On average 1.3 to 1.4 rollers do.

Radius. A contact acts in the middle of its depth, where the wheel has the lever (h + z) / 2: it rolls on the mean.

Axle. A roller spins at v / r as its wheel travels along the axle at v. Its bearing brakes it by c v / r, and the wheel by
c v / r^2 for each that stands. Until it comes down again it has come to rest, and is spun up by the impulse I v / r^2,
one for each pitch. Together (c count + I |w| / pitch) v / r^2.

Grip. Friction of a contact is a damper beside an infinite limit; that of all of a wheel is count times as strong.
"""

from dataclasses import dataclass
from typing import Self

import numpy as np

from omni_control.kinematics import Array
from omni_mj.scenarios.robot_settings import WheelSettings
from omni_mj.worlds.contact import STIFFNESS_N_M

_SAMPLES = 2001
_HALVINGS = 60


@dataclass(frozen=True)
class Standing:
    """Wheels that stand and roll under a load.

    Attributes:
        lever: from the axle to where the carpet pulls, m.
        count: of the rollers that touch the carpet, on average.
    """

    lever: Array
    count: Array

    @classmethod
    def of(cls, wheels: WheelSettings, load: Array) -> Self:
        """Of wheels under loads (any shape), N; results have its shape."""
        outer, roller, pitch = wheels.radius_m, wheels.roller_radius_m, 2 * np.pi / wheels.rollers
        phi = np.linspace(-np.pi / 2, np.pi / 2, _SAMPLES)
        share = (phi[1] - phi[0]) / pitch
        along = np.sqrt((roller * np.cos(phi)) ** 2 + outer * roller * np.sin(phi) ** 2)
        below = (outer - roller) * np.cos(phi) + along
        loads, which = np.unique(load, return_inverse=True)
        low, high = np.zeros_like(loads), np.full_like(loads, outer)
        for _ in range(_HALVINGS):
            height = (low + high) / 2
            carried = STIFFNESS_N_M * share * np.maximum(below[:, None] - height, 0).sum(0)
            low, high = np.where(carried > loads, height, low), np.where(carried > loads, high, height)
        depth = np.maximum(below[:, None] - height, 0)
        lever = height + (depth**2).sum(0) / (2 * depth.sum(0))
        count = share * (depth > 0).sum(0)
        return cls(lever[which].reshape(load.shape), count[which].reshape(load.shape))
