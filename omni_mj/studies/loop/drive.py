"""The simulation: all controllers in all cases side by side, first told to jump aside, then disturbed by sines.

Rows come in pairs that are asked the opposite, under the same noise. Half of what they do differently answers to what
they were asked: vision's noise, the weave and the ripple of rollers are in both alike, and fall out.
"""

import itertools
from collections.abc import Mapping

import numpy as np

from omni_control.kinematics import Array
from omni_mj.scenarios.rows import Row
from omni_mj.scenarios.scenario import Scenario
from omni_mj.scenarios.settings import FRAME_RATE_HZ, PERIOD_S
from omni_mj.simulate.simulation import Simulation
from omni_mj.studies.loop.motion import PERIOD_FRAMES, PERIODS, Case, Motion, multisine
from omni_mj.studies.outcome import AfterFrame

STRENGTHS, SIGNS = (1, 2), (1, -1)  # of what rows are asked; half as much should give half as much
STEP_M = 0.025  # at a strength of one: 5 cm at the other, half the range of the fuzzy controller's input
WARM_UP, STEP, SWING_IN, MEASURED = 3 * FRAME_RATE_HZ, 3 * FRAME_RATE_HZ, PERIOD_FRAMES, PERIODS * PERIOD_FRAMES
FRAMES = WARM_UP + STEP + SWING_IN + MEASURED


class Drive:
    """Rows for each controller, case, seed, strength and sign, in this order of a grid.

    The loop is opened where commands are sent, behind filter, controller and limits. What the sines add there nobody
    on the team knows: what it remembers as sent is what it commanded, so that the gain around the loop counts a
    controller's own prediction as part of the controller, and the robot with its dead time as what it controls.

    Args:
        scenario: controllers, seeds, robot, plant, and all settings but the reference.
        cases: in which they are measured.

    Attributes:
        simulation: of all rows.
        shape: of the grid.
        asked: case, strength and sign of each row, by these names, (n,).
        disturbance: what is added to commands along each row's axis, (FRAMES, n) m/s.
    """

    def __init__(self, scenario: Scenario, cases: Mapping[str, Case]) -> None:
        rest = {"shape": "waypoints", "waypoints": [[0, 0], [0, 0]], "mode": "timed", "settle_s": FRAMES * PERIOD_S}
        settings = scenario.settings.replace(reference=rest, world={"places": [[0, 0, 0]]})
        self.shape = len(scenario.labels), len(cases), scenario.seeds, len(STRENGTHS), len(SIGNS)
        grid = list(itertools.product(scenario.labels, cases, scenario.seed_list, STRENGTHS, SIGNS))
        rows = [Row(i, 0, label, seed, settings, scenario.robot) for i, (label, _, seed, _, _) in enumerate(grid)]
        _, names, _, strengths, signs = zip(*grid, strict=True)
        self.asked = {"case": np.array(names), "strength": np.array(strengths), "sign": np.array(signs)}
        self._motion = Motion.of_cases([cases[name] for name in names])
        self._axis = np.array([cases[name].axis for name in names])
        self.simulation = Simulation(scenario, rows=rows, follow=self._motion.of)
        self.disturbance = np.zeros((FRAMES, len(rows)))
        for i, (_, _, seed, strength, sign) in enumerate(grid):
            sines = multisine(seed, strength, SWING_IN + MEASURED)
            self.disturbance[WARM_UP + STEP :, i] = sign * strength * sines

    def run(self, after_frame: AfterFrame) -> None:
        """Drive; `after_frame` is called with each frame's number, and may raise `StoppedError`."""
        simulation, team, rows = self.simulation, self.simulation.team, np.arange(len(self._axis))
        for frame, disturbance in enumerate(self.disturbance):
            if frame == WARM_UP:
                self._motion.jump[rows, self._axis] = STEP_M * self.asked["strength"] * self.asked["sign"]
            simulation.observe()
            wanted = team.command()
            sent = wanted.copy()
            sent[rows, self._axis] += disturbance
            team.sent(sent)  # as if in the frame before, so that the limit on changes lets the disturbance through
            simulation.step(sent)
            team.sent(wanted)
            after_frame(frame)

    def position(self) -> Array:
        """Return where robots were along the axis asked, half the difference of each pair, m; see `_answers`."""
        return self._answers(self._along("pose"))

    def command(self) -> Array:
        """Return what the team commanded along it, likewise, m/s."""
        return self._answers(self._along("command") - self.disturbance)

    def disturbed(self) -> Array:
        """Return what was added to that, likewise, m/s."""
        return self._answers(self.disturbance)

    def _along(self, channel: str) -> Array:
        return np.asarray(self.simulation.log.channel(channel)[:, np.arange(len(self._axis)), self._axis])

    def _answers(self, values: Array) -> Array:
        """Return half the difference of each pair, (FRAMES, controllers, cases, seeds, strengths), of (FRAMES, n)."""
        grid = values.reshape(len(values), *self.shape)
        return (grid[..., 0] - grid[..., 1]) / 2
