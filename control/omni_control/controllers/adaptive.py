"""Adaptive comp-FLC: the paper's controller on a robot whose response is identified while it is driven."""

import numpy as np

from omni_control.controllers.base import Seen, Told
from omni_control.controllers.identifying import Arrival, Identifying
from omni_control.controllers.planning import damping, plan
from omni_control.estimation.motion import pairs, plane
from omni_control.fuzzy.rules import FuzzyLaw
from omni_control.kinematics import Array
from omni_control.limits import within_rate
from omni_control.reference import Reference

LOOK_FRAMES = 10  # ahead and back, over which a command that changes too fast is spread
RATE_SHARE = 0.75  # of what commands may change by, that the reference may ask for; the rest is the feedback's


class AdaptiveCompFlc(Identifying):
    """adaptive-comp-flc: comp-FLC that identifies latency, alpha, slip, dry friction and compass error online.

    Pose and velocity are predicted to when the command will act, by the law of `estimation.motion`. What is sent is the
    inverse of that law for the reference of that time; the fuzzy controller's correction of the position that is left,
    and the damping that goes with it (`planning`).

    A reference whose acceleration jumps asks for a command that jumps, by lag times that. Commands cannot, so that
    the jump is spread over the frames before and after it (`limits.within_rate`).
    """

    def __init__(self, told: Told, reference: Reference, n: int) -> None:
        super().__init__(told, reference, n)
        self.fuzzy = FuzzyLaw(told.error_range_m, told.speed_range_m_s)
        self._step = RATE_SHARE * told.limits.acceleration * told.period
        self._plan = None if told.compiled is None else told.compiled(plan)

    def wanted(self, frame: int, seen: Seen, arrival: Arrival) -> Array:
        """See `Identifying`."""
        period, law, now = self.told.period, self.plant.motion, LOOK_FRAMES + 1
        position, velocity, heading = arrival
        poses, twists = self.around(frame + self.plant.latency, now, now)
        target = poses[now]
        corrected = self.fuzzy(target[:, :2] - pairs(position))
        if self.loops is not None and self._plan is not None:
            reference, commands = (np.ascontiguousarray(poses), np.ascontiguousarray(twists)), np.empty_like(target)
            limits = self._step, self.told.heading_gain
            self._plan(*self.loops.arrays, *reference, velocity, heading, corrected, *limits, commands)
            return commands
        speeds = plane(twists[..., :2])
        edges = (speeds[:-1] + speeds[1:]) / 2
        middles = (poses[..., 2] + twists[..., 2] * (period / 2))[1:-1]
        facing = np.exp(1j * (middles + (heading - target[:, 2])))  # as the robot will, not as it should
        asked = pairs(law.ask(edges[:-1], edges[1:], facing, period))
        planned = plane(within_rate(asked, self._step))

        edge, face, speed = edges[now - 1], facing[now - 1], np.abs(edges[now - 1])
        behind = pairs((edge - velocity) * face.conj())
        besides = plane(corrected) + plane(damping(law.effort, law.late(speed)) * behind) * face
        across = pairs(self.plant.ask(planned + besides))
        rates, ahead = twists[now - 1 : now + 2, :, 2], edges[now - 1 : now + 1]
        turn = self.turn(rates, ahead, face, target[:, 2], heading, planned)
        return np.concatenate([across, turn[:, None]], axis=1)
