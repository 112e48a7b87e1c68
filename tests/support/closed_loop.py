"""What tests of controllers share: plants, written without the code under test, and the loop around them."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from omni_control import CommandsInFlight, Controller, Kinematics, Seen, Team, Told
from omni_control.estimation.tracking import KalmanFilter
from omni_control.kinematics import Array

T = 1 / 60
NOISE = np.array([0.0013, 0.0013, 0.01])  # of the vision of a league's field, m and rad
KEPT = 40  # commands that a plant remembers, frames
SPEED, ACCELERATION, TURN_RATE, TURN_ACCELERATION = 3.7, 4.7, 26.0, 50.8  # limits of what may be commanded
Limits = Callable[[Array, Array], Array]


class Plant(Protocol):
    """n robots: true poses and twists (n, 3), and what a frame with new commands (n, 3) does to them."""

    pose: Array
    twist: Array

    def advance(self, command: Array) -> None:
        """Send the commands and go on by a frame."""


class Equation7:
    """x(k+1) = x(k) + alpha(k) T u(k - k_d) in world coordinates.

    Args:
        start: poses (n, 3).
        alpha: factors (frames, n, 3), or what can be broadcast to them but for the frames.
        delay: dead times k_d (n,) or one for all, frames.
    """

    def __init__(self, start: ArrayLike, alpha: ArrayLike, delay: ArrayLike) -> None:
        self.pose = np.array(start, float)
        self.twist = np.zeros_like(self.pose)
        n = len(self.pose)
        alpha = np.asarray(alpha, float)
        self._alpha = alpha if alpha.ndim == 3 else np.broadcast_to(alpha, (1, n, 3))
        self._delay, self._robots = np.broadcast_to(delay, n).astype(int), np.arange(n)
        self._sent, self._frame = np.zeros((KEPT, n, 3)), 0

    def advance(self, command: Array) -> None:
        self._sent[self._frame % KEPT] = command
        felt = self._sent[(self._frame - self._delay) % KEPT, self._robots]
        self.twist = self._alpha[min(self._frame, len(self._alpha) - 1)] * felt
        self.pose = self.pose + self._alpha[min(self._frame, len(self._alpha) - 1)] * T * felt
        self._frame += 1


class Lagged:
    """x' = v, v' = (alpha u(t - delay T) - v) / lag, from rest; each command holds for a frame.

    Args:
        start: poses (n, 3).
        delay: dead time, frames.
        lag: time constant, s; none, if zero.
        alpha: factors, (n, 3) or one for all.
    """

    def __init__(self, start: ArrayLike, delay: int, lag: float, alpha: ArrayLike = 1.0) -> None:
        self.pose = np.array(start, float)
        self.twist = np.zeros_like(self.pose)
        self._lag, self._alpha = lag, np.asarray(alpha, float)
        self._flying = [self.twist] * delay

    def advance(self, command: Array) -> None:
        self._flying.append(command)
        # The closed form: towards the new speed, the difference dying out with the lag's time constant.
        speed = self._alpha * self._flying.pop(0)
        left = np.exp(-T / self._lag) if self._lag else 0.0
        self.pose = self.pose + speed * T + (self.twist - speed) * self._lag * (1 - left)
        self.twist = speed + (self.twist - speed) * left


class BodyFrame:
    """Displacement in a frame = T (alpha u - drag u / |u|) forward, to the left and turning, a latency after u.

    A frame has two halves; the latencies (n, 3) are whole numbers of them, which may differ between the axes. Robots
    rotate commands, which come in world coordinates, by their heading in the middle of the frame in which they act. |u|
    counts turning at 80 mm from the centre, and 0.05 m/s at least.

    Attributes:
        middle: headings in the middle of the frame just past (n,), rad.
    """

    def __init__(self, start: ArrayLike, latency: ArrayLike, alpha: ArrayLike, drag: ArrayLike) -> None:
        self.pose = np.array(start, float)
        self.twist = np.zeros_like(self.pose)
        self.middle = self.pose[:, 2]
        n = len(self.pose)
        halves = np.broadcast_to(latency, (n, 3)) * 2
        self._halves, self._robots = halves.astype(int), np.arange(n)
        assert (self._halves == halves).all(), "whole numbers of halves"
        self._alpha, self._drag = alpha, drag
        self._sent = np.zeros((2 * KEPT, n, 3))  # newest last, by halves of frames

    def advance(self, command: Array) -> None:
        self._sent = np.concatenate([self._sent[2:], [command, command]])
        both = np.array([0, 1])[:, None, None] - self._halves.T - 2
        forward, left, turn = self._sent[both, self._robots].mean(0)  # what acts on each axis, (n, 3) each
        forward, left = forward[:, 0] + 1j * forward[:, 1], left[:, 0] + 1j * left[:, 1]
        for _ in range(6):  # the twist decides on the heading that decides on it: contracts by |u| T / 2 each time
            back = np.exp(-1j * self.middle)
            body = np.stack([(forward * back).real, (left * back).imag, turn[:, 2]], axis=1)
            size = np.sqrt(body[:, 0] ** 2 + body[:, 1] ** 2 + (0.08 * body[:, 2]) ** 2)
            twist = self._alpha * body - self._drag * body / np.maximum(size, 0.05)[:, None]
            self.middle = self.pose[:, 2] + twist[:, 2] * T / 2
        xy = (twist[:, 0] + 1j * twist[:, 1]) * np.exp(1j * self.middle)
        self.twist = np.stack([xy.real, xy.imag, twist[:, 2]], axis=1)
        self.pose = self.pose + T * self.twist


@dataclass
class Run:
    """What happened in each frame, (frames, n, 3) each: the truth, and what the controller said and was sent."""

    pose: Array
    twist: Array
    predicted: Array
    sent: Array
    alpha_hat: Array
    latency_hat: Array


def vision(rng: np.random.Generator, frames: int, n: int, times: float = 1.0, gaps: float = 0.0) -> Array:
    """Noise of vision (frames, n, 3), `times` that of a league's field; not a number where a robot is not seen.

    Robots are missed in 2 % of the frames; with the probability `gaps`, per frame, for ten frames from then on. They
    are seen in the first.
    """
    noise = times * NOISE * rng.standard_normal((frames, n, 3))
    unseen, begins = rng.random((frames, n)) < 0.02, rng.random((frames, n)) < gaps
    for after in range(10):
        unseen[after:] |= begins[: frames - after]
    unseen[0] = False
    noise[unseen] = np.nan
    return noise


def reported(pose: Array) -> Array:
    """Poses (n, 3) as vision reports them, with headings in (-pi, pi]."""
    return np.column_stack([pose[:, :2], np.angle(np.exp(1j * pose[:, 2]))])


def limited(command: Array, last: Array) -> Array:
    """Commands (n, 3) within what may be sent after `last`: translation by its size, turning by itself."""

    def shorten(vector: Array, translation: float, rotation: float) -> Array:
        size = np.hypot(vector[:, 0], vector[:, 1])[:, None]
        xy = vector[:, :2] * np.minimum(1, translation / np.maximum(size, 1e-12))
        return np.concatenate([xy, np.clip(vector[:, 2:], -rotation, rotation)], axis=1)

    return last + shorten(shorten(command, SPEED, TURN_RATE) - last, ACCELERATION * T, TURN_ACCELERATION * T)


def unlimited(command: Array, last: Array) -> Array:
    """Whatever is wanted may be sent."""
    return command


def commands_for(controller: Controller) -> CommandsInFlight:
    """The commands that a controller is to see: all zero, and as many as it needs."""
    return CommandsInFlight(len(controller.predicted), controller.memory_frames)


def seen_at(
    told: Told, pose: ArrayLike, sent: CommandsInFlight, twist: Array | None = None, measured: Array | None = None
) -> Seen:
    """What is known of robots at `pose` (n, 3), of which nothing else is known unless it is given."""
    pose = np.array(pose, float)
    unknown = np.full_like(pose, np.nan)
    twist, measured = (unknown if values is None else values for values in (twist, measured))
    return Seen(pose, twist, measured, sent.of(slice(None)), told.period, told.delay_frames)


def drive(
    controller: Controller,
    plant: Plant,
    noise: Array | int,
    *,
    limits: Limits = unlimited,
    filtered: bool = True,
    first_frame: int = 0,
) -> Run:
    """Close the loop for as many frames as there is `noise` (frames, n, 3), or so many of perfect vision.

    Noisy poses are filtered as a team's computer does, or taken as they are; a controller that knows the truth sees it.
    """
    told, n = controller.told, len(plant.pose)
    exact = isinstance(noise, int) or controller.knows_truth
    sent, queue = np.zeros((n, 3)), commands_for(controller)
    felt = CommandsInFlight(n, int(np.ceil(told.latency_frames)) + 1)
    kalman = KalmanFilter(plant.pose, told.period, told.vision_noise)
    rows: list[tuple[Array, ...]] = []
    for k in range(noise if isinstance(noise, int) else len(noise)):
        queue.push(sent)
        felt.push(sent)
        pose, twist, measured = plant.pose, plant.twist, plant.pose
        if not exact:
            pose = pose + noise[k]  # type: ignore[index]
            measured = reported(pose)
        if not exact and filtered:
            pose = kalman.update(measured, felt.felt(told.latency_frames) * told.period)
            twist = kalman.twist
        wanted = controller.command(first_frame + k, seen_at(told, pose, queue, twist, measured))
        sent = limits(wanted, sent)
        said = (controller.predicted, sent, controller.alpha_hat, controller.latency_hat)
        rows.append((plant.pose, plant.twist, *(np.array(value) for value in said)))
        plant.advance(sent)
    return Run(*(np.array(column) for column in zip(*rows, strict=True)))


GAIN_ERROR, DRIFT, DRIFT_TIME_S = 0.06, (0.1, 0.1, 0.5), 0.5


def driven(seed: int, frames: int, n: int, scale: float = 1.0, missed: float = 0.02) -> tuple[Array, Array, Array]:
    """True poses, poses seen and commanded displacements (frames, n, 3).

    The process noise has `scale` times the variance that the filter states; of the poses a share `missed` is not seen.
    """
    rng = np.random.default_rng(seed)
    # Speeds that change slowly, as under a limit of acceleration.
    phase, rate = rng.uniform(0, 2 * np.pi, (2, 1, n, 3))
    displacement = T * np.array([1.0, 1.0, 2.0]) * np.sin(phase + T * rate * np.arange(frames)[:, None, None])
    pose, drift, poses = rng.uniform(-1, 1, (n, 3)), np.zeros((n, 3)), []
    for q in displacement:
        pose = pose + q + T * drift + np.sqrt(scale) * GAIN_ERROR * np.abs(q) * rng.standard_normal((n, 3))
        drift = drift * np.exp(-T / DRIFT_TIME_S) + np.sqrt(scale * T) * np.array(DRIFT) * rng.standard_normal((n, 3))
        poses.append(pose)
    true = np.array(poses)
    measured = true + np.array(NOISE) * rng.standard_normal(true.shape)
    measured[rng.random((frames, n)) < missed] = np.nan
    return true, measured, displacement


def filtered(measured: Array, displacement: Array, start: Array) -> dict[str, Array]:
    """What the filter says in each frame, (frames, n, 3) each, by the names of its attributes."""
    kalman = KalmanFilter(start, T, NOISE)
    said: dict[str, list[Array]] = {name: [] for name in ("pose", "twist", "drift", "sigma", "normalised")}
    for m, q in zip(measured, displacement, strict=True):
        kalman.update(m, q)
        for name, values in said.items():
            values.append(getattr(kalman, name).copy())
    return {name: np.array(values) for name, values in said.items()}


SUBSTEPS = 16
WHEELS = Kinematics(np.radians([60.0, 135.0, 225.0, 300.0]), 0.083, 0.0285)
SIDE = 5 / 3  # times as much give sideways as forward, with these wheels


@dataclass
class Creeping:
    """Robots of which (tau + g^2 T |v|) v' = u - c n - g v holds along the axes of the body; turning has a lag.

    Args:
        start: poses (n, 3).
        delay: dead time, frames.
        lag, creep, friction: forward, s, s^2/m, m/s.
        alpha: forward, sideways, turning.
    """

    start: Array
    delay: int = 6
    lag: float = 0.02
    creep: float = 0.06
    friction: float = 0.03
    alpha: tuple[float, float, float] = (0.92, 0.87, 0.98)

    def __post_init__(self) -> None:
        self.pose = np.array(self.start, float)
        self.body_twist = np.zeros_like(self.pose)
        self.flying = [np.zeros_like(self.pose)] * self.delay

    def advance(self, command: Array) -> None:
        """Go on by a frame in which the commands (n, 3) are sent, world frame."""
        self.flying.append(command)
        acting, gain, side = self.flying.pop(0), 1 / np.array(self.alpha), np.array([1.0, SIDE])
        for _ in range(SUBSTEPS):
            heading, v = self.pose[:, 2], self.body_twist
            c, s = np.cos(heading), np.sin(heading)
            u = np.stack([c * acting[:, 0] + s * acting[:, 1], c * acting[:, 1] - s * acting[:, 0]], axis=1)
            speed = np.hypot(v[:, 0], v[:, 1])[:, None]
            rubs = self.friction * side * v[:, :2] / np.maximum(speed, 0.05)
            late = self.lag * side + gain[:2] ** 2 * self.creep * side * speed
            rate = (u - rubs - gain[:2] * v[:, :2]) / late
            turning = (acting[:, 2:] - gain[2] * v[:, 2:]) / (0.25 * self.lag)
            # The turning of the axes moves no velocity of the world.
            spin = v[:, 2:] * np.stack([v[:, 1], -v[:, 0]], axis=1)
            dt = T / SUBSTEPS
            self.body_twist = v + dt * np.concatenate([rate + spin, turning], axis=1)
            w = self.body_twist
            world = np.stack([c * w[:, 0] - s * w[:, 1], s * w[:, 0] + c * w[:, 1], w[:, 2]], axis=1)
            self.pose = self.pose + dt * world


def loop(
    team: Team,
    robots: Creeping,
    frames: int,
    *,
    seed: int = 0,
    sees: Callable[[int, Array, Array], Array] = lambda frame, image, last: image,
    hears: Callable[[int], bool] = lambda frame: True,
) -> dict[str, Array]:
    """Drive robots for some frames; return their poses, and what the team records, (frames, n, k) by name.

    Args:
        team: of these robots.
        robots: at their start.
        frames: how many.
        seed: of the noise of vision.
        sees: the image of a frame by its number, what a camera would show, and the image before.
        hears: whether what is sent in a frame arrives; robots stand as long as nothing does.
    """
    rng, image, record = np.random.default_rng(seed), robots.pose.copy(), []
    for frame in range(frames):
        fresh = robots.pose + NOISE * rng.standard_normal(robots.pose.shape)
        fresh[:, 2] = np.angle(np.exp(1j * fresh[:, 2]))
        image = sees(frame, fresh, image)
        command = team.step(image)
        record.append({"pose": robots.pose.copy(), "command": command, **team.channels, "alpha_hat": team.alpha_hat})
        record[-1]["latency_hat"] = team.latency_hat
        robots.advance(command if hears(frame) else np.zeros_like(command))
    return {name: np.array([entry[name] for entry in record]) for name in record[0]}
