"""Model predictive control with preview: the best commands for the next frames within what may be commanded."""

import numpy as np

from omni_control.controllers.base import Seen, Told
from omni_control.controllers.horizon import horizon
from omni_control.controllers.identifying import Arrival, Identifying
from omni_control.controllers.quadratic import Limits, minimise
from omni_control.estimation.motion import pairs, plane
from omni_control.kinematics import Array
from omni_control.reference import Reference

FRAMES = 20  # N: a third of a second, in which an error falls to exp(-15 / s * 0.33 s) = 0.7 %
STIFFNESS = 1.5  # in speed ranges per error range: 15/s, the gain of the fuzzy controller at zero error
STILL_M_S = 0.01  # speed of the reference below which its way has no direction


class Mpc(Identifying):
    """mpc: model predictive control with preview, on the identified law, within the limits of commands.

    Robots are predicted to when the command will act, as by adaptive-comp-flc. From there on the law is made linear
    about the reference (`controllers.horizon`), and the commands of the next N = 20 frames are chosen to minimise

        sum over the ends of N frames of |e_p|^2 + sum over N frames of |w|^2 / k^2 + |e_p + (lag / g) e_v|^2 / (2 k T)

    with e_p and e_v the errors of position and velocity, and w what is commanded besides the inverse of the law for the
    reference, which leaves no lasting error. The weight k is Bryson's, but for a factor: an error of 0.1 m
    (`error_range_m`) is as bad as a correction of 1.5 m/s (1.5 `speed_range_m_s`); k = 15/s is the gain of the fuzzy
    controller at zero error. The last term is what comes after: the error to which the last velocity would still lead,
    taken away at the rate k.

    Successive commands, of which the first follows the one sent last, change by no more than the limit of acceleration
    lets them, and go no faster along the way than that of speed (`controllers.quadratic`). So a jump of the reference's
    acceleration, which asks for a jump of the command, is spread over the frames before and after it as is best, and
    where more is asked than there is, what matters most comes first.

    Where a quadratic program is not solved, which none of its kind should be, the command is not a number: the team
    then stops that robot, and says so. The heading is held as by adaptive-comp-flc.

    `channels["bound"]` is 1 for robots whose program was bound by limits.
    """

    def __init__(self, told: Told, reference: Reference, n: int) -> None:
        super().__init__(told, reference, n)
        stiffness = STIFFNESS * told.speed_range_m_s / told.error_range_m
        weights = np.append(np.full(FRAMES, stiffness**2), stiffness / (2 * told.period))
        self._weights = np.repeat(weights, 2)  # of errors, that of commands being 1

    def wanted(self, frame: int, seen: Seen, arrival: Arrival) -> Array:
        """See `Identifying`."""
        period, plant, limits = self.told.period, self.plant, self.told.limits
        poses, twists = self.around(frame + plant.latency, FRAMES)
        positions = plane(poses[1:, :, :2])
        edges, facing = self.along(poses, twists, arrival.heading)
        error, late = arrival.position - positions[0], arrival.velocity - edges[0]
        ahead = horizon(plant.motion, positions, edges, facing, error, late, period)

        weighed = (ahead.effect * self._weights[:, None]).swapaxes(1, 2)
        hessian = weighed @ ahead.effect
        hessian.reshape(len(hessian), -1)[:, :: 2 * FRAMES + 1] += 1.0
        gradient = (weighed @ ahead.free[..., None])[..., 0]
        size = np.abs(edges[:-1])
        ways = np.where(size > STILL_M_S, edges[:-1] / np.maximum(size, STILL_M_S), 1.0)
        last = plane(seen.sent.last(1)[0, :, :2]) * plant.turned
        planned, step = ahead.feed_forward - plant.push, limits.acceleration * period
        best, bound = minimise(hessian, gradient, Limits(last, planned, ways, step, limits.speed))
        self.channels["bound"] = bound.astype(float)
        across = pairs(plant.ask(ahead.feed_forward[0] + best[:, 0]))
        rates, straight = twists[:3, :, 2], ahead.feed_forward[0]
        turn = self.turn(rates, edges[:2], facing[0], poses[1, :, 2], arrival.heading, straight)
        return np.concatenate([across, turn[:, None]], axis=1)
