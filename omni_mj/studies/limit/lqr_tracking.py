"""Lead robots along known runs: the learned commands, and feedback on the estimated departure.

A Kalman filter on `DepartureModel` estimates how each robot departs from its run. The firmware's heading has an error
c and its gyro a bias b of which it knows a part. Both follow known laws (`omni_mj.robot.firmware`):

    c(k+1) = c(k) + T b(k) + T g e(k),    b(k+1) = b(k) + T h e(k),    e(k) = heading sent - heading held then

They act like other commands: turned by -c, with -b / (1 + turn gain) too much turn rate. So does a gain by which the
kinematic plant's speeds differ from commands. A linear quadratic regulator acts on the departure predicted at the end
of the dead time, which is optimal for a robot with dead time (D. L. Kleinman, IEEE Trans. Automatic Control 14, 1969).
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from omni_control.kinematics import Array, wrap_angle
from omni_mj.config.faults import ON_WHEELS
from omni_mj.config.scenario import Scenario
from omni_mj.config.settings import PERIOD_S
from omni_mj.studies.limit.deviation_model import SCALE, DeviationModel

POSE, SPEED, DRIFT, COMPASS, BIAS, GAIN = (
    slice(0, 3),
    slice(3, 6),
    slice(6, 9),
    9,
    10,
    slice(11, 14),
)
STATES = 14
TRANSLATION = np.array([1, 1, 0, 1, 1, 0, 1, 1, 0, 0, 0, 1, 1, 1], bool)
DRIFT_DECAY = np.exp(-1 / 30.0)  # per frame
SMALLEST = 2e-6  # m or rad that vision resolves; avoids a division by zero
# Standard deviations per frame of what no linear model foresees: velocity, its lasting part
# (drift), in m/s and rad/s, and the heading that the firmware holds, rad. Those with which poses of
# tigers-v2016 on `rect` are predicted best.
ON_WHEELS_NOISE = np.array([0, 0, 0, 5e-4, 5e-4, 2e-3, 2e-5, 2e-5, 4e-5, 2.5e-4, 0, 0, 0, 0])
ROUNDS = 5  # a disturbance is at most 0.2 of a command, so five rounds leave nothing of it


class Policy(NamedTuple):
    """How feedback is set.

    Attributes:
        weight: Of commands beside departures in the regulator, s^2; its root is about the time to
            make one good.
        noise: Factor of the filter's process noise of translation.
    """

    weight: float
    noise: float = 1.0


class Tracker:
    """Controller of n robots near n runs, called once a frame.

    Args:
        model: Departures, the same for all runs.
        commands: Of the runs, (F, n, 3), or (F, 1, 3) for one run of all.
        poses: Of the runs, same shape.
        scenario: Its noise, radio and firmware.
        policies: One per robot.
    """

    def __init__(
        self,
        model: DeviationModel,
        commands: Array,
        poses: Array,
        scenario: Scenario,
        policies: Sequence[Policy],
    ) -> None:
        n, settings, firmware = len(policies), scenario.settings, scenario.plant in ON_WHEELS
        self._delay, self._start, end = (
            model.delay,
            model.delay + 1,
            [(0, model.delay), (0, 0), (0, 0)],
        )
        self._velocity = np.pad(model.velocity, end, "edge")
        self._push = np.pad(model.command, [(0, 0), *end], "edge")
        self._commands, self._poses = np.pad(commands, [(self._start, 0), (0, 0), (0, 0)]), poses
        self._heading_gain = firmware * PERIOD_S * settings.firmware.heading_gain
        self._bias_gain = firmware * PERIOD_S * settings.firmware.bias_gain
        self._bias_effect = firmware / (1 + settings.firmware.turn_gain)
        vision = settings.vision
        position, heading = (
            max(vision.position_noise_m, SMALLEST),
            max(vision.heading_noise_rad, SMALLEST),
        )
        self._vision_covariance = np.diag(np.square([position, position, heading]))
        noise, gain, self._gain_decay = _process_noise(scenario)
        self._noise = np.array(
            [np.where(TRANSLATION, policy.noise, 1.0) * noise for policy in policies]
        )
        regulators = {
            weight: _regulator(model, weight) for weight in {policy.weight for policy in policies}
        }
        self._gains = np.stack([regulators[policy.weight] for policy in policies], axis=1)
        self._inverse = np.linalg.pinv(self._push.sum(0))
        self._state = np.zeros((n, STATES))
        self._covariance = np.zeros((n, STATES, STATES))
        self._covariance[:, BIAS, BIAS] = firmware * settings.sensors.gyro_bias_rad_s**2
        self._covariance[:, GAIN, GAIN] = gain**2 * np.eye(3)
        self._sent = np.zeros(
            (self._start + model.frames, n, 3)
        )  # before the start too, as of the commands
        self._headings = np.zeros(
            (model.frames, n)
        )  # that were sent, less the robots' own at that time
        self._frame = -1

    def __call__(self, measured: Array, heading: Array, last: Array) -> Array:
        """Return commands (n, 3), before the limits.

        Args:
            measured: Poses that vision reports, (n, 3); NaN where it reports none.
            heading: Sent along with the command, (n,).
            last: Commands sent in the frame before, (n, 3).
        """
        ahead, frame = self.predict(measured, heading, last), self._frame
        acts, now = frame + self._delay, frame + self._start
        before = self._sent[now - 1]
        felt = before - self._commands[now - 1] + self._disturbance(ahead, before, acts)
        state = np.concatenate([ahead[:, POSE], ahead[:, SPEED], felt], axis=1)
        feedback = (self._gains[frame] * state[:, None]).sum(-1)
        desired = command = self._commands[now] - feedback
        for _ in range(ROUNDS):
            command = desired - self._disturbance(ahead, command, acts)
        return command

    def predict(self, measured: Array, heading: Array, last: Array) -> Array:
        """Take in a frame; return the states (n, STATES) predicted for the frame in which its command acts."""
        if self._frame >= 0:
            self._sent[self._frame + self._start] = last
            self._advance_filter()
        self._frame += 1
        pose = self._poses[self._frame]
        self._correct(measured - pose)
        self._headings[self._frame] = wrap_angle(heading - pose[:, 2] - self._state[:, 2])
        ahead = self._state
        for frame in range(self._frame, self._frame + self._delay):
            ahead = self._advanced(ahead, frame)
        return ahead

    def _advance_filter(self) -> None:
        """Advance states and covariances by a frame; `_advanced` is affine, so differences are its Jacobian."""
        states = np.zeros((1 + STATES, *self._state.shape))
        states[1:] = np.eye(STATES)[:, None]
        images = self._advanced(states, self._frame)
        jacobian = (images[1:] - images[0]).transpose(1, 2, 0)
        self._state = self._advanced(self._state, self._frame)
        effect = np.eye(STATES)
        effect[POSE, SPEED] = PERIOD_S * np.eye(3)
        noise = effect * self._noise[:, None] ** 2 @ effect.T
        self._covariance = jacobian @ self._covariance @ jacobian.swapaxes(1, 2) + noise

    def _advanced(self, state: Array, frame: int) -> Array:
        """Return the states (..., n, STATES) a frame later."""
        speed = state[..., SPEED] @ self._velocity[frame].T + state[..., DRIFT]
        for lag, matrix in enumerate(self._push[:, frame]):
            command = self._sent[frame - lag + 1]  # a dead time, and a lag, before
            change = (
                command - self._commands[frame - lag + 1] + self._firmware_error(state, command)
            )
            speed = speed + change @ matrix.T
        later = state.copy()
        later[..., SPEED] = speed
        later[..., POSE] += PERIOD_S * speed
        later[..., DRIFT] *= DRIFT_DECAY
        later[..., GAIN] *= self._gain_decay
        bias = state[..., BIAS]
        later[..., COMPASS] += PERIOD_S * bias
        if frame >= self._delay:
            sent = self._headings[frame - self._delay]
            error = sent - state[..., COMPASS] + self._delay * PERIOD_S * bias
            later[..., COMPASS] += self._heading_gain * error
            later[..., BIAS] += self._bias_gain * error
        return later

    def _firmware_error(self, state: Array, command: Array) -> Array:
        """Return the change of the command (..., n, 3) that compass error, gyro bias and gain amount to."""
        compass, bias = state[..., COMPASS], state[..., BIAS]
        parts = compass * command[:, 1], -compass * command[:, 0], -self._bias_effect * bias
        return np.stack(parts, axis=-1) + state[..., GAIN] * command

    def _disturbance(self, state: Array, command: Array, frame: int) -> Array:
        """Return the change of the command (n, 3) that all disturbances amount to when it acts."""
        return self._firmware_error(state, command) + state[:, DRIFT] @ self._inverse[frame].T

    def _correct(self, surprise: Array) -> None:
        """Condition states and covariances on the poses that vision reports, less those of the runs (n, 3)."""
        surprise = surprise - self._state[:, POSE]
        surprise[:, 2] = wrap_angle(surprise[:, 2])
        seen = ~np.isnan(surprise[:, 0])
        innovation = self._covariance[:, POSE, POSE] + self._vision_covariance
        gain = (
            np.linalg.solve(innovation, self._covariance[:, POSE]).swapaxes(1, 2)
            * seen[:, None, None]
        )
        self._state = self._state + (gain @ np.nan_to_num(surprise)[..., None])[..., 0]
        covariance = self._covariance - gain @ self._covariance[:, POSE]
        self._covariance = (covariance + covariance.swapaxes(1, 2)) / 2


def _process_noise(scenario: Scenario) -> tuple[Array, float, float]:
    """Return the standard deviation of the noise that acts on each state in a frame, (STATES,).

    Returns:
        These; the standard deviation of the gain by which speeds differ from commands, and its
        decay per frame.
    """
    settings, sizes = scenario.settings, np.zeros(STATES)
    if scenario.plant in ON_WHEELS:
        gyro = settings.sensors.gyro_noise_rad_s
        sizes[SPEED] = settings.disturbance.force_n / settings.body.mass_kg * PERIOD_S / 3**0.5
        sizes[5], sizes[COMPASS] = gyro / (1 + settings.firmware.turn_gain), PERIOD_S * gyro
        return np.hypot(sizes, ON_WHEELS_NOISE), 0.0, 1.0
    kinematic = settings.kinematic
    sizes[SPEED], sizes[DRIFT] = 1e-9 + settings.disturbance.velocity_m_s / 3**0.5, 1e-9
    gain = (
        (kinematic.alpha_high - kinematic.alpha_low)
        / (kinematic.alpha_high + kinematic.alpha_low)
        / 3**0.5
    )
    decay = float(np.exp(-PERIOD_S / kinematic.alpha_time_s)) if kinematic.alpha_time_s else 0.0
    sizes[GAIN] = gain * (1 - decay**2) ** 0.5
    return sizes, gain, decay


def _regulator(model: DeviationModel, weight: float) -> Array:
    """Return gains K (F, 3, 9) of du(k) = -K(k) [dp, dv, du(k-1)] at the time at which du(k) acts.

    They minimize the sum over frames of |dp|^2 + weight |du|^2, turns counted at an arm's length.
    """
    state_cost, command_cost = np.zeros((9, 9)), weight * np.diag(SCALE**2)
    state_cost[POSE, POSE] = np.diag(SCALE**2)
    gains, cost = np.zeros((model.frames, 3, 9)), state_cost
    for k in range(model.frames - 1, model.delay - 1, -1):
        matrix, effect = np.zeros((9, 9)), np.zeros((9, 3))
        matrix[SPEED, SPEED], matrix[SPEED, 6:] = model.velocity[k], model.command[1, k]
        effect[SPEED], effect[6:] = model.command[0, k], np.eye(3)
        matrix[POSE], effect[POSE] = PERIOD_S * matrix[SPEED], PERIOD_S * effect[SPEED]
        matrix[POSE, POSE] += np.eye(3)
        gain = np.linalg.solve(command_cost + effect.T @ cost @ effect, effect.T @ cost @ matrix)
        cost = state_cost + matrix.T @ cost @ (matrix - effect @ gain)
        gains[k - model.delay] = gain
    gains[max(model.frames - model.delay, 0) :] = gains[max(model.frames - model.delay - 1, 0)]
    return gains
