"""Experiment of the loop study: a step of the reference, then a multisine added to the command.

Robots head along x. They are at rest, or they drive forward and weave. Adaptive controllers cannot
observe the latency at constant speed. With the weave, an error of 1/8 s in latency is a position
error of 3 cm.

Rows come in pairs with opposite steps and disturbances under the same noise. The response is half
their difference. Camera noise, the weave and the ripple of rollers are the same in both and cancel.
"""

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from omni_control.kinematics import Array
from omni_mj.config import FRAME_RATE_HZ, PERIOD_S
from omni_mj.config.rows import build_single_robot_rows
from omni_mj.config.scenario import Scenario
from omni_mj.results.result import Outcome
from omni_mj.simulation.simulation import Simulation
from omni_mj.studies.open_loop import resting_reference, run_open_loop
from omni_mj.studies.run_scenario import AfterFrame

# Case -> whether robots drive; axis of step and disturbance: 0 forward, 1 sideways
CASES = {
    "rest, forward": (False, 0),
    "rest, sideways": (False, 1),
    "driving, forward": (True, 0),
    "driving, sideways": (True, 1),
}
SPEED_M_S, ACCELERATION_M_S2 = 1.0, 2.0  # forward, of robots that drive
WEAVE_M_S, WEAVE_FRAMES = 0.25, 480  # amplitude forward and sideways; period
# A weave lasts two periods of the multisine. Its acceleration in the second one is opposite to that
# in the first, so it does not appear in the spectrum over both.
PERIOD_FRAMES, N_PERIODS = WEAVE_FRAMES // 2, 2
HARMONICS = np.array([1, 2, 3, 4, 5, 6, 7, 8, 10, 12, 14, 17, 20, 24])  # of the multisine
FREQUENCIES = 2 * np.pi * HARMONICS / (PERIOD_FRAMES * PERIOD_S)  # 1.6 to 38 rad/s
RMS_M_S = 0.04  # root mean square of the multisine
STEP_M = 0.05  # half the input range of the fuzzy controller
WARM_UP_FRAMES = 3 * FRAME_RATE_HZ
STEP_FRAMES = 3 * FRAME_RATE_HZ
TRANSIENT_FRAMES = PERIOD_FRAMES  # of the multisine, before it is measured
MEASURED_FRAMES = N_PERIODS * PERIOD_FRAMES
TOTAL_FRAMES = WARM_UP_FRAMES + STEP_FRAMES + TRANSIENT_FRAMES + MEASURED_FRAMES


def make_multisine(seed: int) -> Array:
    """Return a multisine with random phases, (TRANSIENT_FRAMES + MEASURED_FRAMES,) m/s."""
    phases = np.random.default_rng([seed, 2]).uniform(0, 2 * np.pi, len(HARMONICS))
    frames = np.arange(-TRANSIENT_FRAMES - MEASURED_FRAMES, 0)
    cycles = frames[:, None] * HARMONICS / PERIOD_FRAMES
    total = np.cos(2 * np.pi * cycles + phases).sum(1)
    return RMS_M_S * np.sqrt(2 / len(HARMONICS)) * total


def driving_displacement(frame: Array) -> Array:
    """Return how far a driving robot has moved along its reference, without a step.

    Args:
        frame: Frame numbers, (..., m, 1).

    Returns:
        Displacements in x, y and heading since frame 0, (..., m, 3) m and rad.
    """
    time, ramp_s = PERIOD_S * np.maximum(frame, 0), SPEED_M_S / ACCELERATION_M_S2
    forward = SPEED_M_S * (
        np.minimum(time, ramp_s) ** 2 / (2 * ramp_s) + np.maximum(time - ramp_s, 0)
    )
    rate = 2 * math.pi / (PERIOD_S * WEAVE_FRAMES)
    weave = WEAVE_M_S / rate * (1 - np.cos(rate * time))
    return np.array([1.0, 0.0, 0.0]) * forward + np.array([1.0, 1.0, 0.0]) * weave


@dataclass(frozen=True)
class SteppedReference:
    """A reference whose poses step while its twists do not; see `omni_control.reference.Reference`.

    A preview does not show the step in advance.

    Attributes:
        is_driving: Whether each row's robot drives forward, (n, 1).
        offset: Size of the step in x, y and heading, (n, 3); changed in place when the step occurs.
        rows: Indices of the rows that the reference is for.
    """

    is_driving: np.ndarray
    offset: Array
    rows: np.ndarray

    def __deepcopy__(self, memo: object) -> Self:
        """Return the reference itself, so that the step occurs in copies of a controller too."""
        return self

    def at(self, frame: float | Array, pose: Array) -> tuple[Array, Array]:
        """Return pose and twist at a frame."""
        poses, twists = self.preview(frame, pose, 1)
        return poses[0], twists[0]

    def preview(self, frame: float | Array, pose: Array, count: int) -> tuple[Array, Array]:
        """Return the poses and twists of `count` frames from a frame on."""
        frames = np.reshape(frame, (-1, 1)) + np.arange(float(count))[:, None, None]
        is_driving = self.is_driving[self.rows]
        poses = is_driving * driving_displacement(frames)
        next_poses = is_driving * driving_displacement(frames + 1)
        return poses + self.offset[self.rows], (next_poses - poses) / PERIOD_S


class LoopExperiment:
    """Simulation with a row for each controller, case, seed and sign, in this order.

    The disturbance is added to the command that is sent, after filter, controller and limits. The
    team does not know it, and stores its own command as the sent one. So filter, controller and
    prediction belong to the controller C of the loop gain, and the robot with its dead time is the
    plant P.

    Args:
        scenario: Controllers, seeds, robot, plant, and all settings except the reference.

    Attributes:
        simulation: Simulation of all rows.
        disturbance: Added to the command along each row's axis, (TOTAL_FRAMES, n) m/s.
    """

    def __init__(self, scenario: Scenario) -> None:
        self._scenario = scenario
        settings = scenario.settings.replace(
            reference=resting_reference(TOTAL_FRAMES), world={"start_poses": [[0, 0, 0]]}
        )
        self._grid_shape = len(scenario.labels), len(CASES), scenario.seeds, 2
        grid = list(itertools.product(scenario.labels, CASES, scenario.seed_list, (1, -1)))
        runs = [(label, seed, settings) for label, _, seed, _ in grid]
        rows = build_single_robot_rows(runs, scenario.robot)
        _, cases, seeds, signs = zip(*grid, strict=True)
        # Case, a key of `CASES`, and sign, 1 or -1, of each row
        self._row_labels = {"case": np.array(cases), "sign": np.array(signs)}
        is_driving, axes = zip(*(CASES[case] for case in cases), strict=True)
        self._reference = SteppedReference(
            np.array(is_driving)[:, None], np.zeros((len(rows), 3)), np.arange(len(rows))
        )
        self._row_axes = np.arange(len(rows)), np.array(axes)  # index of each row's axis
        self.simulation = Simulation(
            scenario, rows=rows, build_reference=lambda rows: replace(self._reference, rows=rows)
        )
        self.disturbance = np.zeros((TOTAL_FRAMES, len(rows)))
        self.disturbance[WARM_UP_FRAMES + STEP_FRAMES :] = (
            np.transpose([make_multisine(seed) for seed in seeds]) * signs
        )

    def run(self, after_frame: AfterFrame) -> Outcome:
        """Run the experiment; `after_frame` is called with each frame's number."""
        commands = self._disturbed_commands()
        outcome = run_open_loop(self._scenario, self.simulation, commands, after_frame)
        return replace(outcome, metrics=self._row_labels)

    def _disturbed_commands(self) -> Iterator[Array]:
        """Yield the commands of each frame, with the disturbance, (n, 3)."""
        team = self.simulation.team
        for frame, disturbance in enumerate(self.disturbance):
            if frame == WARM_UP_FRAMES:
                self._reference.offset[self._row_axes] = STEP_M * self._row_labels["sign"]
            self.simulation.observe()
            desired = team.command()
            disturbed = desired.copy()
            disturbed[self._row_axes] += disturbance
            # The disturbance is part of the last command while the frame is sent, so that the
            # slew-rate limit does not reduce it.
            team.last_command = disturbed
            yield disturbed
            team.last_command = desired

    def paired_responses(self) -> tuple[Array, Array, Array]:
        """Return the responses of position, command and disturbance along each row's axis.

        A response is half the difference of a pair of rows, in m or m/s, with the shape
        (TOTAL_FRAMES, controllers, cases, seeds).
        """
        log = self.simulation.log
        position, sent = (log.channel(name)[:, *self._row_axes] for name in ("pose", "command"))
        added = self.disturbance[: len(sent)]
        grid = np.stack([position, sent - added, added]).reshape(3, -1, *self._grid_shape)
        position, command, disturbance = (grid[..., 0] - grid[..., 1]) / 2
        return position, command, disturbance
