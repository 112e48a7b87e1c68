"""How robots turn, and the heading that they have: a Kalman filter that knows the commands.

    tau w' = u + b - g w

u is the turn rate that acts, g the command per rate (the inverse of the motor correction factor alpha_3), tau the lag,
and b what else turns the robot: the gyro's bias, a wheel that is weak, a centre of mass beside the middle.
"""

import numpy as np

from omni_control.kinematics import Array, wrap_angle

BIAS_RAD_S, BIAS_S = 0.05, 1.0  # standard deviation of b, and the time after which it is forgotten
EFFORT_SIGMA = 0.05  # of g = 1
LAG_SHARE = 0.7  # of the wheel loops' lag, which a gyro's loop makes quicker
LAG_SIGMA = 0.3  # of the lag, relative to that of the wheel loops, and s
KEPT_S = 12.0  # after which parameters are what was believed
RATE_RAD_S2 = 1.5  # standard deviation of what the law does not know of w'
LEAST_LAG_S = 1e-3
EFFORT_BOUNDS, LONGEST_LAG_S = (0.8, 1.5), 0.1


class Turning:
    """Headings of n robots.

    Args:
        heading: at the start, (n,) rad.
        period: length of a frame, s.
        noise: standard deviation of the heading that vision reports, rad.
        lag: what the lag of the wheel loops is believed to be, s.

    Attributes:
        heading, rate: (n,) rad and rad/s; headings count full turns.
        bias: b, (n,) rad/s.
        lag: tau, (n,) s.
        effort: g, (n,).
        variance: of heading, rate, bias, lag and effort, (n, 5, 5).
    """

    def __init__(self, heading: Array, period: float, noise: float, lag: float) -> None:
        n = len(heading)
        self.heading, self.rate, self.bias = heading.copy(), np.zeros(n), np.zeros(n)
        believed = max(LAG_SHARE * lag, LEAST_LAG_S)
        self._belief = np.array([0.0, believed, 1.0])  # of bias, lag and effort
        self.lag, self.effort = np.full(n, believed), np.ones(n)
        self._period, self._noise = period, max(noise, 1e-3) ** 2
        sigma = np.array([BIAS_RAD_S, 1e-6 + LAG_SIGMA * lag, EFFORT_SIGMA])
        keep = np.exp(-period / np.array([BIAS_S, KEPT_S, KEPT_S]))
        self._keep, self._forget = keep, np.append([0.0, (RATE_RAD_S2 * period) ** 2], sigma**2 * (1 - keep**2))
        self._kept = np.append([1.0, 0.0], keep)  # of each state, by itself
        self.variance = np.zeros((n, 5, 5))
        self.variance[:, range(5), range(5)] = np.append([self._noise, 0.0], sigma**2)

    @property
    def sigma(self) -> Array:
        """Standard deviation of heading, rate, bias, lag and effort, (n, 5)."""
        return np.sqrt(np.maximum(np.diagonal(self.variance, axis1=1, axis2=2), 0.0))

    def step(self, heading: Array, rate: Array, command: Array, duration: float | Array) -> tuple[Array, Array]:
        """Headings and rates (n,) after a `duration`, s, one or (n,), with a `command` (n,) in rad/s."""
        lag = self.lag / self.effort
        decay, final = np.exp(-duration / lag), (command + self.bias) / self.effort
        excess = rate - final
        return heading + duration * final + excess * (1 - decay) * lag, final + excess * decay

    def follow(self, commands: Array, durations: Array) -> Array:
        """Headings (count + 1, n) from now on, after one command (count, n) and its duration (count, n) after another.

        As by `step` after `step`; commands that act for no time change nothing, not even by rounding.
        """
        lag = self.lag / self.effort
        decay, final = np.exp(-durations / lag), (commands + self.bias) / self.effort
        rates = [self.rate]
        for kept, gained in zip(decay, (1 - decay) * final, strict=True):
            rates.append(kept * rates[-1] + gained)
        reached = np.array(rates)
        moved = durations * final + lag * (reached[:-1] - reached[1:])
        return np.add.accumulate(np.concatenate([self.heading[None], moved]))

    def ask(self, before: Array, after: Array) -> Array:
        """Commands (n,) that lead from rates `before` to `after` in a frame: the inverse of `step`, rad/s."""
        decay = np.exp(-self._period * self.effort / self.lag)
        return (after - decay * before) * self.effort / (1 - decay) - self.bias

    def update(self, measured: Array, command: Array) -> None:
        """Take in a frame.

        Args:
            measured: headings seen by vision (n,) rad, not a number where a robot was not seen.
            command: turn rates that acted since the frame before, (n,) rad/s.
        """
        period, lag = self._period, self.lag / self.effort
        decay = np.exp(-period / lag)
        carried = (1 - decay) * lag
        gained, moved = (1 - decay) / self.effort, (period - carried) / self.effort  # by a command of 1
        heading, rate = self.step(self.heading, self.rate, command, period)
        # A change of bias, lag or effort acts like a command of: 1, -w', -w.
        acts = np.array([np.ones_like(rate), (self.rate - rate) / period, -(self.rate + rate) / 2])
        passed = np.zeros_like(self.variance)
        passed.reshape(-1, 25)[:, ::6] = self._kept
        passed[:, 0, 1], passed[:, 1, 1] = carried, decay
        passed[:, :2, 2:] = (np.array([moved, gained])[:, None] * acts).transpose(2, 0, 1)
        state = np.array([heading, rate, self.bias, self.lag, self.effort]).T
        state[:, 2:] = self._belief + self._keep * (state[:, 2:] - self._belief)
        variance = passed @ self.variance @ passed.swapaxes(1, 2)
        variance.reshape(-1, 25)[:, ::6] += self._forget

        seen = ~np.isnan(measured)
        surprise = np.where(seen, wrap_angle(measured - heading), 0.0)
        gain = np.where(seen, 1 / (variance[:, 0, 0] + self._noise), 0.0)[:, None] * variance[:, :, 0]
        self.variance = variance - gain[:, :, None] * variance[:, 0, None, :]
        self.heading, self.rate, self.bias, lag, effort = (state + gain * surprise[:, None]).T
        self.lag = np.minimum(np.maximum(lag, LEAST_LAG_S), LONGEST_LAG_S)
        self.effort = np.minimum(np.maximum(effort, EFFORT_BOUNDS[0]), EFFORT_BOUNDS[1])
