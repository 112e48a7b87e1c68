"""Where robots will be when a command acts: the best linear estimate of how they have departed from a known run.

A Kalman filter on `Deviations`, with what a run with noise adds to them. Vision's heading corrects the firmware's, late
and noisy, and the gyro turns it: the firmware has a compass error c, by which it turns all commands, and a bias b of
the gyro of which it knows a part. Both follow laws that are known (`onboard.heading.HeadingEstimate`),

    c(k+1) = c(k) + T b(k) + T g e(k),    b(k+1) = b(k) + T h e(k),    e(k) = heading sent - own heading at that time,

and what was sent is known as well. They act as if other commands were sent: turned by -c, and by -b / (1 + turn gain)
too much. So the filter sees through the firmware, as far as vision lets it.
"""

import numpy as np

from omni_control.kinematics import Array, wrap_angle
from omni_mj.scenarios.settings import PERIOD_S, Settings
from omni_mj.studies.limit.deviations import ORDER, Deviations
from omni_mj.studies.limit.unknowns import Unknowns, seen_with

POSE, SPEED, DRIFT, COMPASS, BIAS, GAIN = slice(0, 3), slice(3, 6), slice(6, 9), 9, 10, slice(11, 14)
STATES = 14
DRIFT_FRAMES = 30.0  # after which a drift has fallen to 1/e
TURN = np.array([0.0, 0.0, 1.0])


class Predictor:
    """Called once a frame for n robots near n runs.

    Args:
        deviations: of the runs, the same for all.
        commands: that the runs were sent, (F, n, 3).
        poses: of the runs, (F, n, 3).
        settings: of noise, radio and firmware.
        unknowns: how much of what is unknown.
        firmware: whether there is one, with a compass.

    Attributes:
        state: how the robots have departed by now, (n, STATES).
    """

    def __init__(
        self,
        deviations: Deviations,
        commands: Array,
        poses: Array,
        settings: Settings,
        unknowns: Unknowns,
        firmware: bool,
    ) -> None:
        n = commands.shape[1]
        self._deviations, self._commands, self._poses = deviations, commands, poses
        self._delay, self._last = deviations.delay, deviations.frames - 1
        on_board, sensors = settings.firmware, settings.sensors
        self._heading_gain = firmware * PERIOD_S * on_board.heading_gain
        self._bias_gain = firmware * PERIOD_S * on_board.bias_gain
        self._resists = firmware / (1 + on_board.turn_gain)
        self._seen = np.diag(seen_with(settings) ** 2)
        self._keep_gain = np.exp(-1 / unknowns.gain_frames)
        self._noise = _noise(unknowns, firmware * sensors.gyro_noise_rad_s, self._keep_gain, n)
        self._undone = np.linalg.pinv(deviations.push.sum(0))
        self.state = np.zeros((n, STATES))
        self._covariance = np.zeros((n, STATES, STATES))
        self._covariance[:, BIAS, BIAS] = firmware * sensors.gyro_bias_rad_s**2
        for i in range(GAIN.start, GAIN.stop):
            self._covariance[:, i, i] = unknowns.gain**2
        self._sent = np.zeros((self._delay + ORDER, n, 3))  # newest last
        self._headings = np.zeros((self._delay + 1, n))  # that were sent, less the robots' own, newest last
        self._frame, self._count = -1, 0

    def see(self, measured: Array, heading: Array) -> Array:
        """Take in a frame and return the states (n, STATES) in the frame in which the command acts that is sent now.

        Args:
            measured: poses that vision reports (n, 3), not a number where there are none.
            heading: that the team sends with its commands, (n,).
        """
        if self._frame >= 0:
            matrix, noise = self._matrices(self._frame)
            self.state = self._advanced(self.state, self._frame, self._headings[0])
            self._covariance = matrix @ self._covariance @ matrix.swapaxes(1, 2) + noise @ noise.swapaxes(1, 2)
        self._frame += 1
        pose = self._poses[min(self._frame, self._last)]
        self._correct(measured - pose)
        beside = wrap_angle(heading - pose[:, 2] - self.state[:, 2])
        self._headings = np.concatenate([self._headings[1:], beside[None]])
        ahead = self.state
        for later in range(self._delay):
            ahead = self._advanced(ahead, self._frame + later, self._headings[later])
        return ahead

    def sent(self, command: Array) -> None:
        """Say what commands (n, 3) are sent in this frame, within the limits."""
        self._sent, self._count = np.concatenate([self._sent[1:], command[None]]), self._count + 1

    def disturbed(self, state: Array, command: Array) -> Array:
        """Commands (n, 3) that would do, added to a `command`, what states do to robots when it acts.

        Args:
            state: in the frame in which what is sent now acts, (n, STATES).
            command: that is sent now, or was in the frame before, (n, 3).
        """
        frame = min(self._frame + self._delay, self._last)
        return self._besides(state, command) + _times(self._undone[frame], state[:, DRIFT])

    @property
    def planned(self) -> Array:
        """Commands of the runs in this frame, (n, 3)."""
        return self._planned(self._frame)

    @property
    def before(self) -> tuple[Array, Array]:
        """Commands sent in the frame before, and those of the runs, (n, 3) each."""
        return self._at(self._frame - 1), self._planned(self._frame - 1)

    def _advanced(self, state: Array, frame: int, heading: Array) -> Array:
        """States (n, STATES) a frame later; `heading` (n,) arrives in it, less the robots' own when it was sent."""
        keep, push = self._matrix(frame)
        speed = _times(keep, state[:, SPEED]) + state[:, DRIFT]
        for j, b in enumerate(push):
            when = frame - self._delay - j
            command = self._at(when)
            speed = speed + _times(b, command - self._planned(when) + self._besides(state, command))
        drift = np.exp(-1 / DRIFT_FRAMES) * state[:, DRIFT]
        compass, bias = state[:, COMPASS], state[:, BIAS]
        error = np.zeros_like(compass)
        if frame >= self._delay:
            error = heading - compass + self._delay * PERIOD_S * bias
        turned = compass + PERIOD_S * bias + self._heading_gain * error
        later = [state[:, POSE] + PERIOD_S * speed, speed, drift, turned[:, None]]
        return np.concatenate(
            [*later, (bias + self._bias_gain * error)[:, None], self._keep_gain * state[:, GAIN]], axis=1
        )

    def _besides(self, state: Array, command: Array) -> Array:
        """What compass, bias and gain do to a robot that is sent a command (n, 3), as one that is added to it."""
        compass, bias = state[:, [COMPASS]], state[:, [BIAS]]
        aside = np.stack([command[:, 1], -command[:, 0], np.zeros(len(command))], axis=1)
        return compass * aside + state[:, GAIN] * command - self._resists * bias * TURN

    def _matrices(self, frame: int) -> tuple[Array, Array]:
        """Derivative of `_advanced`, (n, STATES, STATES), and what noise does in the frame, (n, STATES, noises)."""
        n, (keep, push) = len(self.state), self._matrix(frame)
        matrix = np.broadcast_to(np.eye(STATES), (n, STATES, STATES)).copy()
        matrix[:, SPEED, SPEED], matrix[:, SPEED, DRIFT] = keep, np.eye(3)
        for j, b in enumerate(push):
            command = self._at(frame - self._delay - j)
            aside = np.stack([command[:, 1], -command[:, 0], np.zeros(n)], axis=1)
            matrix[:, SPEED, COMPASS] += _times(b, aside)
            matrix[:, SPEED, BIAS] -= self._resists * b[:, 2]
            matrix[:, SPEED, GAIN] += b * command[:, None]
        matrix[:, POSE, 3:] += PERIOD_S * matrix[:, SPEED, 3:]
        matrix[:, DRIFT, DRIFT] *= np.exp(-1 / DRIFT_FRAMES)
        matrix[:, GAIN, GAIN] *= self._keep_gain
        matrix[:, COMPASS, BIAS] = PERIOD_S
        if frame >= self._delay:
            for row, gain in ((COMPASS, self._heading_gain), (BIAS, self._bias_gain)):
                matrix[:, row, COMPASS] -= gain
                matrix[:, row, BIAS] += gain * self._delay * PERIOD_S
        noise = self._noise.copy()
        noise[:, SPEED, 0] = -self._resists * push[:, :, 2].sum(0) * noise[:, [COMPASS], 0] / PERIOD_S
        noise[:, SPEED, 11:] *= np.abs(self._at(frame - self._delay))[:, None]
        noise[:, POSE] = PERIOD_S * noise[:, SPEED]
        return matrix, noise

    def _correct(self, surprise: Array) -> None:
        surprise = surprise - self.state[:, POSE]
        surprise[:, 2] = wrap_angle(surprise[:, 2])
        seen = ~np.isnan(surprise[:, 0])
        gain = np.linalg.solve(self._covariance[:, POSE, POSE] + self._seen, self._covariance[:, POSE])
        gain = gain.swapaxes(1, 2) * seen[:, None, None]
        self.state = self.state + (gain * np.nan_to_num(surprise)[:, None]).sum(-1)
        covariance = self._covariance - gain @ self._covariance[:, POSE]
        self._covariance = (covariance + covariance.swapaxes(1, 2)) / 2

    def _at(self, frame: int) -> Array:
        """Commands (n, 3) that were sent in a frame, which may be before the first."""
        return self._sent[frame - self._count]

    def _planned(self, frame: int) -> Array:
        """Those of the runs."""
        return self._commands[min(frame, self._last)] if frame >= 0 else np.zeros_like(self._commands[0])

    def _matrix(self, frame: int) -> tuple[Array, Array]:
        """A and B of a frame, (3, 3) and (ORDER, 3, 3)."""
        frame = min(frame, self._last)
        return self._deviations.keep[frame], self._deviations.push[:, frame]


def _noise(unknowns: Unknowns, gyro: float, keep_gain: float, n: int) -> Array:
    """What each independent noise of a frame adds to states, (n, STATES, noises): gyro, speed, drift, compass, gain."""
    noise = np.zeros((n, STATES, 14))
    noise[:, COMPASS, 0] = PERIOD_S * gyro
    for i in range(3):
        for column, state, size in (
            (1 + i, SPEED.start + i, unknowns.turn if i == 2 else unknowns.speed),
            (4 + i, DRIFT.start + i, unknowns.turn_drift if i == 2 else unknowns.drift),
            (8 + i, GAIN.start + i, unknowns.gain * np.sqrt(1 - keep_gain**2)),
            (11 + i, SPEED.start + i, unknowns.jolt),
        ):
            noise[:, state, column] = np.ravel(size)
    noise[:, COMPASS, 7] = np.ravel(unknowns.compass)
    return noise


def _times(matrix: Array, vectors: Array) -> Array:
    """A matrix (3, 3) times vectors (n, 3): a sum, which does not depend on how many there are."""
    return (matrix * vectors[:, None]).sum(-1)
