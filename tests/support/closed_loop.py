"""Plants written without the code under test, and closed loops around them."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.signal import cont2discrete

from omni_control import CommandHistory, Controller, Kinematics, Observation, Team, TeamModel
from omni_control.kinematics import Array

T, SUBSTEPS = 1 / 60, 8
NOISE = np.array([0.0013, 0.0013, 0.01])  # of vision in the league, m and rad
MEMORY = 40  # commands that a plant stores, frames
WHEELS = Kinematics(np.radians([60.0, 135.0, 225.0, 300.0]), 0.083, 0.0285)
SIDE = 5 / 3  # lag and friction sideways over those forward, with these wheels
CONTACT_RATIO = 2.8  # of the axes of a contact


_RIMS = np.stack([-np.sin(WHEELS.azimuths), np.cos(WHEELS.azimuths)], axis=1)
_AXLES = np.stack([np.cos(WHEELS.azimuths), np.sin(WHEELS.azimuths)], axis=1)
_RIM_SQUARES = _RIMS[:, :, None] * _RIMS[:, None]


def _invert_stiffness(twist: Array) -> Array:
    along_rims = twist[:, :2] @ _RIMS.T + WHEELS.arm * twist[:, 2:]
    speeds = np.hypot(along_rims, CONTACT_RATIO * twist[:, :2] @ _AXLES.T)
    return np.linalg.inv(np.tensordot(_LOADS / np.maximum(speeds, 1e-9), _RIM_SQUARES, 1))


_FEET = np.array([np.ones(4), *_AXLES.T])
_LOADS = np.linalg.lstsq(_FEET, [4, 0, 0], rcond=None)[0]  # statics of four feet


_FORWARD_SPEED = _invert_stiffness(np.array([[1.0, 0.0, 0.0]]))[0, 0, 0]


def compute_creep_speeds(twist: Array) -> Array:
    """Return the matrices (n, 2, 2), m/s, by which a creep coefficient is multiplied.

    They are the inverse of sum d d^T / |V|_c over the wheels, with the rim directions d and the
    speeds |V|_c through elliptic contacts. The scale gives the speed itself in forward motion.

    Args:
        twist: Body twists (n, 3).
    """
    return _invert_stiffness(twist) / _FORWARD_SPEED


def rotate(twist: Array, angle: Array) -> Array:
    """Return twists (n, 3) whose translation is rotated by angles (n,)."""
    c, s = np.cos(angle), np.sin(angle)
    return np.stack(
        [c * twist[:, 0] - s * twist[:, 1], s * twist[:, 0] + c * twist[:, 1], twist[:, 2]], axis=1
    )


class Plant:
    """Robots whose commands act after a dead time.

    Args:
        start: Poses (n, 3).
        delay: Dead times, (n,) or one for all, frames; whole or half frames for `CreepingPlant`.

    Attributes:
        pose, twist: True poses and twists, (n, 3).
    """

    def __init__(self, start: ArrayLike, delay: ArrayLike) -> None:
        self.pose = np.array(start, float)
        self.twist = np.zeros_like(self.pose)
        self._robots, self._delay = np.arange(len(self.pose)), np.asarray(delay)
        self._sent = np.zeros((MEMORY, *self.pose.shape))

    def advance(self, command: Array) -> None:
        """Advance by a frame in which commands (n, 3) are sent, world frame."""
        self._sent = np.concatenate([self._sent[1:], [command]])

    def get_acting(self, fraction: float = 0.0) -> Array:
        """Return the commands (n, 3) that act when a fraction of the frame is over."""
        return self._sent[MEMORY - 1 + np.floor(fraction - self._delay).astype(int), self._robots]


class LaggedPlant(Plant):
    """Robots with x' = v, v' = (alpha u - v) / lag in the world frame, from rest.

    Without a lag, this is equation 7 of the paper.

    Args:
        start, delay: As of `Plant`.
        lag: Time constant, s.
        alpha: Factors, (n, 3) or one for all.
    """

    def __init__(
        self, start: ArrayLike, delay: ArrayLike, lag: float = 0.0, alpha: ArrayLike = 1.0
    ) -> None:
        super().__init__(start, delay)
        self._lag, self._alpha = lag, np.asarray(alpha, float)

    def advance(self, command: Array) -> None:
        super().advance(command)
        # Closed form of the exponential approach to the new speed.
        speed = self._alpha * self.get_acting()
        decay = np.exp(-T / self._lag) if self._lag else 0.0
        self.pose = self.pose + speed * T + (self.twist - speed) * self._lag * (1 - decay)
        self.twist = speed + (self.twist - speed) * decay


def discretize_lag(lag: float, period: float = T) -> tuple[Array, Array]:
    """Return A (2, 2) and B (2, 1) of a robot with x' = v, v' = (u - v) / lag, by scipy.

    The state is [x, v], and each command u is held for a period.
    """
    equation = np.array([[0, 1], [0, -1 / lag]]), np.array([[0], [1 / lag]]), np.eye(2), [[0], [0]]
    transition, effect, *_ = cont2discrete(equation, period, "zoh")
    return transition, effect


class CreepingPlant(Plant):
    """Robots with (lag + g creep S g) v' = u - friction v / |v| - g v in the body's axes.

    S is the matrix of `compute_creep_speeds`. Turning has a lag.

    Args:
        start, delay: As of `Plant`.
        lag, creep, friction: Forward, s, s^2/m, m/s.
        alpha: 1 / g forward, sideways, turning, (3,) or (n, 3).
    """

    def __init__(
        self,
        start: ArrayLike,
        delay: ArrayLike = 6,
        lag: float = 0.02,
        creep: float = 0.06,
        friction: ArrayLike = 0.03,
        alpha: ArrayLike = (0.92, 0.87, 0.98),
    ) -> None:
        super().__init__(start, delay)
        self._lag, self._creep, self._friction = lag, creep, friction
        self._gain = 1 / np.asarray(alpha)
        self._body_twist = np.zeros_like(self.pose)

    def advance(self, command: Array) -> None:
        super().advance(command)
        gain, side, dt = self._gain, np.array([1.0, SIDE]), T / SUBSTEPS
        gain_matrix = gain[..., :2, None] * gain[..., None, :2]
        halves = self.get_acting(), self.get_acting(0.5)
        lag = self._lag * np.diag(side)
        for i in range(SUBSTEPS):
            v, heading = self._body_twist, self.pose[:, 2]
            u = rotate(halves[2 * i // SUBSTEPS], -heading)
            speed = np.hypot(v[:, 0], v[:, 1])[:, None]
            friction = self._friction * side * v[:, :2] / np.maximum(speed, 0.05)
            creep = self._creep * gain_matrix * compute_creep_speeds(v)
            residual = (u - gain * v)[:, :2] - friction
            rate = np.linalg.solve(lag + creep, residual[..., None])[..., 0]
            turning = (u - gain * v)[:, 2:] / (0.25 * self._lag)
            # Rotation of the axes leaves the velocity in the world unchanged.
            spin = v[:, 2:] * np.stack([v[:, 1], -v[:, 0]], axis=1)
            self._body_twist = v + dt * np.concatenate([rate + spin, turning], axis=1)
            self.twist = rotate(self._body_twist, heading)
            self.pose = self.pose + dt * self.twist


class Run(NamedTuple):
    """True poses, predicted poses and sent commands of a run, (frames, n, 3) each."""

    pose: Array
    predicted_pose: Array
    sent: Array


def make_vision_noise(rng: np.random.Generator, frames: int, n: int, gaps: float = 0.0) -> Array:
    """Return noise of vision (frames, n, 3), NaN where a robot is not seen.

    Robots are not seen in 2 % of the frames. With a probability of `gaps` per frame, they are not
    seen for ten frames. In the first frame, they are always seen.
    """
    noise = NOISE * rng.standard_normal((frames, n, 3))
    unseen, gap_starts = rng.random((frames, n)) < 0.02, rng.random((frames, n)) < gaps
    for i in range(10):
        unseen[i:] |= gap_starts[: frames - i]
    unseen[0] = False
    noise[unseen] = np.nan
    return noise


def to_measured_pose(pose: Array) -> Array:
    """Return poses (n, 3) as vision reports them, with headings in (-pi, pi]."""
    return np.column_stack([pose[:, :2], np.angle(np.exp(1j * pose[:, 2]))])


def make_empty_history(controller: Controller) -> CommandHistory:
    """Return a history of zero commands, as many as a controller needs."""
    return CommandHistory(len(controller.predicted_pose), controller.memory_frames)


def make_observation(
    model: TeamModel,
    pose: ArrayLike,
    sent: CommandHistory,
    twist: Array | None = None,
    measured: Array | None = None,
) -> Observation:
    """Return an observation of robots at `pose` (n, 3); what is not given is NaN."""
    pose = np.array(pose, float)
    unknown = np.full_like(pose, np.nan)
    twist, measured = (unknown if values is None else values for values in (twist, measured))
    return Observation(
        pose, twist, measured, sent.select(slice(None)), model.period, model.delay_frames
    )


def run_controller(
    controller: Controller,
    plant: Plant,
    noise: Array | int,
    *,
    limits: Callable[[Array, Array], Array] = lambda command, last: command,
    first_frame: int = 0,
) -> Run:
    """Run a controller without a team's filter.

    Args:
        controller: The controller.
        plant: Robots at their start.
        noise: Of vision, (frames, n, 3), or for how many frames it is zero.
        limits: Function from a command and the last one to the command that is sent.
        first_frame: Number of the first frame.
    """
    sent, queue = np.zeros_like(plant.pose), make_empty_history(controller)
    rows = []
    for k, error in enumerate(np.zeros((noise, 1, 3)) if isinstance(noise, int) else noise):
        queue.append(sent)
        pose = plant.pose + error
        observation = make_observation(controller.model, pose, queue, plant.twist, pose)
        sent = limits(controller.command(first_frame + k, observation), sent)
        rows.append((plant.pose, controller.predicted_pose.copy(), sent))
        plant.advance(sent)
    return Run(*(np.array(column) for column in zip(*rows, strict=True)))


def run_team(
    team: Team,
    plant: Plant,
    noise: Array | int,
    *,
    camera: Callable[[int, Array, Array], Array] = lambda frame, image, last: image,
    is_received: Callable[[int], bool] = lambda frame: True,
) -> dict[str, Array]:
    """Run a team; return true poses and what the team records, (frames, n, k) by name.

    Args:
        team: Team of these robots.
        plant: Robots at their start.
        noise: Of vision, (frames, n, 3), or the number of frames for which it is drawn.
        camera: Function from the number of a frame, its measured poses and the poses returned for
            the frame before to the poses that the team gets.
        is_received: Whether the commands sent in a frame arrive; otherwise robots get zero.
    """
    if isinstance(noise, int):
        noise = NOISE * np.random.default_rng(0).standard_normal((noise, *plant.pose.shape))
    image, record = plant.pose, []
    for frame, error in enumerate(noise):
        image = camera(frame, to_measured_pose(plant.pose + error), image)
        command = team.step(image, (plant.pose, plant.twist))
        estimates = {
            name: np.array(getattr(team, name))
            for name in ("estimate", "predicted_pose", "alpha_hat", "latency_hat")
        }
        record.append({"pose": plant.pose, "command": command, **team.channels, **estimates})
        plant.advance(command if is_received(frame) else np.zeros_like(command))
    return {name: np.array([entry[name] for entry in record]) for name in record[0]}


DISPLACEMENT_NOISE_RATIO, DRIFT, DRIFT_TIME_S = 0.06, (0.1, 0.1, 0.5), 0.5


def simulate_drift(
    seed: int, frames: int, n: int, scale: float = 1.0, missed: float = 0.02
) -> tuple[Array, Array, Array]:
    """Return true poses, measured poses and commanded displacements, (frames, n, 3) each.

    Args:
        seed: Seed of the random numbers.
        frames: Number of frames.
        n: Number of robots.
        scale: Ratio of the process noise's variance to the variance that the filter assumes.
        missed: Fraction of the poses that are not seen.
    """
    rng = np.random.default_rng(seed)
    # Speeds that change slowly, as under a limit of acceleration.
    phase, rate = rng.uniform(0, 2 * np.pi, (2, 1, n, 3))
    displacement = (
        T * np.array([1.0, 1.0, 2.0]) * np.sin(phase + T * rate * np.arange(frames)[:, None, None])
    )
    pose, drift, poses = rng.uniform(-1, 1, (n, 3)), np.zeros((n, 3)), []
    for q in displacement:
        gain_noise = (
            np.sqrt(scale) * DISPLACEMENT_NOISE_RATIO * np.abs(q) * rng.standard_normal((n, 3))
        )
        pose = pose + q + T * drift + gain_noise
        drift_noise = np.sqrt(scale * T) * np.array(DRIFT) * rng.standard_normal((n, 3))
        drift = drift * np.exp(-T / DRIFT_TIME_S) + drift_noise
        poses.append(pose)
    true = np.array(poses)
    measured = true + np.array(NOISE) * rng.standard_normal(true.shape)
    measured[rng.random((frames, n)) < missed] = np.nan
    return true, measured, displacement
