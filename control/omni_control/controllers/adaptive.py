"""Adaptive comp-FLC: the paper's controller on a robot whose response is identified while it is driven."""

import numpy as np

from omni_control.controllers.base import Seen, Told
from omni_control.controllers.identifying import Arrival, Identifying
from omni_control.estimation.motion import pairs, plane
from omni_control.fuzzy.rules import FuzzyLaw
from omni_control.kinematics import Array
from omni_control.limits import within_rate
from omni_control.reference import Reference

LOOK_FRAMES = 10  # ahead and back, over which a command that changes too fast is spread
RATE_SHARE = 0.75  # of what commands may change by, that the reference may ask for; the rest is the feedback's
STIFFNESS = 12.0  # 1/s: of the fuzzy controller near zero error, for which the damping is made


class AdaptiveCompFlc(Identifying):
    """adaptive-comp-flc: comp-FLC that identifies latency, alpha, slip, dry friction and compass error online.

    Pose and velocity are predicted to when the command will act, by the law of `estimation.motion`. What is sent is the
    inverse of that law for the reference of that time; the fuzzy controller's correction of the position that is left,
    and the damping that goes with it: a robot that creeps answers to a command u with a lag, (lag) v' + g v = u, and
    under a correction of stiffness k alone would swing. With the gain

        k_v = -g + sqrt(g^2 + 2 k lag)

    on the difference of velocities, errors decay with a damping ratio of at least 1/sqrt(2), the most at no lag.

    A reference whose acceleration jumps asks for a command that jumps, by lag times that. Commands cannot, so that
    the jump is spread over the frames before and after it (`limits.within_rate`).
    """

    def __init__(self, told: Told, reference: Reference, n: int) -> None:
        super().__init__(told, reference, n)
        self.fuzzy = FuzzyLaw(told.error_range_m, told.speed_range_m_s)

    def wanted(self, frame: int, seen: Seen, arrival: Arrival) -> Array:
        """See `Identifying`."""
        period, law, now = self.told.period, self.plant.motion, LOOK_FRAMES + 1
        position, velocity, heading = arrival
        poses, twists = self.around(frame + self.plant.latency, now, now)
        speeds, target = plane(twists[..., :2]), poses[now]
        edges = (speeds[:-1] + speeds[1:]) / 2
        middles = (poses[..., 2] + twists[..., 2] * (period / 2))[1:-1]
        facing = np.exp(1j * (middles + (heading - target[:, 2])))  # as the robot will, not as it should
        asked = pairs(law.ask(edges[:-1], edges[1:], facing, period))
        planned = plane(within_rate(asked, RATE_SHARE * self.told.limits.acceleration * period))

        edge, face, effort = edges[now - 1], facing[now - 1], law.effort
        speed = np.abs(edge)
        damping = np.sqrt(effort * (effort + 2 * STIFFNESS * law.late(speed))) - effort
        behind = pairs((edge - velocity) * face.conj())
        error = target[:, :2] - pairs(position)
        corrected = plane(self.fuzzy(error)) + plane(damping * behind) * face
        across = pairs(self.plant.ask(planned + corrected))
        rates, ahead = twists[now - 1 : now + 2, :, 2], edges[now - 1 : now + 1]
        turn = self.turn(rates, ahead, face, target[:, 2], heading, planned)
        return np.concatenate([across, turn[:, None]], axis=1)
