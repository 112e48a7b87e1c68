"""Linear model of how a robot deviates from a recorded run if its commands change.

Near a run, a change du of the commands changes the robot's velocity v and pose p by

    dv(k) = A(k) dv(k-1) + B0(k) du(k-D) + B1(k) du(k-D-1),      dp(k+1) = dp(k) + T dv(k)

with the dead time D, rounded down to frames, and the period T of a frame. This is a first-order lag
whose input may change between two frames. The lag of creeping wheels grows with speed. So A, B0 and
B1 are polynomials of the reference's speed, acceleration and turn rate, in the body frame.
"""

from dataclasses import dataclass

import numpy as np
import scipy.linalg
import scipy.sparse as sp

from omni_control.kinematics import Array, body_to_world
from omni_mj.config import PERIOD_S

SMOOTHING_FRAMES = 11  # of the reference's acceleration
TURN_SCALE_RAD_S = 5.0  # turn rate that counts as one in the polynomials
ARM_M = 0.1  # length per angle: about the robot's radius
SCALE = np.array([1.0, 1.0, ARM_M])  # factors that turn x, y and heading into lengths


@dataclass(frozen=True, eq=False)
class DeviationModel:
    """Matrices of the model in F frames, world frame; see the equation of this module.

    Attributes:
        velocity: A, shape (F, 3, 3).
        command: B0 and B1, shape (2, F, 3, 3).
        delay: Dead time D, whole frames.
    """

    velocity: Array
    command: Array
    delay: int

    @property
    def frames(self) -> int:
        """Number of frames F."""
        return len(self.velocity)

    @classmethod
    def prior(cls, frames: int, delay: int, lag_s: float) -> "DeviationModel":
        """Return the model of a robot with the same first-order lag along all axes.

        Args:
            frames: Number of frames F.
            delay: Dead time D, frames.
            lag_s: Time constant, s.
        """
        decay = np.exp(-PERIOD_S / lag_s) if lag_s else 0.0
        # Fraction of a frame's displacement that is due to the previous velocity
        previous = lag_s * (1 - decay) / PERIOD_S
        weights = np.array([1 - previous, previous - decay])  # B0 and B1; A + B0 + B1 = 1
        return cls(
            np.tile(decay * np.eye(3), (frames, 1, 1)),
            weights[:, None, None, None] * np.tile(np.eye(3), (frames, 1, 1)),
            delay,
        )

    @classmethod
    def fit(cls, reference: Array, delay: int, poses: Array, commands: Array) -> "DeviationModel":
        """Fit the model by least squares to the differences of n runs from another one.

        Args:
            reference: Poses (F, 3) of the reference; all runs must be near them.
            delay: Dead time, frames.
            poses: Differences of poses, (F, n, 3).
            commands: Differences of sent commands, (F, n, 3).
        """
        # Body axes in the world frame, (F, 3, 3)
        body_axes = body_to_world(np.eye(3), reference[:, 2:]).swapaxes(1, 2)
        basis = _polynomial_basis(reference)
        velocity = np.diff(poses, axis=0) / PERIOD_S
        inputs = _delay(velocity, 1), _delay(commands, delay), _delay(commands, delay + 1)
        in_body = [
            np.einsum("kji,knj->kni", body_axes[:-1], x[: len(velocity)])
            for x in (velocity, *inputs)
        ]
        regressors = np.concatenate(in_body[1:], axis=2)[..., None] * basis[:-1, None, None]
        rows = regressors.reshape(-1, regressors[0, 0].size)
        solution = scipy.linalg.lstsq(rows, in_body[0].reshape(-1, 3), cond=1e-4)[0]
        coefficients = solution.reshape(3, 3, basis.shape[1], 3)
        matrices = np.einsum("mjbi,kb->mkij", coefficients, basis)
        in_world = body_axes @ matrices @ body_axes.swapaxes(-1, -2)
        return cls(in_world[0], in_world[1:], delay)

    def operators(self) -> tuple[sp.csc_matrix, sp.csc_matrix]:
        """Return the model of all frames as sparse M (6F, 6F) and N (6F, 3F).

        Together they state M [dp; dv] = N du. Each vector stacks its values of all frames.
        """
        size = 3 * self.frames

        def shift(frames: int) -> sp.spmatrix:
            return sp.eye(size, k=-3 * frames)

        lag = sp.eye(size) - sp.block_diag(self.velocity) @ shift(1)
        inputs = sp.block_diag(self.command[0]) @ shift(self.delay)
        inputs = inputs + sp.block_diag(self.command[1]) @ shift(self.delay + 1)
        motion = sp.bmat([[sp.eye(size) - shift(1), -PERIOD_S * shift(1)], [None, lag]])
        return motion.tocsc(), sp.vstack([sp.csc_matrix((size, size)), inputs]).tocsc()


def _polynomial_basis(reference: Array) -> Array:
    """Return 1, speed, speed^2, smoothed acceleration and scaled turn rate of frames, (F, 5)."""
    velocity = np.gradient(reference, PERIOD_S, axis=0)
    speed = np.hypot(velocity[:, 0], velocity[:, 1])
    window = np.hanning(SMOOTHING_FRAMES + 2)[1:-1]
    acceleration = np.gradient(velocity[:, :2], PERIOD_S, axis=0)
    smooth = [np.convolve(axis, window / window.sum(), "same") for axis in acceleration.T]
    turn_rate = np.abs(velocity[:, 2]) / TURN_SCALE_RAD_S
    return np.stack([np.ones_like(speed), speed, speed**2, np.hypot(*smooth), turn_rate], axis=1)


def _delay(values: Array, frames: int) -> Array:
    """Return values delayed by a number of frames, with zeros in front."""
    return np.pad(values, [(frames, 0), (0, 0), (0, 0)])
