"""Residuals of stretches of which first pose and twist are free, and their Jacobian by the law's parameters.

What is free in each stretch alone, its first pose and twist, is solved for in each evaluation (variable projection,
with Kaufman's Jacobian: Kaufman 1975, BIT 15, 49). The first twist is tied, weakly, to that of a parabola through the
first poses: of a robot that starts from rest the law forgets it at once.
"""

from collections.abc import Sequence

import numpy as np

from omni_control.kinematics import Array
from omni_mj.studies.identify import law
from omni_mj.studies.identify.predict import first_poses
from omni_mj.studies.identify.residuals import noise
from omni_mj.studies.identify.segments import COARSEST_S, Segments

WIDTH = 3  # real numbers of a pose
TRUSTED_S = 0.05  # weight of the first twist that a parabola shows: 1.3 mm of noise to 0.026 m/s
NUDGE = 0.02  # of first headings and twists, rad, m/s and rad/s


class Problem:
    """Residuals and their Jacobian, without what is free in each stretch.

    Args:
        body: the robot that is believed in.
        segments: S stretches.
        start: parameters as `law.simulate` has them.
        late: how many latencies are free: one for all logs, or one for each.
        free: which of the parameters are, beside those.
        steps: of finite differences, of latencies and parameters.

    Attributes:
        taken: how many numbers are free in stretches.
        metres: that a radian counts for.
    """

    def __init__(
        self, body: law.Body, segments: Segments, start: Array, late: int, free: Sequence[int], steps: Array
    ) -> None:
        self.body, self.segments, self.start, self.free = body, segments, start, list(free)
        self.taken = 2 * WIDTH * len(segments)
        self.logs = segments.log if late > 1 else np.zeros(len(segments), int)
        self.late, self._coarsest = late, COARSEST_S
        self.steps = np.append(steps[0], steps[late:])
        there = segments.there
        self.metres = noise(segments.position, there) / max(noise(segments.angle, there), 1e-6)
        self._first = first_poses(segments)[:, 1:].real
        measured = np.stack([segments.position.real, segments.position.imag, segments.angle * self.metres], -1)
        self._measured = (measured * there[..., None]).reshape(len(there), -1)
        ones = np.zeros((len(there), 3, *there.shape[1:], WIDTH))
        for i in range(WIDTH):
            ones[:, i, :, i] = there
        self._ones = ones.reshape(len(there), 3, -1)
        self._last: tuple[bytes, tuple[Array, Array, Array]] | None = None

    def step_no_longer_than(self, coarsest: float) -> None:
        """Solve the law from now on in such steps, s."""
        self._coarsest, self._last = coarsest, None

    def at(self, x: Array) -> tuple[Array, Array, Array]:
        """Residuals (S, m + 1, 3), Jacobian (S, m + 1, 3, n), twists (S, m, 3); the last sample is the tie."""
        if self._last is None or self._last[0] != x.tobytes():
            self._last = x.tobytes(), self._at(x)
        return self._last[1]

    def _at(self, x: Array) -> tuple[Array, Array, Array]:
        parameters = self.start.copy()
        parameters[self.free] = x[self.late :]
        late = x[: self.late][self.logs]
        _, _, change, _ = self._projected(parameters[None], late, self._first)
        sets = np.tile(parameters, (1 + len(self.free), 1))
        sets[1 + np.arange(len(self.free)), self.free] += self.steps[1:]
        residual, slopes, _, twist = self._projected(sets, late, self._first + np.pad(change, ((0, 0), (0, 3))))
        jacobian = np.zeros((*residual.shape, len(x)))
        jacobian[..., self.late :] = slopes[..., 1:]
        jacobian[np.arange(len(late)), :, :, self.logs] += slopes[..., 0]
        return residual, jacobian, twist

    def _projected(self, sets: Array, late: Array, first: Array) -> tuple[Array, Array, Array, Array]:
        """Residuals, derivatives by latency and the sets after the first, by how much first states are wrong."""
        there, width = self.segments.there, WIDTH
        nudges = np.concatenate([np.zeros((1, 7)), NUDGE * np.eye(4, 7)])
        k = len(nudges)
        more = len(sets) - 1
        shifted = 1 if more else 0
        all_sets = np.concatenate([np.tile(sets[0], (k + shifted, 1)), sets[1:]])
        starts = first[:, None] + np.concatenate([nudges, np.zeros((shifted + more, 7))])
        lates = np.tile(late[:, None], len(all_sets))
        if shifted:
            lates[:, k] += self.steps[0]
        motion = law.simulate(self.body, self.segments, all_sets, lates, starts, self._coarsest)
        heading = starts[..., 0][..., None] + motion.turned
        flat = np.stack([motion.way.real, motion.way.imag, heading * self.metres], -1) * there[:, None, :, None]
        flat = flat.reshape(len(there), len(all_sets), -1)  # (S, P, m width)
        by_state = (flat[:, 1:k] - flat[:, :1]) / NUDGE
        columns = np.concatenate([self._ones[:, :2], by_state], 1)  # x, y; heading, vx, vy, w
        tied = np.zeros((len(there), 2 * width, width))
        weight = TRUSTED_S * np.array([1.0, 1.0, self.metres])
        tied[:, width:] = np.diag(weight)
        q, r = np.linalg.qr(np.concatenate([columns, tied], 2).swapaxes(1, 2))

        def without(values: Array) -> Array:  # (S, p, m width + width)
            return values - np.einsum("sij,spj->spi", q, np.einsum("sij,spi->spj", q, values))

        wrong = flat[:, 0] - self._measured
        both = np.concatenate([wrong, (first - self._first)[:, 1:4] * weight], 1)
        solved = np.linalg.solve(r, -np.einsum("sij,si->sj", q, both)[..., None])[..., 0]
        shape = len(there), there.shape[1] + 1, width
        residual = without(both[:, None]).reshape(shape)
        slopes = (flat[:, k:] - flat[:, :1]) / self.steps[: shifted + more, None]
        slopes = without(np.concatenate([slopes, np.zeros((*slopes.shape[:2], width))], 2))
        return residual, slopes.swapaxes(1, 2).reshape(*shape, -1), solved[:, 2:], motion.twist[:, 0]
