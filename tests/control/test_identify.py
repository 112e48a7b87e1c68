"""What the identifier finds of robots that keep to its law, how sure it is of that, and what of those that do not.

The robots are written without the code under test: the law, integrated in 20 small steps a frame.
"""

import numpy as np
import pytest

from omni_control import CommandsInFlight
from omni_control.estimation import belief, motion
from omni_control.estimation.identify import Identifier
from omni_control.estimation.motion import plane
from omni_control.kinematics import Array

T, DELAY, NOISE, FINE = 1 / 60, 6, 0.0013, 20
TOLD = (0.02, 0.05, 0.04)  # lag, creep and friction
GIVES = np.array([1.0, 5 / 3])


class Creeping:
    """n robots with heading 0 that creep: parameters (n, 8) in the order of `motion.NAMES`, and grips, m/s^2."""

    def __init__(self, parameters: Array, grip: float | Array = np.inf) -> None:
        n = len(parameters)
        self.parameters, self.grip = parameters, np.broadcast_to(grip, n)
        self.position, self.velocity = np.zeros((2, n, 2))
        self._sent = np.zeros((40, n, 2))

    def advance(self, command: Array, push: float | Array = 0.0) -> None:
        """Send commands (n, 2) and go on by a frame, pushed by accelerations forward."""
        self._sent = np.concatenate([self._sent[1:], command[None]])
        compass, g, creep = self.parameters[:, 0], self.parameters[:, 1:3], self.parameters[:, 3:5]
        friction, latency, lag = self.parameters[:, 5:6], DELAY + self.parameters[:, 6], self.parameters[:, 7:8]
        age = np.floor(latency - (np.arange(FINE)[:, None] + 0.5) / FINE).astype(int) + 1
        sent = plane(self._sent[-1 - age, np.arange(len(compass))]) * np.exp(-1j * compass)
        told, dry, still, soft = np.stack([sent.real, sent.imag], axis=-1), friction * GIVES, lag * GIVES, g**2 * creep
        for u in told:
            v = self.velocity
            size = np.hypot(v[:, :1], v[:, 1:])
            pull = (u - (dry / np.maximum(size, 0.02) + g) * v) / (still + soft * size)
            if np.isfinite(self.grip).any():
                pull *= np.minimum(1, self.grip / np.maximum(np.hypot(*pull.T), 1e-9))[:, None]
            pull[:, 0] += push
            self.velocity = v + T / FINE * pull
            self.position = self.position + T / FINE * (v + self.velocity) / 2


def believed(rng: np.random.Generator, n: int) -> Array:
    """Parameters drawn from what the identifier believes beforehand."""
    prior = Identifier(np.zeros(1, complex), T, DELAY, NOISE, *TOLD)
    drawn = rng.multivariate_normal(prior.motion.parameters[0], prior.variance[0, 6:, 6:], n)
    return np.clip(drawn, prior._lowest + 0.02 * (prior._highest - prior._lowest), prior._highest)


def weaving(rng: np.random.Generator, frames: int, n: int) -> Array:
    """Commands (frames, n, 2): sines of up to 1.5 m/s with periods of 2 to 6 s, different ones along both axes."""
    time = T * np.arange(frames)[:, None, None]
    period, phase = rng.uniform(2, 6, (n, 2)), rng.uniform(0, 2 * np.pi, (n, 2))
    return rng.uniform(0.8, 1.5, (n, 2)) * (np.sin(2 * np.pi * time / period + phase) - np.sin(phase))


def follow(
    plant: Creeping,
    commands: Array,
    rng: np.random.Generator,
    told: int = DELAY,
    unseen: slice = slice(0),
    silent: slice = slice(0),
    push: float | Array = 0,
    hand: float | Array = 0,
    blow: float | Array = 0,
    batches: int = 1,
    alpha: tuple[float, float] | None = None,
) -> tuple[Identifier, Array, Array]:
    """Identify while commands (frames, n, 2) are driven; the identifier, parameters and their sigma, (frames, n, 8).

    In frames that are silent, robots are told to stand in place of what was sent. Before frame 300 a hand displaces
    them, (n, 2) m, and a blow makes them faster, (n, 2) m/s. Robots of as many batches are seen with the same noise.
    """
    frames, n = commands.shape[:2]
    found = Identifier(np.zeros(n, complex), T, told, NOISE, *TOLD, alpha=alpha)
    sent, history, sigma = CommandsInFlight(n, found.longest), [], []
    for k in range(frames):
        if k == 300:
            plant.position, plant.velocity = plant.position + hand, plant.velocity + blow
        noise = np.tile(NOISE * rng.standard_normal((n // batches, 2)), (batches, 1))
        seen = plane(plant.position + noise)
        if k in range(*unseen.indices(frames)):
            seen[:] = np.nan
        found.update(seen, np.zeros(n), found.acted(sent))
        history.append(found.motion.parameters.copy())
        sigma.append(found.sigma)
        sent.push(np.concatenate([commands[k], np.zeros((n, 1))], axis=1))
        plant.advance(commands[k] * (k not in range(*silent.indices(frames))), push if 300 <= k < 312 else 0.0)
    return found, np.array(history), np.array(sigma)


def test_parameters_are_found_and_their_uncertainty_is_honest() -> None:
    """Of 40 robots drawn from the belief that weave for 10 s with the noise of vision.

    Errors over their standard deviations: were all of it normal and linear, 1 in the mean of squares and 95 % below 2.
    The filter allows for changes that do not happen, so it may be too modest; it is not to be too sure.
    """
    rng = np.random.default_rng(0)
    truth = believed(rng, 40)
    _, found, sigma = follow(Creeping(truth), weaving(rng, 600, 40), rng)
    ratio = (found[-1] - truth) / sigma[-1]
    squares = (ratio**2).mean(0)
    assert (squares < 1.6).all(), dict(zip(motion.NAMES, squares, strict=True))
    assert (np.abs(ratio) < 2.5).mean() > 0.95
    # Driving shows what matters: effort to 3 %, creep forward to 0.015 s^2/m, latency to 0.6 frames.
    assert sigma[-1].mean(0)[1:3].max() < 0.05
    assert np.sqrt(((found[-1] - truth) ** 2).mean(0))[[1, 3, 6]] == pytest.approx([0.02, 0.008, 0.35], abs=0.35)


@pytest.mark.parametrize("wrong", [-2, 2])
def test_a_dead_time_that_is_told_wrong_is_found(wrong: int) -> None:
    """Within 0.75 frames in the mean of ten robots, after five seconds."""
    rng = np.random.default_rng(1)
    truth = np.tile([0, 1.1, 1.15, 0.05, 0.085, 0.03, 0.0, 0.015], (10, 1))
    _, found, _ = follow(Creeping(truth), weaving(rng, 300, 10), rng, told=DELAY + wrong)
    assert found[-1, :, motion.LATENCY].mean() + wrong == pytest.approx(0, abs=0.75)


def test_alpha_is_what_is_told_until_driving_shows_another() -> None:
    """Robots are as they are told, or weaker by nearly three standard deviations: both are found in five seconds.

    Those that are as they are told are known better after half a second than by who was told nothing, by half.
    """
    rng = np.random.default_rng(7)
    alpha = (0.92, 0.84)
    own, other = ([0, 1 / ahead, 1 / aside, 0.05, 0.085, 0.03, 0, 0.015] for ahead, aside in (alpha, (0.8, 0.72)))
    truth, commands = np.array([own, other] * 5), weaving(rng, 300, 10)
    found, sigma = follow(Creeping(truth), commands, np.random.default_rng(8), alpha=alpha)[1:]
    unaware = follow(Creeping(truth), commands, np.random.default_rng(8))[1]
    np.testing.assert_allclose(found[0, :, motion.EFFORT], np.tile(1 / np.array(alpha), (10, 1)), atol=1e-3)
    np.testing.assert_allclose(sigma[0, :, motion.EFFORT], belief.KNOWN.effort, rtol=1e-3)
    np.testing.assert_allclose(found[-1, :, motion.EFFORT], truth[:, motion.EFFORT], atol=0.05)
    errors = [np.abs(each[:30, ::2, motion.EFFORT] - truth[::2, motion.EFFORT]).mean() for each in (found, unaware)]
    assert errors[0] < errors[1] / 2


def test_what_no_robot_can_be_is_not_believed() -> None:
    """Of a robot that is said to reach a twentieth of what it is told, or three times that, the nearest that may be."""
    for alpha in ((0.05, 3.0), (3.0, 0.05)):
        found = Identifier(np.zeros(1, complex), T, DELAY, NOISE, 3.0, 2.0, 1.0, alpha=alpha)
        assert (found.motion.parameters[0] >= found._lowest).all()
        assert (found.motion.parameters[0] <= found._highest).all()


def test_an_axis_that_is_not_driven_is_believed_to_be_like_the_other() -> None:
    """Driven forward only: effort aside stays where it was believed to be, or goes along by half; it is less sure."""
    rng = np.random.default_rng(2)
    commands = weaving(rng, 480, 4) * [1.0, 0.0]
    _, found, sigma = follow(Creeping(np.tile([0, 1.25, 0.95, 0.05, 0.08, 0.03, 0, 0.015], (4, 1))), commands, rng)
    forward, aside = found[-1, :, 1], found[-1, :, 2]
    np.testing.assert_allclose(forward, 1.25, atol=0.03)
    assert ((aside > belief.EFFORT - 0.02) & (aside < 1.25)).all()
    assert (sigma[-1, :, 2] > 2 * sigma[-1, :, 1]).all()


def test_at_rest_what_was_found_is_forgotten() -> None:
    """By its law, exponentially: of what differs from the belief, exp(-5 s / 12 s) is left after five seconds."""
    rng = np.random.default_rng(3)
    commands = np.concatenate([weaving(rng, 360, 3), np.zeros((360, 3, 2))])
    _, found, _ = follow(Creeping(np.tile([0, 1.3, 1.3, 0.05, 0.08, 0.0, 0, 0.015], (3, 1))), commands, rng)
    off = found[[420, 719], :, 1:3].mean((1, 2)) - belief.EFFORT
    assert off[1] / off[0] == pytest.approx(np.exp(-299 * T / belief.KEPT_S), abs=0.1)


def test_half_a_second_without_vision_costs_nothing_but_evidence() -> None:
    """A robot that keeps to the law is where it is predicted, within what its parameters are not known."""
    rng = np.random.default_rng(4)
    plant, commands = Creeping(np.tile([0, 1.15, 1.2, 0.05, 0.085, 0.03, 0, 0.015], (10, 1))), weaving(rng, 390, 10)
    found, history, _ = follow(plant, commands, rng, unseen=slice(360, 390))
    assert np.abs(history[-1] - history[359])[:, 1:3].max() < 0.02
    assert np.abs(found.position - plane(plant.position)).max() < 0.05


@pytest.mark.parametrize(("hidden", "hand"), [(0, 0.05), (9, 0.4)])
def test_a_robot_that_is_put_elsewhere_has_not_driven_there(hidden: int, hand: float) -> None:
    """Seen at once, or after nine frames: from the sixth image on its velocity is known, and of the rest what was.

    Taken for a way that was driven, 5 cm would be a velocity of 0.3 m/s and more.
    """
    rng = np.random.default_rng(9)
    truth, commands = np.tile([0, 1.1, 1.15, 0.05, 0.085, 0.03, 0, 0.015], (10, 1)), weaving(rng, 306 + hidden, 10)
    plant = Creeping(truth)
    found, history, _ = follow(plant, commands, rng, unseen=slice(300, 300 + hidden), hand=np.array([hand, 0.0]))
    assert np.abs(found.velocity - plane(plant.velocity)).max() < 0.15
    assert np.abs(found.push).max() < 0.05
    assert np.abs(history[-1] - history[299])[:, motion.EFFORT].max() < 0.03


@pytest.mark.parametrize("faster", [0.4, 3.0])
def test_a_blow_is_found_in_six_images(faster: float) -> None:
    """Of less than what could be taken for a hand's, or of more, to a quarter of it, which wheels soon brake again."""
    rng = np.random.default_rng(10)
    plant = Creeping(np.tile([0, 1.1, 1.15, 0.05, 0.085, 0.03, 0, 0.015], (10, 1)))
    found, _, _ = follow(plant, weaving(rng, 306, 10), rng, blow=np.array([faster, 0.0]))
    assert np.abs(found.velocity - plane(plant.velocity)).max() < faster / 4


def test_a_robot_that_hears_nothing_tells_nothing_of_itself() -> None:
    """A radio that is silent for 3 s: what was found stays, but for what is forgotten at rest, a fifth of the way back.

    Taken for another robot it would creep four times as much, and answer four frames later or sooner.
    """
    rng = np.random.default_rng(8)
    truth = np.tile([0, 1.1, 1.15, 0.05, 0.085, 0.03, 0, 0.015], (10, 1))
    _, history, _ = follow(Creeping(truth), weaving(rng, 480, 10), rng, silent=slice(300, 480))
    before, after = history[299], history[479]
    assert np.abs(after - before)[:, motion.EFFORT].max() < 0.1
    assert np.abs(after / before - 1)[:, motion.CREEP].max() < 0.3
    assert np.abs(after - before)[:, motion.LATENCY].max() < 0.75


def test_wheels_that_slide_and_pushes_leave_what_is_found_sane() -> None:
    """A grip of 1.5 m/s^2 that sines of 3 m/s^2 exceed; a push of 5 m/s^2 for 0.2 s. Alpha stays in [0.65, 1.15].

    Sliding is noticed, and not where nothing slides. Ten robots each, all in one.
    """
    rng, none = np.random.default_rng(5), np.zeros(10)
    truth = np.tile([0, 1.1, 1.15, 0.05, 0.085, 0.03, 0, 0.015], (30, 1))
    commands = weaving(rng, 480, 10)
    commands = np.concatenate([commands, 1.3 * commands, 1.3 * commands], axis=1)
    grip, push = np.concatenate([none + np.inf, none + 1.5, none + np.inf]), np.concatenate([none, none, none + 5.0])
    found, history, _ = follow(Creeping(truth, grip), commands, np.random.default_rng(6), push=push, batches=3)
    assert found.sliding[:10].max() < 0.5
    alpha = 1 / history[:, 10:, 1:3]
    assert alpha.min() > 0.65
    assert alpha.max() < 1.15
    assert np.abs(history[:, 10:, motion.LATENCY]).max() < 4.01
    assert np.isfinite(found.surprise).all()


def test_a_row_of_a_batch_is_what_it_is_alone() -> None:
    """To the bit, whatever the other rows are."""
    rng = np.random.default_rng(7)
    truth, commands = believed(rng, 9), weaving(rng, 120, 9)
    noise = NOISE * rng.standard_normal((120, 9, 2))

    def run(rows: list[int]) -> Array:
        plant, found = Creeping(truth[rows]), Identifier(np.zeros(len(rows), complex), T, DELAY, NOISE, *TOLD)
        sent = CommandsInFlight(len(rows), found.longest)
        for k in range(120):
            found.update(plane(plant.position + noise[k, rows]), np.zeros(len(rows)), found.acted(sent))
            sent.push(np.concatenate([commands[k, rows], np.zeros((len(rows), 1))], axis=1))
            plant.advance(commands[k, rows])
        return found.variance, found.motion.parameters

    for whole, alone in zip(run(list(range(9))), run([4]), strict=True):
        np.testing.assert_array_equal(whole[4], alone[0])
