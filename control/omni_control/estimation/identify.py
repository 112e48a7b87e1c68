"""Where robots are and how they answer to commands, found together while they drive: an extended Kalman filter.

The law is that of `motion`. Its parameters wander and return: each is a process that forgets exponentially and whose
stationary distribution is what was believed before anything was seen, so that what shows nothing of a parameter, such
as rest, or driving along the other axis, leads back to the belief. Axes are believed to be alike, and learn from each
other.

Where a robot does not do what is asked of it, because its wheels slide or somebody pushes it, commands show little of
the parameters. That is told by innovations larger than the filter expects, and, of sliding, by an acceleration that
stays away: what the law asked for, and what vision has had to take from it, both over a few frames. Parameters then
are again what they were before it began, since until then it was taken for theirs; velocity is left to vision, and
parameters are kept, all but creep, which is the slip that grows with acceleration. What does not pass within a second
is no sliding, but a robot that has become another, and is learned.
"""

from collections import deque

import numpy as np

from omni_control.delay import CommandsInFlight
from omni_control.estimation import motion
from omni_control.estimation.motion import Motion, Plane, pairs, plane
from omni_control.kinematics import Array, Kinematics

KEPT_S = 12.0  # after which parameters are what was believed
COMPASS_S = 2.0  # same, of the compass error, which a robot's own filter corrects
COMPASS_RAD = 0.02  # its standard deviation
EFFORT, EFFORT_SIGMA, EFFORTS_ALIKE = 1.1, 0.12, 0.5  # alpha 0.8 to 1
CREEP_SIGMA, CREEPS_ALIKE = 0.35, 0.8  # relative: of four published robots, 20 % forward and 30 % sideways
FRICTION, FRICTION_SIGMA = 0.8, 0.4  # of what it is told to be at most
LATENCY_FRAMES = 1.2  # standard deviation of what the dead time is told wrong by
LAG_SHARE, LAG_SIGMA = 0.75, 0.5  # lag forward of the mean over all directions; relative
ACCELERATION_M_S2 = 0.35  # standard deviation of what the law does not know of v'
UNKNOWN_SHARE = 0.3  # same, of the acceleration that it asks for; all of it where wheels slide
PUSH_M_S, PUSH_S = 0.01, 0.5  # standard deviation of b, and the time after which it is forgotten
NOISE_FRAMES, ROUGHEST = 60.0, 25.0  # over which the noise of vision is averaged; of a frame, relative
SURPRISE_FRAMES = 10  # over which it is averaged
MOST_SURPRISED = 30.0
SPREAD_FRAMES = 0.5, 2.0  # of latencies, over which the change of commands is taken
EVIDENT_M_S = 0.1  # below it a robot may be held by dry friction and shows nothing of its parameters
REACH_FRAMES = 4, 5  # how far the latency may be below and above what it is told
SLIDING_FRAMES = 8  # over which accelerations asked for and missing are averaged
ASKED_M_S2, MISSING_M_S2, MISSING_SHARE = 1.0, 0.5, 0.3  # of them, from which on wheels are taken to slide
BEGINS_FRAMES, ENDS_S = 4.0, 0.5  # in which that is believed, and not believed any more
MISTAKEN_FRAMES = 14  # before sliding is believed, in which it was taken for other parameters
PASSES_S, SHRINKS = 1.03, 4.0  # how long it may last, and by how much faster than it grew that time shrinks
SURPRISING = 1.5  # from which on parameters count on less
LEAST_LAG_S = 1e-3
STATES = 6 + motion.COUNT  # position, velocity, push; parameters
_UNITS = np.array([1, 1j, 1, 1j])  # the world's axes, of velocity and of push
_IDENTITY, _COFACTORS = np.eye(2), np.array([[1.0, -1.0], [-1.0, 1.0]])
_IS_CREEP = np.isin(np.arange(motion.COUNT), np.arange(motion.COUNT)[motion.CREEP])


class Identifier:
    """Positions, velocities and parameters of n robots.

    Args:
        position: at the start, (n,) m.
        period: length of a frame T, s.
        delay_frames: dead time as it is told.
        noise: standard deviation of what vision reports, m.
        lag, creep, friction: what is told of wheel loops (s), creep forward (s^2/m) and dry friction (m/s); zero where
            there is none.
        geometry: of the wheels, or None.

    Attributes:
        position, velocity, push: (n,) m, m/s, m/s.
        motion: the law, with the parameters found.
        variance: of all states, (n, 14, 14).
        surprise: square of the innovations over what the filter expects, (n,); 1 for a robot that keeps to the law.
        sliding: how far wheels are believed to slide, (n,): 0 not, 1 certainly.
        longest: commands that must be kept.
    """

    def __init__(
        self,
        position: Plane,
        period: float,
        delay_frames: int,
        noise: float,
        lag: float,
        creep: float,
        friction: float,
        geometry: Kinematics | None = None,
    ) -> None:
        n = len(position)
        self.position: Plane = position.copy()
        self.velocity: Plane = np.zeros(n, complex)
        self.push: Plane = np.zeros(n, complex)
        self._softness = softness = motion.softness(geometry)
        self._period, self._delay, self._told = period, delay_frames, max(noise, 1e-4) ** 2
        self.noise = np.full(n, self._told)
        self._last: list[Plane] = [np.full(n, np.nan, complex)] * 3
        lag = max(LAG_SHARE * lag, LEAST_LAG_S)
        self._believed = np.array([0, EFFORT, EFFORT, creep, softness * creep, FRICTION * friction, 0, lag])
        self.motion = Motion(np.tile(self._believed, (n, 1)), geometry)
        below, above = min(REACH_FRAMES[0], delay_frames), REACH_FRAMES[1]
        self.longest = delay_frames + above + 4
        self._lowest = np.array([-0.2, 0.85, 0.85, 0, 0, 0, -below, LEAST_LAG_S])
        self._highest = np.array([0.2, 1.9, 1.9, 0.2, 0.35, 0.15, above, 0.1])

        sigma = np.array(
            [
                COMPASS_RAD,
                EFFORT_SIGMA,
                EFFORT_SIGMA,
                *(CREEP_SIGMA * self._believed[motion.CREEP] + 1e-6),
                FRICTION_SIGMA * friction + 1e-6,
                LATENCY_FRAMES,
                LAG_SIGMA * (lag - LEAST_LAG_S) + 1e-6,
            ]
        )
        alike = np.eye(motion.COUNT)
        alike[1, 2] = alike[2, 1] = EFFORTS_ALIKE
        alike[3, 4] = alike[4, 3] = CREEPS_ALIKE
        belief = alike * np.outer(sigma, sigma)
        kept = np.full(motion.COUNT, KEPT_S)
        kept[motion.COMPASS] = COMPASS_S
        self._keep, self._keep_push = np.exp(-period / kept), np.exp(-period / PUSH_S)
        renewed = np.sqrt(1 - self._keep**2)
        self._forget = belief * np.outer(renewed, renewed)
        restless = np.array([ACCELERATION_M_S2 * period, PUSH_M_S * np.sqrt(1 - self._keep_push**2)]) ** 2
        self._lasting = np.array([period, 1.0])[:, None, None, None]  # what a command moves and gains without lag
        self._restless = np.repeat(restless, 2)  # of velocity and push
        self._kept = np.concatenate([[1, 1, 0, 0], [self._keep_push] * 2, self._keep])  # of each state, by itself
        self.variance = np.zeros((n, STATES, STATES))
        self.variance[:, [0, 1], [0, 1]] = self._told
        self.variance[:, 6:, 6:] = belief
        self.surprise, self.sliding = np.ones(n), np.zeros(n)
        self._past: deque[Array] = deque(maxlen=MISTAKEN_FRAMES)  # parameters in the last frames
        self._lasts = np.zeros(n)  # s, for how long acceleration has been missing
        self._asked: Plane = np.zeros(n, complex)
        self._missing: Plane = np.zeros(n, complex)

    @property
    def latency(self) -> Array:
        """Time from when a command is sent until it begins to act, (n,) frames."""
        return self._delay + self.motion.parameters[:, motion.LATENCY]

    @property
    def sigma(self) -> Array:
        """Standard deviation of the parameters, (n, 8)."""
        return np.sqrt(np.maximum(np.diagonal(self.variance, axis1=1, axis2=2)[:, 6:], 0.0))

    def follow(self, commands: Plane, headings: Plane, durations: Array) -> tuple[Plane, Plane]:
        """Positions and velocities (n,) after commands (count, n) that are still to act; see `Motion.follow`."""
        arriving = commands * self.turned() + self.push
        moved, velocity = self.motion.follow(self.velocity, arriving, headings, durations)
        return self.position + moved, velocity

    def ask(self, command: Plane) -> Plane:
        """What to send, (n,), so that commands (n,) of the law act: without what pushes, and by the robot's compass."""
        return (command - self.push) * self.turned().conj()

    def update(self, measured: Plane, heading: Array, sent: CommandsInFlight) -> None:
        """Take in a frame.

        Args:
            measured: positions seen by vision (n,), not a number where a robot was not seen.
            heading: in the middle of the frame just past, (n,) rad.
            sent: commands up to the frame before, `longest` of them at least.
        """
        period, law, ahead = self._period, self.motion, np.exp(1j * heading)
        (acting, per_frame), turned = self._acted(sent), self.turned()
        arrived = acting * turned
        step = law.step(self.velocity, arrived + self.push, ahead, period)
        self.variance = self._passed(step, arrived, per_frame * turned, ahead)
        unaided = plane(step.velocity) * ahead
        asked = (unaided - self.velocity) / period
        self.position, self.velocity = self.position + plane(step.moved) * ahead, unaided
        self.push = self._keep_push * self.push
        law.parameters = self._believed + self._keep * (law.parameters - self._believed)
        self._doubt(measured)
        self._correct(measured)
        self._feel(asked, (unaided - self.velocity) / period)

    def turned(self) -> Plane:
        """How a robot's compass turns its commands, unit vectors (n,)."""
        return np.exp(-1j * self.motion.parameters[:, motion.COMPASS])

    def _acted(self, sent: CommandsInFlight) -> tuple[Plane, Plane]:
        """Commands (n,) that acted in the frame just past, on its average, and how they change per frame of latency.

        The change is that over as much as is not known of the latency: how commands jump from one frame to the next
        tells nothing of a robot that answers some frames sooner or later.
        """
        latency, number = self.latency, 6 + motion.LATENCY
        sigma = np.sqrt(np.maximum(self.variance[:, number, number], 0.0))
        spread = np.minimum(np.maximum(sigma, SPREAD_FRAMES[0]), SPREAD_FRAMES[1])
        sooner, later = np.maximum(latency - spread, 0.0), latency + spread
        shares = sent.acted(np.array([latency, sooner, later]))[-self.longest :]
        acting, early, late = (shares * plane(sent.last(self.longest)[..., :2])[:, None]).sum(0)
        return acting, (late - early) / (later - sooner)

    def _passed(self, step: motion.Step, arrived: Plane, later: Plane, ahead: Plane) -> Array:
        """The variance (n, 14, 14) after a step, to first order.

        What a parameter changes in the law acts like a command: of effort -v, of creep -g^2 |v| v', of lag -v', of
        friction against the motion, of latency the difference of successive commands.
        """
        n, back, period = len(arrived), ahead.conj()[:, None], self._period
        effort, before = self.motion.effort, pairs(self.velocity * back[:, 0])
        speed, change = np.abs(self.velocity), (before - step.velocity) / period
        acts = np.zeros((n, STATES - 2, 2))  # of velocity, push and parameters, in the body's axes
        turning_in = np.array([arrived, later]).T * (-1j, 1)
        acts[:, :4], acts[:, 4:11:6] = pairs(_UNITS * back), pairs(turning_in * back)
        acts[:, 5, 0], acts[:, 6, 1] = -(before + step.velocity).T / 2
        acts[:, 7, 0], acts[:, 8, 1] = (effort**2 * speed[:, None] * change).T
        acts[:, 9] = -step.rubbing
        acts[:, 11] = change * (1.0, self._softness)
        evident = np.minimum(speed / EVIDENT_M_S, 1.0) ** 2
        obeys = evident * (1 - self.sliding) * np.minimum(SURPRISING / self.surprise, 1.0) ** 2
        acts[:, 4:] *= np.where(_IS_CREEP, evident[:, None], obeys[:, None])[..., None]
        effect = np.empty((2, *acts.shape))  # on position and velocity
        left = np.array([step.carried, step.decay])[:, :, None]
        effect[:, :, :2], effect[:, :, 2:] = left, (self._lasting - left) / effort[:, None]
        passed = np.zeros((n, STATES, STATES))
        passed.reshape(n, -1)[:, :: STATES + 1] = self._kept
        both = pairs(plane(acts * effect) * ahead[:, None])  # (2, n, 12, 2)
        passed[:, :4, 2:] = both.transpose(1, 0, 3, 2).reshape(n, 4, STATES - 2)
        variance: Array = passed @ self.variance @ passed.swapaxes(1, 2)
        restless = np.minimum(np.maximum(self.surprise, 1.0), MOST_SURPRISED)[:, None] * self._restless
        doubted = (UNKNOWN_SHARE + self.sliding) / ACCELERATION_M_S2
        restless[:, :2] *= (1 + doubted**2 * (change**2).sum(1))[:, None]
        variance.reshape(n, -1)[:, 2 * (STATES + 1) : 6 * (STATES + 1) : STATES + 1] += restless
        variance[:, 6:, 6:] += self._forget
        return variance

    def _feel(self, asked: Plane, missing: Plane) -> None:
        """Find whether wheels slide, and take back what was learned when they began to.

        Args:
            asked: acceleration of the law in the frame just past, (n,) m/s^2.
            missing: what vision took from it, the same.
        """
        self._asked = self._asked + (asked - self._asked) / SLIDING_FRAMES
        self._missing = self._missing + (missing - self._missing) / SLIDING_FRAMES
        size = np.maximum(np.abs(self._asked), ASKED_M_S2)
        along = (self._missing * self._asked.conj()).real / size
        slides = along > np.maximum(MISSING_M_S2, MISSING_SHARE * size)
        ends = np.exp(-self._period / ENDS_S)
        was = self.sliding
        shrunk = np.maximum(self._lasts - SHRINKS * self._period, 0.0)
        self._lasts = np.where(slides, self._lasts + self._period, shrunk)
        passing = slides & (self._lasts < PASSES_S)
        self.sliding = np.where(passing, self.sliding + (1 - self.sliding) / BEGINS_FRAMES, ends * self.sliding)
        self._past.append(self.motion.parameters)
        begins = (was < 0.5) & (self.sliding >= 0.5)
        self.motion.parameters = np.where(begins[:, None], self._past[0], self.motion.parameters)

    def _doubt(self, measured: Plane) -> None:
        """Find how large the noise of vision is, by third differences of positions (n,), which motion hardly shows in.

        Of white noise their variance is 20 times its own; of an acceleration that jumps by 5 m/s^2 they are 1.4 mm.
        """
        before = self._last
        rough = np.abs(measured - 3 * before[0] + 3 * before[1] - before[2]) ** 2 / 40
        change = (np.minimum(rough, ROUGHEST * self.noise) - self.noise) / NOISE_FRAMES
        self.noise = self.noise + np.where(np.isnan(rough), 0.0, change)
        self._last = [measured, *before[:2]]

    def _correct(self, measured: Plane) -> None:
        """Correct all states by the positions (n,) that vision reports."""
        seen, of_position = ~np.isnan(measured), self.variance[:, :2]
        innovation = pairs(np.where(seen, measured, self.position) - self.position)
        expected = of_position[:, :, :2] + np.maximum(self.noise, self._told)[:, None, None] * _IDENTITY
        area = expected[:, 0, 0] * expected[:, 1, 1] - expected[:, 0, 1] ** 2
        inverse = expected[:, ::-1, ::-1] * _COFACTORS * np.where(seen, 1 / area, 0.0)[:, None, None]
        weighed = (inverse * innovation[:, None]).sum(2)
        state, surprise = (of_position * weighed[..., None]).sum(1), (innovation * weighed).sum(1) / 2
        variance = self.variance - of_position.swapaxes(1, 2) @ (inverse @ of_position)
        self.variance = (variance + variance.swapaxes(1, 2)) / 2
        change = np.where(seen, np.minimum(surprise, 50.0) - self.surprise, 0.0)
        self.surprise = self.surprise + change / SURPRISE_FRAMES
        position, velocity, push = plane(state[:, :6].reshape(-1, 3, 2)).T
        self.position, self.velocity, self.push = self.position + position, self.velocity + velocity, self.push + push
        parameters = np.maximum(self.motion.parameters + state[:, 6:], self._lowest)
        self.motion.parameters = np.minimum(parameters, self._highest)
