"""Adaptive comp-FLC: the paper's controller on a robot whose response is identified while it is driven.

**Lead.** A robot that creeps answers to a command u with a lag, (lag) v' + g v = u, and under a correction F(e) of its
error alone would swing. So the fuzzy controller F is asked for x = e + T e', the error that is left a lead time later:

    T = 2 lag / (g + s),   s = sqrt(g^2 + 2 k lag),   k the slope of F at no error

- Where F has that slope, errors decay with a damping ratio of 1/sqrt(2) or more; where it has others, of at least
  sqrt(2 g / (g + s)).
- Whatever F is, if it has the sign of x: T <= lag / g, so that m = 1 - g T / lag >= 0. V = int F dx + m lag e'^2 / 2
  changes at the rate -F^2 T / lag - m g e'^2, so that errors of any size end.
- Where F saturates nothing is damped: a robot that is far off comes back at the speed F / g that F asks for.
"""

import numpy as np

from omni_control.controllers.base import Seen, Told
from omni_control.controllers.identifying import Arrival, Identifying
from omni_control.controllers.planning import fade, in_time, lead
from omni_control.estimation.motion import Plane, pairs, plane
from omni_control.fuzzy.rules import FuzzyLaw
from omni_control.kinematics import Array
from omni_control.reference import Reference

LOOK_FRAMES = 10  # ahead; with 20 nothing changes, on `league`, `waypoints` and `slippery`


class AdaptiveCompFlc(Identifying):
    """adaptive-comp-flc: comp-FLC that identifies latency, alpha, slip, dry friction and compass error online.

    Pose and velocity are predicted to when the command will act, by the law of `estimation.motion`. What is sent is the
    inverse of that law for the reference of that time, and the fuzzy controller's correction of the error that is left.

    A reference whose acceleration jumps asks for a command that jumps, by lag times that. Commands cannot, so that
    they set out before it, for what will be asked for then: by the inverse, and by the correction, which fades as the
    error does that it takes away (`controllers.planning.in_time`).
    """

    def __init__(self, told: Told, reference: Reference, n: int) -> None:
        super().__init__(told, reference, n)
        self.fuzzy = FuzzyLaw(told.error_range_m, told.speed_range_m_s)
        self._step = told.limits.acceleration * told.period

    def wanted(self, frame: int, seen: Seen, arrival: Arrival) -> Array:
        """See `Identifying`."""
        period, law = self.told.period, self.plant.motion
        position, velocity, heading = arrival
        poses, twists = self.around(frame + self.plant.latency, LOOK_FRAMES)
        target, (edges, facing) = poses[1], self.along(poses, twists, heading)
        error = self._leading(plane(target[:, :2]) - position, edges[0] - velocity, np.abs(edges[0]), facing[0])
        correction = plane(self.fuzzy(pairs(error)))
        asked = law.ask(edges[:-1], edges[1:], facing, period)
        fading = fade(correction, error, period) ** np.arange(LOOK_FRAMES)[:, None]
        command = in_time(asked + fading * correction, self._step)
        across = pairs(self.plant.ask(command))
        turn = self.turn(twists[:3, :, 2], edges[:2], facing[0], target[:, 2], heading, command - correction)
        return np.concatenate([across, turn[:, None]], axis=1)

    def _leading(self, error: Plane, behind: Plane, speed: Array, facing: Plane) -> Plane:
        """Errors of position (n,) that are left a lead time later, m, world frame.

        Args:
            error: of position now, (n,) m, world frame.
            behind: of velocity (n,), m/s, same.
            speed: at which robots should drive (n,), m/s.
            facing: of robots, unit vectors (n,).
        """
        law = self.plant.motion
        times = lead(law.effort, law.late(speed), self.fuzzy.stiffness)
        return error + plane(times * pairs(behind * facing.conj())) * facing
