"""The simulation: all controllers in all cases side by side, first told to jump aside, then disturbed by sines.

Robots look along x. They stand, or drive forward and weave about that. A constant speed tells a
controller that identifies the robot nothing of its latency; weaving makes an eighth of a second's
lateness worth 3 cm.

Rows come in pairs that are asked the opposite, under the same noise. Half of what they do
differently answers to what they were asked: vision's noise, the weave and the ripple of rollers are
in both alike, and fall out.
"""

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from omni_control.kinematics import Array
from omni_mj.config.rows import Row
from omni_mj.config.scenario import Scenario
from omni_mj.config.settings import FRAME_RATE_HZ, PERIOD_S
from omni_mj.simulation.simulation import Simulation
from omni_mj.studies.study_runner import AfterFrame, resting_reference, send_twists

# Whether robots drive, and the axis along which they jump and are disturbed: 0 forward, 1 to the
# left
CASES = {
    "rest, forward": (False, 0),
    "rest, sideways": (False, 1),
    "driving, along": (True, 0),
    "driving, across": (True, 1),
}
SPEED_M_S, ACCELERATION_M_S2 = 1.0, 2.0  # forward, of robots that drive
WEAVE_M_S, WEAVE_FRAMES = 0.25, 480  # forward and to the left
# Half a period of the weave: what its speeding up does to the first of two periods, its slowing
# down undoes in the second, and no other sine of the sum shows in its place.
PERIOD_FRAMES, PERIODS = WEAVE_FRAMES // 2, 2
TONES = np.array([1, 2, 3, 4, 5, 6, 7, 8, 10, 12, 14, 17, 20, 24])  # sines: how often in a period
FREQUENCIES = 2 * np.pi * TONES / (PERIOD_FRAMES * PERIOD_S)  # rad/s: 1.6 to 38
RMS_M_S = 0.04  # of the sum of sines
STEP_M = 0.05  # half the range of the fuzzy controller's input
WARM_UP, STEP, SWING_IN, MEASURED = (
    3 * FRAME_RATE_HZ,
    3 * FRAME_RATE_HZ,
    PERIOD_FRAMES,
    PERIODS * PERIOD_FRAMES,
)
FRAMES = WARM_UP + STEP + SWING_IN + MEASURED


def make_multisine(seed: int) -> Array:
    """Return the sum of sines with phases by a seed, swung in and measured, (SWING_IN + MEASURED,) m/s."""
    phases = np.random.default_rng([seed, 2]).uniform(0, 2 * np.pi, len(TONES))
    turns = np.arange(-SWING_IN - MEASURED, 0)[:, None] * TONES / PERIOD_FRAMES
    total: Array = np.cos(2 * np.pi * turns + phases).sum(1)
    return RMS_M_S * np.sqrt(2 / len(TONES)) * total


def travel(frame: Array) -> Array:
    """Return how far driving has led robots by `frame` (..., m, 3), without a jump; the same shape, m and rad."""
    time, faster = PERIOD_S * np.maximum(frame, 0), SPEED_M_S / ACCELERATION_M_S2
    forward = SPEED_M_S * (
        np.minimum(time, faster) ** 2 / (2 * faster) + np.maximum(time - faster, 0)
    )
    rate = 2 * math.pi / (PERIOD_S * WEAVE_FRAMES)
    woven = WEAVE_M_S / rate * (1 - np.cos(rate * time))
    return np.array([1.0, 0.0, 0.0]) * forward + np.array([1.0, 1.0, 0.0]) * woven


@dataclass(frozen=True)
class SteppedMotion:
    """A reference for robots that all look along x; see `omni_control.reference.Reference`.

    Its poses may jump, while its twists remain those of the motion. Nobody knows of a jump
    beforehand, however far a controller looks ahead.

    Attributes:
        drives: Whether each robot drives forward, (n, 1).
        jump: What is added to the poses of all frames from now on, (n, 3).
        rows: Robots that are meant, of those that these arrays have.
    """

    drives: np.ndarray
    jump: Array
    rows: np.ndarray

    def at(self, frame: float | Array, pose: Array) -> tuple[Array, Array]:
        """Return pose and twist at a frame."""
        poses, twists = self.preview(frame, pose, 1)
        return poses[0], twists[0]

    def preview(self, frame: float | Array, pose: Array, count: int) -> tuple[Array, Array]:
        """Return poses and twists from a frame on."""
        first = np.asarray(frame, float)
        first = first[:, None] if first.ndim == 1 else first
        start = np.broadcast_to(first, pose.shape) + np.arange(float(count))[:, None, None]
        here, later = (self.drives[self.rows] * travel(frames) for frames in (start, start + 1))
        return here + self.jump[self.rows], (later - here) / PERIOD_S


class LoopExperiment:
    """Rows for each controller, case, seed and sign, in this order of a grid.

    The loop is opened where commands are sent, behind filter, controller and limits. What the sines
    add there nobody on the team knows: what it remembers as sent is what it commanded, so that the
    gain around the loop counts a controller's own prediction as part of the controller, and the
    robot with its dead time as what it controls.

    Args:
        scenario: Controllers, seeds, robot, plant, and all settings but the reference.

    Attributes:
        simulation: Of all rows.
        asked: Case and sign of each row, by these names, (n,).
        disturbance: What is added to commands along each row's axis, (FRAMES, n) m/s.
    """

    def __init__(self, scenario: Scenario) -> None:
        settings = scenario.settings.replace(
            reference=resting_reference(FRAMES), world={"start_poses": [[0, 0, 0]]}
        )
        self._shape = len(scenario.labels), len(CASES), scenario.seeds, 2
        grid = list(itertools.product(scenario.labels, CASES, scenario.seed_list, (1, -1)))
        rows = [
            Row(i, 0, label, seed, settings, scenario.robot)
            for i, (label, _, seed, _) in enumerate(grid)
        ]
        _, names, seeds, signs = zip(*grid, strict=True)
        self.asked = {"case": np.array(names), "sign": np.array(signs)}
        drives, axes = zip(*(CASES[name] for name in names), strict=True)
        self._motion = SteppedMotion(
            np.array(drives)[:, None], np.zeros((len(rows), 3)), np.arange(len(rows))
        )
        self._along = np.arange(len(rows)), np.array(axes)
        self.simulation = Simulation(
            scenario, rows=rows, follow=lambda rows: replace(self._motion, rows=rows)
        )
        self.disturbance = np.zeros((FRAMES, len(rows)))
        self.disturbance[WARM_UP + STEP :] = (
            np.transpose([make_multisine(seed) for seed in seeds]) * signs
        )

    def run(self, after_frame: AfterFrame) -> str | None:
        """Drive; return why that was stopped, or None.

        Args:
            after_frame: Called with each frame's number; it may raise `StoppedError`.
        """
        return send_twists(self.simulation, self._commands(), after_frame)

    def _commands(self) -> Iterator[Array]:
        """Yield what robots are sent in each frame."""
        team = self.simulation.team
        for frame, disturbance in enumerate(self.disturbance):
            if frame == WARM_UP:
                self._motion.jump[self._along] = STEP_M * self.asked["sign"]
            self.simulation.observe()
            wanted = team.command()
            sent = wanted.copy()
            sent[self._along] += disturbance
            # As if in the frame before, so that the limit on changes lets the disturbance through
            team.last_command = sent
            yield sent
            team.last_command = wanted

    def answers(self) -> tuple[Array, Array, Array]:
        """Return positions, commands and disturbances along the axis asked, half the difference of each pair.

        Their shape is (FRAMES, controllers, cases, seeds); m and m/s.
        """
        pose, sent = (
            self.simulation.log.channel(name)[:, *self._along] for name in ("pose", "command")
        )
        channels = np.stack(
            [pose, sent - self.disturbance[: len(sent)], self.disturbance[: len(sent)]]
        )
        grid = channels.reshape(3, -1, *self._shape)
        position, commanded, disturbance = (grid[..., 0] - grid[..., 1]) / 2
        return position, commanded, disturbance
