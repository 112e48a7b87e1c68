"""How robots turn, and the heading that they have: a Kalman filter that knows the commands.

    (tau + g T_w s) w' = u + b - k e - c_w n - g w        s = sqrt(v^2 + (l w)^2),   n = l w / s

u is the turn rate that acts, g the command per rate (the inverse of the motor correction factor alpha_3), tau the lag,
and b what else turns the robot: the gyro's bias, a wheel that is weak, a centre of mass beside the middle.

Wheels at an arm l travel at s. They creep the more the faster that is, so that a robot turns later while it drives; and
dry friction, which acts against their travel, costs turn rate as far as turning is what they travel for. All are those
of driving forward (`motion`; direction cosines d of the wheels' drive) for a body of yaw inertia J that turns:

    tau, T_w = share J / (m l^2) mean(d^2) of tau, T       c_w = share c / l mean(d^2) / mean(|d|)

A loop on the gyro of gain k, of which every robot has one, leaves a share of 1 / (1 + k). Rates follow commands
so soon that s and n are told by the commands, of whole runs at once.

k couples turning with driving: e is what a robot's velocity lacks of the one that is commanded, ahead and aside, which
is how much its wheels give way under what they pull. What follows for turning from their geometry (`compliance`) is
part of u here; k is what is left of it, because a wheel is weak, or the centre of mass not where it is believed to be.
Nobody is told k: it is believed to be 0.

Commands act a latency after they were sent, which positions tell as well (`identify`): both filters share it. Given the
latency, neither knows anything that the other lacks, so that each may take in what the other learned of it: `update`
says what headings did, and `agree` takes what then is known. Only turning that is evident tells: small commands answer
to the noise of headings, and look as if robots had answered to them, sooner than they do.

Wheels that slide, one after the other, turn a robot as no robot of this law would. Of what then is seen, and of what
surprises, parameters take in a share only (Brink, Partial-Update Schmidt-Kalman Filter, J. Guidance, Control, and
Dynamics 40, 2017), and b, which is soon forgotten, may be greater.
"""

import numpy as np

from omni_control.estimation import belief, evidence
from omni_control.estimation.hearsay import conditioned
from omni_control.estimation.late import Late
from omni_control.estimation.motion import Plane
from omni_control.kinematics import Array, Kinematics, Number, wrap_angle

BIAS_RAD_S, BIAS_S = 0.05, 1.0  # standard deviation of b, and the time after which it is forgotten
SLIDING_RAD_S = 0.4  # what wheels that slide add to it
EFFORT, EFFORT_SIGMA = 1.02, 0.05
GYRO_SHARE = 0.5  # that a gyro's loop leaves: gain 1
LAG_SIGMA = 0.3  # of the lag, relative to what a gyro's loop leaves of that of the wheel loops
FRICTION, FRICTION_SIGMA = 0.8, 0.6  # of what it is told to be at most, and relative to that
COUPLING_RAD_M = 0.25  # standard deviation of k
RATE_RAD_S2 = 1.5  # standard deviation of what the law does not know of w'
LEAST_LAG_S = 1e-3
LEAST, MOST = np.array([[LEAST_LAG_S, 0.8, 0.0, -1.0, -1.0], [0.1, 1.9, 0.8, 1.0, 1.0]])  # of what is bounded below
STATES = 9  # heading, rate, bias; lag, effort, friction, coupling ahead and aside; latency beyond what is told, frames
LATENCY = 8
INERTIA = 0.7  # J / (m l^2): TIGERs Mannheim's for their robots
ARM_M, MEAN_COSINE, MEAN_SQUARE = 0.08, 0.787, 5 / 8  # of most robots: wheels at 60, 135, 225 and 300 degrees
RUBBED_M_S = 0.03  # travel of wheels from which dry friction is all there


class Turning:
    """Headings of n robots.

    Args:
        heading: at the start, (n,) rad.
        period: length of a frame, s.
        noise: standard deviation of the heading that vision reports, rad.
        lag: what the lag of the wheel loops is believed to be, s.
        friction: what dry friction may cost robots that drive forward of their speed, m/s.
        geometry: of the wheels; None: that of most robots of the league.
        tells: whether headings tell of the latency. They do not where nobody knows what robots reach of what is asked:
            one that turns less looks as if it were late.

    Attributes:
        heading, rate: (n,) rad and rad/s; headings count full turns.
        creep: of wheels that drive forward, over the acceleration g^2 T, as others know it, (n,) s^2/m.
        bias: b, (n,) rad/s.
        lag: tau, (n,) s.
        effort: g, (n,).
        friction: c_w, (n,) rad/s.
        coupling: k ahead and aside, (2, n) rad/m.
        variance: of heading, rate, bias, lag, effort, friction, coupling and latency, (n, 9, 9).
        surprise: square of the innovations over what the filter expects, (n,); 1 for a robot that keeps to the law.
    """

    def __init__(
        self,
        heading: Array,
        period: float,
        noise: float,
        lag: float,
        friction: float = 0.0,
        geometry: Kinematics | None = None,
        tells: bool = False,
    ) -> None:
        n, self.tells = len(heading), tells
        cosines = None if geometry is None else geometry.matrix[:, 0]
        self._arm = ARM_M if geometry is None else geometry.arm
        square = MEAN_SQUARE if cosines is None else float((cosines**2).mean())
        size = MEAN_COSINE if cosines is None else float(np.abs(cosines).mean())
        self._creeps = GYRO_SHARE * INERTIA * square
        friction *= GYRO_SHARE / self._arm * square / size
        turning_lag = belief.LAG_SHARE * self._creeps * lag
        self._belief = np.array([0.0, max(turning_lag, LEAST_LAG_S), EFFORT, FRICTION * friction, 0.0, 0.0, 0.0])
        self.creep, self.surprise = np.zeros(n), np.ones(n)
        self._know(np.concatenate([heading[:, None], np.zeros((n, 1)), np.tile(self._belief, (n, 1))], axis=1))
        self._period, self._noise = period, max(noise, 1e-3) ** 2
        lags, rubs = LAG_SIGMA * GYRO_SHARE * lag + 1e-6, FRICTION_SIGMA * friction + 1e-6
        couplings = COUPLING_RAD_M, COUPLING_RAD_M
        sigma = np.array([BIAS_RAD_S, lags, EFFORT_SIGMA, rubs, *couplings, belief.LATENCY_FRAMES])
        keep = np.exp(-period / np.append(BIAS_S, np.full(STATES - 3, belief.KEPT_S)))
        self._keep, self._forget = keep, np.append([0.0, (RATE_RAD_S2 * period) ** 2], sigma**2 * (1 - keep**2))
        self._slid = (SLIDING_RAD_S / BIAS_RAD_S) ** 2 * self._forget[2]
        self._kept = np.append([1.0, 0.0], keep)  # of each state, by itself; a rate depends on others too
        self._renewed = (1 - self._kept) * np.append([0.0, 0.0], self._belief)
        self._passed = np.tile(np.diag(self._kept), (n, 1, 1))  # how states depend on those a frame before
        self._acts = np.empty((n, STATES - 3))  # what lag, effort, friction, coupling and latency do like a command
        self.variance = np.zeros((n, STATES, STATES))
        self.variance[:, range(STATES), range(STATES)] = np.append([self._noise, 0.0], sigma**2)

    @property
    def sigma(self) -> Array:
        """Standard deviation of heading, rate, bias, lag, effort, friction, coupling and latency, (n, 9)."""
        return np.sqrt(np.maximum(self.variance.reshape(-1, STATES**2)[:, :: STATES + 1], 0.0))

    def _know(self, state: Array) -> None:
        """Take the state (n, 9) for what is known."""
        self._state = state
        self.heading, self.rate, self.bias, self.lag, self.effort, self.friction = state.T[:6]
        self.coupling = state.T[6:LATENCY]

    def _turned(self, shortfall: Plane | complex) -> Array:
        """What turns robots like a command, rad/s: bias, and driving."""
        ahead, aside = self.coupling
        return driven(self.bias, ahead, aside, shortfall)

    def _answer(self, command: Array, speed: Array, shortfall: Plane | complex = 0j) -> tuple[Array, Array, Array]:
        """See `answer`."""
        still, slower = self.lag / self.effort, self.effort * self._creeps * self.creep
        turned = self._turned(shortfall)
        return answer(command, speed, turned, still, slower, self.effort, self.friction, self._arm)

    def step(
        self,
        heading: Array,
        rate: Array,
        command: Array,
        duration: float | Array,
        speed: Array,
        shortfall: Plane | complex = 0j,
    ) -> tuple[Array, Array]:
        """Headings and rates after a while.

        Args:
            heading: before, (n,) rad.
            rate: before, (n,) rad/s.
            command: turn rates that act, (n,) rad/s.
            duration: s, one or (n,).
            speed: at which robots drive, (n,) m/s.
            shortfall: of velocities, e, (n,) m/s, ahead and aside of robots as real and imaginary parts.
        """
        late, final, _ = self._answer(command, speed, shortfall)
        moved, rate, _ = go_on(rate, final, late, duration)
        return heading + moved, rate

    def follow(self, commands: Array, durations: Array, speeds: Array, shortfalls: Plane | complex = 0j) -> Array:
        """Headings (count + 1, n) from now on, after commands, each with duration, speed and shortfall (count, n).

        As by `step` after `step`; commands that act for no time change nothing, not even by rounding.
        """
        late, final, _ = self._answer(commands, speeds, shortfalls)
        decay = np.exp(-durations / late)
        reached = np.empty((len(commands) + 1, len(self.rate)))
        reached[0] = self.rate
        for before, kept, gained, after in zip(reached, decay, (1 - decay) * final, reached[1:], strict=False):
            np.add(kept * before, gained, out=after)
        moved = durations * final + late * (reached[:-1] - reached[1:])
        return np.add.accumulate(np.concatenate([self.heading[None], moved]))

    def ask(self, before: Array, after: Array, speed: Array, shortfall: Plane | complex = 0j) -> Array:
        """Commands (n,) that lead from rates `before` to `after`, rad/s, in a frame, driving so; see `step`."""
        late, _, rubbing = self._answer((before + after) / 2, speed, shortfall)
        decay, turned = np.exp(-self._period / late), self._turned(shortfall)
        return asked(before, after, decay, self.effort, turned, self.friction * rubbing)

    def update(
        self,
        measured: Array,
        command: Array,
        speed: Array,
        late: Late | None = None,
        shortfall: Plane | complex = 0j,
        sliding: Array | float = 0.0,
        later: Array | float = 0.0,
    ) -> tuple[Array, Array]:
        """Take in a frame; say what the heading told of the latency.

        Args:
            measured: headings seen by vision (n,) rad, not a number where a robot was not seen.
            command: turn rates that acted since the frame before, (n,) rad/s.
            speed: at which robots drove meanwhile, (n,) m/s.
            late: which robots stay in the frame where they are, and how much later they were seen. [none, and at once]
            shortfall: as for `step`.
            sliding: how far wheels are believed to slide, 0 to 1, (n,). [not]
            later: by how much more commands a frame of latency later would have turned robots, (n,) rad/s. [as much]

        Returns:
            By how many frames it is longer than was thought, and what share of its variance is left, (n,) each.
        """
        period, (slow, final, rubbing) = self._period, self._answer(command, speed, shortfall)
        moved, rate, decay = go_on(self.rate, final, slow, period)
        change, passed, acts = (self.rate - rate) / period, self._passed, self._acts
        passed[:, 1, 1], passed[:, 1, 2] = decay, (1 - decay) / self.effort  # of a rate, and gained by a command of 1
        passed[:, 0, 1] = carried = (1 - decay) * slow
        passed[:, 0, 2] = (period - carried) / self.effort
        # A change of bias, lag, effort, friction, couplings, latency acts like a command of 1, -w', -w, -n, -e, later.
        acts[:, 0], acts[:, 1], acts[:, 2] = change, -(self.rate + rate) / 2, -rubbing
        acts[:, 3], acts[:, 4] = -shortfall.real, -shortfall.imag
        acts[:, 5] = later * evidence.evident(self._arm * np.abs(self.rate)) * self.tells
        np.multiply(passed[:, :2, 2:3], acts[:, None], out=passed[:, :2, 3:])
        state = self._kept * self._state + self._renewed
        state[:, 0], state[:, 1] = self.heading + moved, rate
        variance = passed @ self.variance @ passed.swapaxes(1, 2)
        variance.reshape(-1, STATES**2)[:, :: STATES + 1] += self._forget
        variance[:, 1, 1] += self._forget[1] * (evidence.restless(self.surprise) - 1)
        variance[:, 2, 2] += self._slid * sliding

        if late is not None:
            state = np.where(late.held[:, None], self._state, state)
            variance = np.where(late.held[:, None, None], self.variance, variance)
        seen, expected, to_heading = ~np.isnan(measured), state[:, 0], variance[:, 0]
        of_seen = to_heading[:, 0]
        if late is not None:
            expected = expected + late.after * state[:, 1]
            to_heading = to_heading + late.after[:, None] * variance[:, 1]
            of_seen = to_heading[:, 0] + late.after * to_heading[:, 1]
        surprise = np.where(seen, wrap_angle(measured - expected), 0.0)
        certain = seen / (of_seen + self._noise)
        now = evidence.surprised(self.surprise, certain * surprise**2)
        self.surprise = np.where(seen, now, self.surprise)
        gain, left = certain[:, None] * to_heading, np.zeros_like(state)
        left[:, 3:] = 1 - evidence.learned(sliding, self.surprise)[:, None]  # of what is learned
        thought, doubt = state[:, LATENCY].copy(), variance[:, LATENCY, LATENCY]
        self.variance = variance - gain[:, :, None] * to_heading[:, None] * (1 - left[:, :, None] * left[:, None])
        state += (1 - left) * gain * surprise[:, None]
        self._know(_bounded(state))
        return state[:, LATENCY] - thought, self.variance[:, LATENCY, LATENCY] / doubt

    def agree(self, latency: Array, variance: Array) -> None:
        """Take the latency beyond what is told, (n,) frames, with its variance (n,), for what is known of it now."""
        longer, left = latency - self._state[:, LATENCY], variance / self.variance[:, LATENCY, LATENCY]
        state, self.variance = conditioned(self._state, self.variance, LATENCY, longer, left)
        state[:, LATENCY], self.variance[:, LATENCY, LATENCY] = latency, variance  # to the bit, so as to agree once
        self._know(_bounded(state))


def _bounded(state: Array) -> Array:
    """The same state, its parameters where they can be."""
    bounded = state[:, 3:LATENCY]
    np.minimum(np.maximum(bounded, LEAST, out=bounded), MOST, out=bounded)
    return state


# Laws for single numbers and arrays alike, by which loops over robots reckon too (`by_robot`).


def driven(bias: Number, ahead: Number, aside: Number, shortfall: Number) -> Number:
    """What turns robots like a command, rad/s: bias, and driving, by couplings and e."""
    return bias - ahead * shortfall.real - aside * shortfall.imag


def answer(
    command: Number,
    speed: Number,
    turned: Number,
    still: Number,
    slower: Number,
    effort: Number,
    friction: Number,
    arm: float,
) -> tuple[Number, Number, Number]:
    """Of robots that are commanded, drive and are turned like that: time constants (s), final rates, and n.

    Time constants are `still` and `slower` times how fast wheels travel, which are tau / g and g T_w.
    """
    rim = arm * command
    travel = np.hypot(speed, rim)
    rubbing = rim / np.maximum(travel, np.maximum(RUBBED_M_S, arm * friction))  # stops, no more
    return still + slower * travel, (command + turned - friction * rubbing) / effort, rubbing


def asked(before: Number, after: Number, decay: Number, effort: Number, turned: Number, rubbed: Number) -> Number:
    """Commands from rates to rates, of which the share `decay` is left, of robots that are turned and rubbed."""
    return (after - decay * before) * effort / (1 - decay) - turned + rubbed


def go_on(rate: Number, final: Number, late: Number, duration: Number) -> tuple[Number, Number, Number]:
    """Angles turned (n,) in a while, rates after it, and the shares left of those before, towards `final` ones."""
    decay, excess = np.exp(-duration / late), rate - final
    return duration * final + excess * (1 - decay) * late, final + excess * decay, decay
