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
is no sliding, but a robot that has become another, and is learned; one that does nothing of what is asked hears
nothing, or is held, and nothing is learned of it, not even creep, however long that lasts.

A robot that is seen where no motion leads was put there, or the camera was moved. It then is where it is seen, which
tells nothing of its velocity, of what pushes it, nor of its parameters: a filter that took the way for one that was
driven would believe in 1 m/s for a while.
"""

from typing import NamedTuple

import numpy as np

from omni_control.delay import CommandsInFlight
from omni_control.estimation import evidence, motion
from omni_control.estimation.belief import REACH_FRAMES, STATES, believed
from omni_control.estimation.hearsay import conditioned
from omni_control.estimation.late import Late
from omni_control.estimation.motion import Motion, Plane, pairs, plane
from omni_control.kinematics import Array, Kinematics

ENDS_S = 0.5  # in which it is not believed any more that wheels slide
MISTAKEN_FRAMES = 14  # before sliding is believed, in which it was taken for other parameters
LATENCY = 6 + motion.LATENCY  # among the states: beyond the dead time, frames
_UNITS = np.array([1, 1j, 1, 1j])  # the world's axes, of velocity and of push
_IDENTITY, _COFACTORS = np.eye(2), np.array([[1.0, -1.0], [-1.0, 1.0]])


class Acted(NamedTuple):
    """Commands that acted in the frame just past, on its average, (n, 3).

    Attributes:
        command: those.
        change: by how much they were more, if the latency were longer by so many `frames`, (n,).
    """

    command: Array
    change: Array
    frames: Array


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
        alpha: what robots reach of a command ahead and aside, as far as that is known; see `belief`.
        sideways: creep sideways, s^2/m. [by the wheels' geometry]

    Attributes:
        position, velocity, push: (n,) m, m/s, m/s.
        motion: the law, with the parameters found.
        latency: time from when a command is sent until it begins to act, (n,) frames.
        turned: how a robot's compass turns its commands, unit vectors (n,).
        variance: of all states, (n, 14, 14).
        surprise: square of the innovations over what the filter expects, (n,); 1 for a robot that keeps to the law.
        sliding: how far wheels are believed to slide, (n,): 0 not, 1 certainly.
        gained: acceleration by the law in the frame just past, ahead and aside of robots, (n,) m/s^2.
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
        alpha: tuple[float, float] | None = None,
        sideways: float | None = None,
    ) -> None:
        n = len(position)
        self._gives, self._ends = np.array([1.0, motion.softness(geometry)]), 1 - np.exp(-period / ENDS_S)
        self._period, self._delay, self._told = period, delay_frames, max(noise, 1e-4) ** 2
        self.noise = np.full(n, self._told)
        self._last: Plane = np.full((3, n), np.nan, complex)  # the position seen, its differences, and theirs
        creeps = creep, self._gives[1] * creep if sideways is None else sideways
        belief = believed(period, delay_frames, lag, creeps, friction, alpha)
        state = np.concatenate([pairs(position), np.zeros((n, 4)), np.tile(belief.parameters, (n, 1))], axis=1)
        self.motion = Motion(state[:, 6:], geometry)
        self._know(state)
        self.longest = delay_frames + REACH_FRAMES[1] + 4
        self._lowest, self._highest = belief.lowest, belief.highest
        self._kept, self._renewed, self._forget, self._restless = belief.passing
        self._lasting = np.array([period, 1.0])[:, None, None, None]  # what a command moves and gains without lag
        # Written anew in each frame: what velocity, push and parameters do like a command, in the body's axes; its
        # effect on position and velocity there; and how states depend on those before.
        self._acts, self._effect = np.zeros((n, STATES - 2), complex), np.empty((2, n, STATES - 2, 2))
        self._passed = np.tile(np.diag(self._kept), (n, 1, 1))
        self._driven = self._passed[:, :4, 2:].reshape(n, 2, 2, -1).transpose(1, 0, 3, 2)  # a view, as `_effect`
        self.variance = np.zeros((n, STATES, STATES))
        self.variance[:, [0, 1], [0, 1]] = self._told
        self.variance[:, 6:, 6:] = belief.variance
        self.surprise, self.sliding, self.gained = np.ones(n), np.zeros(n), np.zeros(n, complex)
        self._past, self._frames = np.empty((MISTAKEN_FRAMES, n, motion.COUNT)), 0  # parameters in the last of them
        self._lasts = np.zeros(n)  # s, for how long acceleration has been missing
        self._lacks: Plane = np.zeros((2, n), complex)

    @property
    def sigma(self) -> Array:
        """Standard deviation of the parameters, (n, 8)."""
        own = self.variance.reshape(-1, STATES**2)[:, 6 * (STATES + 1) :: STATES + 1]
        return np.sqrt(np.maximum(own, 0.0))

    def follow(self, commands: Plane, headings: Plane, durations: Array) -> tuple[Plane, Plane]:
        """Positions and velocities (n,) after commands (count, n) that are still to act; see `Motion.follow`."""
        arriving = commands * self.turned + self.push
        moved, velocity = self.motion.follow(self.velocity, arriving, headings, durations)
        return self.position + moved, velocity

    def ask(self, command: Plane) -> Plane:
        """What to send, (n,), so that commands (n,) of the law act: without what pushes, and by the robot's compass."""
        return (command - self.push) * self.turned.conj()

    def acted(self, sent: CommandsInFlight, late: Late | None = None) -> Acted:
        """Commands that acted in the frame just past, and what they were if the latency were another.

        That is over as much as is not known of it: how commands jump from one frame to the next tells nothing of a
        robot that answers some frames sooner or later.

        Args:
            sent: commands up to the frame before, `longest` of them at least, and as many more as the filter is behind.
            late: how far that is. [not]
        """
        latency = self.latency if late is None else self.latency + late.behind
        spread = evidence.spread(self.variance[:, LATENCY, LATENCY])
        sooner, later = np.maximum(latency - spread, 0.0), latency + spread
        acting, early, belated = sent.felt(np.array([latency, sooner, later])[..., None])
        return Acted(acting, belated - early, later - sooner)

    def update(
        self,
        measured: Plane | None,
        heading: Array,
        acted: Acted,
        late: Late | None = None,
        heard: tuple[Array, Array] | None = None,
    ) -> None:
        """Take in a frame.

        Args:
            measured: positions seen by vision (n,), not a number where a robot was not seen; none if this is no more
                than a step on the way to the frame of which vision reports.
            heading: in the middle of the frame just past, (n,) rad.
            acted: commands in it.
            late: which robots stay in the frame where they are, and how much later they were seen. [none, and at once]
            heard: what headings told of the latency in this frame; see `Turning.update`. [nothing]
        """
        before, ahead = self.velocity, np.exp(1j * heading)
        acting, change = (plane(each[:, :2].copy()) for each in (acted.command, acted.change))
        arrived, per_frame = acting * self.turned, change / acted.frames
        step = self.motion.step(before, arrived + self.push, ahead, self._period)
        variance = self._passed_on(step, arrived, per_frame * self.turned, ahead)
        unaided, gained = plane(step.velocity) * ahead, plane(step.velocity - step.before) / self._period
        state = self._kept * self._state + self._renewed
        state[:, :2] += pairs(plane(step.moved) * ahead)
        state[:, 2:4] = pairs(unaided)
        if late is not None:
            state = np.where(late.held[:, None], self._state, state)
            variance = np.where(late.held[:, None, None], self.variance, variance)
            unaided, gained = plane(state[:, 2:4]).copy(), np.where(late.held, self.gained, gained)
        if heard is not None:
            state, variance = conditioned(state, variance, LATENCY, *heard)
        self.variance, self.gained = variance, gained
        if measured is None:
            self._know(state)
            return
        measured = measured if late is None else measured - late.after * unaided
        self._doubt(measured)
        self._correct(state, measured, late)
        velocity = plane(state[:, 2:4])
        lacks = (unaided - np.array([before, velocity])) / self._period
        self._know(self._felt(state, lacks, arrived))

    def _know(self, state: Array) -> None:
        """Take the state (n, 14) for what is known."""
        self._state, self.motion.parameters = state, state[:, 6:]
        self.position, self.velocity, self.push = state[:, :6].view(complex).T
        self.latency = self._delay + state[:, LATENCY]
        self.turned: Plane = np.exp(-1j * state[:, 6 + motion.COMPASS])

    def _passed_on(self, step: motion.Step, arrived: Plane, later: Plane, ahead: Plane) -> Array:
        """The variance (n, 14, 14) after a step, to first order.

        What a parameter changes in the law acts like a command: of effort -v, of creep -g^2 |v| v', of lag -v', of
        friction against the motion, of latency the difference of successive commands.
        """
        acts, effect, passed = self._acts, self._effect, self._passed
        back, speed, effort = ahead.conj(), np.abs(self.velocity), self.motion.effort
        change = (step.before - step.velocity) / self._period
        evident = evidence.evident(speed)
        obeys = evidence.obeys(evident, self.sliding, self.surprise)
        creeps = evidence.creeps(evident, speed, self._idles(arrived))
        axes = acts.view(float)  # (n, 24); of what is of one axis, that of the other is zero
        acts[:, :4] = _UNITS * back[:, None]
        acts[:, 4], acts[:, 10] = -1j * arrived * back, later * back
        axes[:, 10:14:3] = (step.before + step.velocity) / -2
        axes[:, 18:20], axes[:, 22:] = -step.rubbing, change * self._gives
        acts[:, 4:] *= obeys[:, None]
        axes[:, 14:18:3] = effort**2 * creeps[:, None] * change
        left = np.array([step.carried, step.decay])[:, :, None]
        effect[:, :, :2], effect[:, :, 2:] = left, (self._lasting - left) / effort[:, None]
        self._driven[...] = pairs(plane(pairs(acts) * effect) * ahead[:, None])
        variance: Array = passed @ self.variance @ passed.swapaxes(1, 2) + self._forget
        doubted = evidence.doubted(self.sliding[:, None], np.abs(change.view(complex)))
        restless = evidence.restless(self.surprise)[:, None] * self._restless
        restless[:, :2] *= 1 + doubted**2
        variance.reshape(-1, STATES**2)[:, 2 * (STATES + 1) : 6 * (STATES + 1) : STATES + 1] += restless
        return variance

    def _felt(self, state: Array, lacks: Plane, arrived: Plane) -> Array:
        """Find whether wheels slide; the state (n, 14) without what was learned when they began to.

        Args:
            state: as corrected.
            lacks: acceleration of the law in the frame just past, and what vision took from it, (2, n) m/s^2.
            arrived: commands that acted in it, (n,) m/s.
        """
        self._lacks = evidence.lacking(self._lacks, lacks)
        slides, was = evidence.slides(*self._lacks), self.sliding
        self._lasts = evidence.lasting(self._lasts, slides, self._idles(arrived), self._period)
        self.sliding = evidence.believed(was, slides, self._lasts, self._ends)
        self._past[self._frames % MISTAKEN_FRAMES] = state[:, 6:]
        self._frames += 1
        begins = (was < 0.5) & (self.sliding >= 0.5)
        if np.count_nonzero(begins):
            oldest = self._frames % MISTAKEN_FRAMES if self._frames > MISTAKEN_FRAMES else 0
            state[begins, 6:] = self._past[oldest][begins]
        return state

    def _idles(self, arrived: Plane) -> Array:
        """Whether robots obey nothing (n,), by commands that arrived, (n,) m/s, and how fast vision saw them move."""
        asked, missing = self._lacks
        idle: Array = evidence.idles(asked, missing, arrived, self._last[1] / self._period)
        return idle

    def _doubt(self, measured: Plane) -> None:
        """Find how large the noise of vision is, by third differences of positions (n,), which motion hardly shows in.

        Of white noise their variance is 20 times its own; of an acceleration that jumps by 5 m/s^2 they are 1.4 mm.
        """
        first = measured - self._last[0]
        second = first - self._last[1]
        rough = np.abs(second - self._last[2]) ** 2 / 40
        change = evidence.noisier(self.noise, rough)
        self.noise = self.noise + np.where(np.isnan(rough), 0.0, change)
        self._last = np.array([measured, first, second])

    def _correct(self, state: Array, measured: Plane, late: Late | None) -> None:
        """Correct the state (n, 14) by the positions (n,) that vision reports, less the way from here to there."""
        seen, of_position = ~np.isnan(measured), self.variance[:, :2]
        innovation = pairs(np.where(seen, measured - plane(state[:, :2]), 0.0))[:, None]
        of_seen = of_position[:, :, :2]
        if late is not None:  # that way is their velocity's
            after = late.after[:, None, None]
            of_position = of_position + after * self.variance[:, 2:4]
            of_seen = of_position[:, :, :2] + after * of_position[:, :, 2:4]
        noise = np.maximum(self.noise, self._told)
        expected = of_seen + noise[:, None, None] * _IDENTITY
        adjugate = expected[:, ::-1, ::-1] * _COFACTORS
        area = np.add.reduce(expected[:, 0] * adjugate[:, 0], axis=1)
        inverse = adjugate * (seen / area)[:, None, None]
        weighed = innovation @ inverse  # (n, 1, 2)
        surprise = np.add.reduce((innovation * weighed)[:, 0], axis=1) / 2
        far, known = np.abs(innovation.view(complex)[:, 0, 0]), self.variance
        carried = np.flatnonzero(evidence.carried(surprise, far, self._period))
        weighed[carried] = 0.0
        state[carried, :2] += innovation[carried, 0]
        state += (weighed @ of_position)[:, 0]
        parameters = state[:, 6:]
        np.minimum(np.maximum(parameters, self._lowest, out=parameters), self._highest, out=parameters)
        variance = self.variance - of_position.swapaxes(1, 2) @ (inverse @ of_position)
        self.variance = (variance + variance.swapaxes(1, 2)) / 2
        for i in carried:
            self.variance[i] = known[i]
            set_down(self.variance[i], far[i], noise[i], self._period)
        self.surprise = np.where(seen, evidence.surprised(self.surprise, surprise), self.surprise)


def set_down(variance: Array, far: float, noise: float, period: float) -> None:
    """Change the variance (14, 14) of a robot that was put `far` from where it was expected, m; see `evidence.carried`.

    It is where it is seen, but for the noise, of a variance in m^2. How fast it is, which could have led as far in a
    frame, the next image tells. Nothing else is known better than before.
    """
    variance[:2] = 0.0
    variance[:, :2] = 0.0
    for j in range(2):
        variance[j, j] = noise
        variance[2 + j, 2 + j] += (far / period) ** 2
