"""Two classics to compare with: proportional control, and the Smith predictor that takes the dead time out of it."""

from omni_control.controllers.base import Controller, Seen, Told
from omni_control.controllers.nominal import NominalRobot, pose_error
from omni_control.kinematics import Array
from omni_control.reference import Reference


def simc_gain(latency_s: float) -> float:
    """Proportional gain K = 1 / (2 latency), 1/s, for an integrator behind `latency_s`.

    The SIMC rule for tight control, tau_c = theta (S. Skogestad, Simple analytic rules for model reduction and PID
    controller tuning, J. Process Control 13, 2003): a phase margin of 61 degrees and a gain margin of pi.
    """
    return 1 / (2 * latency_s)


class Proportional(Controller):
    """p: proportional control with the reference velocity as feed-forward, its gain by the SIMC rule.

    Like FLC it compares the pose of now with the reference of now. To the latency the gain is for counts a frame more:
    half of one is how long a command is held on average, and half of one how well a dead time is known in frames.
    """

    def __init__(self, told: Told, reference: Reference, n: int) -> None:
        super().__init__(told, reference, n)
        self.gain = simc_gain((told.latency_frames + 1) * told.period)

    def command(self, frame: int, seen: Seen) -> Array:
        """See `Controller`."""
        self.predicted = seen.pose
        target, feed_forward = self.reference.at(frame, seen.pose)
        return feed_forward + self.gain * pose_error(target, seen.pose)


class Smith(Controller):
    """smith: Smith predictor, proportional control of a nominal robot without dead time, corrected by vision.

    What is fed back is the model without dead time plus what vision saw less the model with it (O. J. M. Smith, Closer
    control of loops with dead time, Chem. Eng. Progress 53, 1957). The robot integrates, so that both models differ by
    what the commands in flight add. The feed-forward is that of the time when the robot answers.

    The gain is by the SIMC rule for the lag and a frame, which are left of the latency; see `Proportional`. As
    known of Smith's predictor for a plant that integrates, it does not remove the error by a lasting disturbance, such
    as drag (K. Watanabe and M. Ito, IEEE Trans. Automatic Control 26, 1981).
    """

    def __init__(self, told: Told, reference: Reference, n: int) -> None:
        super().__init__(told, reference, n)
        self.gain = simc_gain(told.lag_s + told.period)
        self.robot = NominalRobot(told, n)

    def command(self, frame: int, seen: Seen) -> Array:
        """See `Controller`."""
        self.robot.advance(seen.sent)
        self.predicted, _ = self.robot.at_the_end_of_the_dead_time(seen.pose, seen.in_flight)
        target, feed_forward = self.reference.at(frame + self.told.latency_frames, self.predicted)
        target = target - self.told.lag_s * feed_forward  # from the end of the lag back to the end of the dead time
        return feed_forward + self.gain * pose_error(target, self.predicted)
