"""How robots answer to commands, identified while they drive: latency, motor correction factors and drag.

Equation 7 knows a gain alpha and a dead time that is given. A real robot answers late, by the radio's dead time and
the lag of its wheel loops; a little weakly, by alpha; and loses a constant speed to dry friction. A model with a gain
alone takes lag and friction for a gain that swings between speeding up and braking. In the body frame, per axis:

    displacement in a frame = T (alpha u - drag direction(u)),   u: the command that acted, sent `latency` ago
"""

import numpy as np
from numpy.typing import ArrayLike

from omni_control.delay import CommandsInFlight
from omni_control.kinematics import Array, body_to_world, world_to_body, wrap_angle

STEP_FRAMES = 0.5  # between the latencies compared
REACH_FRAMES = 7  # how far from the guess they lie
LATENCY_SIGMA_FRAMES = 3.0  # of the guess
AXES_SIGMA_FRAMES = 0.7  # of the difference between driving forward and sideways
ALPHA_SIGMA = 0.15  # of alpha = 1
SLOW_M_S = 0.05  # below it dry friction is not yet all of it
ARM_M = 0.08  # from the centre to the wheels: 79 to 83 mm in teams' robots
ALPHA_BOUNDS = (0.4, 1.2)
MEMORY = 0.99  # of evidence, per frame
GAIN_ERROR, NOISE_FLOOR = 0.05, np.array([3e-4, 3e-4, 5e-3])  # of a frame's displacement: relative, and m and rad


def direction(twist: Array) -> Array:
    """How dry friction opposes body twists (..., 3): their direction, shorter for what hardly moves.

    Turning counts by the speed of the wheels. [1, 0, 0] for driving forward, [0, 0, 1 / ARM_M] for turning on the spot.
    """
    speed = np.sqrt((twist[..., :2] ** 2).sum(-1) + (ARM_M * twist[..., 2]) ** 2)
    return twist / np.maximum(speed, SLOW_M_S)[..., None]


class PlantIdentifier:
    """Posterior mean of the model above for n robots, over a bank of latencies.

    For each latency the displacement that vision saw is regressed on what commands of that age explain. Both are
    whitened by the steady-state filter of a random walk seen with noise: they leak with its gain, and weigh by the
    variance of its innovations. Evidence is forgotten exponentially, also at standstill: within seconds the estimates
    then return towards what was believed at the start.

    Args:
        n: robots.
        period: length of a frame T, s.
        guess_frames: what the latency is believed to be.
        noise: standard deviation of what vision reports, per axis (3,), m and rad.
        drag_m_s: what dry friction is believed to cost of the speed (standard deviation), m/s; at most twice that is
            found, and as much is taken for the noise with which a robot moves.

    Attributes:
        latency: from a command to its effect forward, sideways and turning, frames, (n, 3).
        latency_sigma: its standard deviation, as far as the model holds, frames, (n, 3).
        alpha: motor correction factors, (n, 3).
        drag: speed lost to dry friction when driving forward, sideways, and at the wheels when turning, m/s, (n, 3).
    """

    def __init__(self, n: int, period: float, guess_frames: float, noise: ArrayLike, drag_m_s: float = 0.04) -> None:
        lowest = max(0.0, np.floor(guess_frames - REACH_FRAMES))
        self.candidates = np.arange(lowest, guess_frames + REACH_FRAMES + STEP_FRAMES, STEP_FRAMES)
        self.longest = int(np.ceil(self.candidates[-1])) + 1  # commands that must be kept
        self._period = period
        self._older = self.candidates.astype(int)
        self._share = (self.candidates - self._older)[:, None, None]
        self._noise = np.maximum(np.asarray(noise, float), (1e-5, 1e-5, 1e-4)) ** 2
        self._drag_sigma = max(drag_m_s, 1e-6)
        self._floor = (NOISE_FLOOR + period * drag_m_s * np.array([1, 1, 0])) ** 2
        self._prior = ((self.candidates - guess_frames) / LATENCY_SIGMA_FRAMES)[:, None, None] ** 2
        shape = (len(self.candidates), n, 3)
        self._felt, self._rubbed = np.zeros((2, *shape))  # displacement of unit alpha, and of unit drag
        self._moved = np.zeros((n, 3))
        self._uncertain = np.tile(self._noise, (n, 1))
        self._sums = np.zeros((5, *shape))
        self._last = np.full((n, 3), np.nan)
        self.latency = np.full((n, 3), float(guess_frames))
        self.latency_sigma = np.full((n, 3), LATENCY_SIGMA_FRAMES)
        self.alpha, self.drag = np.ones((n, 3)), np.zeros((n, 3))

    def update(self, measured: Array, heading: Array, sent: CommandsInFlight) -> None:
        """Take in a frame.

        Args:
            measured: poses seen by vision (n, 3), not a number where a robot was not seen.
            heading: estimated headings in the middle of the frame just past (n,), rad.
            sent: commands up to the frame before, `longest` of them at least.
        """
        commands = world_to_body(sent.last(self.longest)[::-1], heading)
        older = self._older
        u = (1 - self._share) * commands[older] + self._share * commands[np.minimum(older + 1, self.longest - 1)]
        seen, known = ~np.isnan(measured), ~np.isnan(self._last)  # displacements count from where it was first seen
        self._felt += np.where(known, self._period * u, 0.0)
        self._rubbed -= np.where(known, self._period * direction(u), 0.0)
        step = np.where(seen & known, measured - self._last, 0.0)
        step[:, 2] = wrap_angle(step[:, 2])
        self._last = np.where(seen, measured, self._last)
        self._moved += world_to_body(step, heading)

        size = self._period * np.abs(u).mean(0)
        self._uncertain = self._uncertain + (GAIN_ERROR * size) ** 2 + self._floor
        variance = self._uncertain + self._noise
        gain, weight = np.where(seen, self._uncertain / variance, 0.0), np.where(seen, 1 / variance, 0.0)
        self._collect(weight, np.where(seen, MEMORY, 1.0))
        for leaky in (self._felt, self._rubbed, self._moved):
            leaky *= 1 - gain
        self._uncertain = (1 - gain) * self._uncertain
        self._solve()

    def respond(self, command: Array, heading: Array) -> Array:
        """Body twists (..., n, 3) in answer to world-frame commands (..., n, 3) of robots at `heading` (..., n)."""
        body = world_to_body(command, heading)
        moved, lost = self.alpha * body, self.drag * direction(body)
        return moved - np.clip(lost, -np.abs(moved), np.abs(moved))  # friction stops, but does not push back

    def ask(self, velocity: Array, heading: Array) -> Array:
        """Commands (n, 3) to which robots answer with the world-frame twists (n, 3).

        The inverse of `respond`, but for creeping, and for axes that differ so much that the answer bends away.
        """
        body = world_to_body(velocity, heading)
        body = (body + self.drag * direction(body)) / self.alpha
        return body_to_world(body, heading)

    def _collect(self, weight: Array, memory: Array) -> None:
        """Add a frame's evidence to the sums of the regression."""
        felt, rubbed = weight * self._felt, weight * self._rubbed
        self._sums *= memory
        self._sums += (
            felt * self._felt, felt * self._rubbed, rubbed * self._rubbed, felt * self._moved, rubbed * self._moved
        )  # fmt: skip

    def _solve(self) -> None:
        """Best alpha and drag for each latency, with their priors; then the mean over the latencies."""
        ff, fr, rr, fm, rm = self._sums
        ff, fm, rr = ff + ALPHA_SIGMA**-2, fm + ALPHA_SIGMA**-2, rr + self._drag_sigma**-2
        drag = np.clip((ff * rm - fr * fm) / (ff * rr - fr**2), 0.0, 2 * self._drag_sigma)
        alpha = np.clip((fm - fr * drag) / ff, *ALPHA_BOUNDS)
        # Twice the negative logarithm of the likelihood, but for what is the same for all latencies.
        cost = ff * alpha**2 + 2 * fr * alpha * drag + rr * drag**2 - 2 * fm * alpha - 2 * rm * drag
        _, mean, variance = self._believe(cost + self._prior)
        # Forward and sideways differ only by the lag of the wheel loops: each is a guess for the other.
        other, spread = mean[:, 1::-1], variance[:, 1::-1] + AXES_SIGMA_FRAMES**2
        prior = np.repeat(self._prior, cost.shape[1], axis=1)
        prior = np.concatenate([(self.candidates[:, None, None] - other) ** 2 / spread, prior], axis=-1)
        belief, self.latency, variance = self._believe(cost + prior)
        self.latency_sigma = np.sqrt(variance)
        self.alpha, self.drag = (belief * alpha).sum(0), (belief * drag).sum(0)

    def _believe(self, cost: Array) -> tuple[Array, Array, Array]:
        """Probability of each latency (candidates, n, 3), mean and variance (n, 3), for a cost -2 log p."""
        belief = np.exp(-0.5 * (cost - cost.min(0)))
        belief /= belief.sum(0)
        candidates = self.candidates[:, None, None]
        mean = (belief * candidates).sum(0)
        return belief, mean, (belief * (candidates - mean) ** 2).sum(0)
