"""What was found of each controller's loop in each case, as data and as a table."""

from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from omni_control.kinematics import Array
from omni_mj.measure.statistics import plain
from omni_mj.measure.table import DASH, Table
from omni_mj.measure.table import text as aligned
from omni_mj.studies.loop.drive import STEP, STEP_M, STRENGTHS, SWING_IN, WARM_UP, Drive
from omni_mj.studies.loop.excitation import FREQUENCIES, RMS_M_S
from omni_mj.studies.loop.motion import SPEED_M_S, WEAVE_M_S
from omni_mj.studies.loop.step import Step, measure
from omni_mj.studies.loop.transfer import Gains, Margins, differs, loop_gain, margins

DEFINITIONS = {
    "rest, driving": f"the robot stands; or drives at {SPEED_M_S:g} m/s, weaving by {WEAVE_M_S:g} m/s forward and left",
    "forward, sideways, along, across": "the direction in which it is stepped and disturbed; it looks and drives ahead",
    "step": "the reference's poses jump, unannounced, its velocities do not; the answer is what robots do besides the"
    " same drive without a jump, by half the difference of two that jump to opposite sides under the same noise",
    "rise": "time from a tenth to nine tenths of the step",
    "overshoot": "largest way beyond the step, share of it",
    "within_5_mm, within_2_percent": "time from which on the error stays as small, s",
    "left": "error in the last half second of three, m",
    "gain": "L = -u / (u + d) by Fourier transform: u what the team commands, d what is added on the way to the radio,"
    " unknown to the team; likewise by half the difference of two rows",
    "crossover": "lowest frequency at which abs(L) falls through one, rad/s",
    "phase": "180 degrees + phase of L there, the least",
    "delay": "phase margin over frequency, the least: what the dead time may be longer, s",
    "gain_margin": "1 / abs(L) where the phase is -180 degrees and abs(L) < 1, the least",
    "sensitivity": "Ms, largest abs(1 / (1 + L)) from the lowest frequency measured to the highest",
    "differs": "root mean square, over the frequencies, of the relative change of 1 + L at half the strength",
}
_HEADINGS = [
    "", "", "rise, ms", "overshoot, %", "5 mm, s", "2 %, s", "left, mm",
    "w, rad/s", "phase, °", "delay, ms", "gain", "Ms", "differs, %",
]  # fmt: skip
# Of a step and of a loop: field, factor, digits.
_OF_STEP = (
    ("rise", 1e3, 0), ("overshoot", 1e2, 0), ("within_5_mm", 1, 2), ("within_2_percent", 1, 2), ("left", 1e3, 1)
)  # fmt: skip
_OF_LOOP = (("crossover", 1, 1), ("phase", 1, 0), ("delay", 1e3, 0), ("gain", 1, 2), ("sensitivity", 1, 2))


@dataclass(frozen=True)
class Loop:
    """One controller in one case, at each strength.

    Attributes:
        gains: L at `FREQUENCIES`, complex, (strengths, tones).
        moved: answer to the step, (frames, strengths) m.
    """

    gains: Gains
    moved: Array

    def margins(self, strength: int = -1) -> Margins:
        """Of the strongest, or of another."""
        return margins(self.gains[strength])

    def step(self, strength: int = -1) -> Step:
        """Of the strongest, or of another."""
        return measure(self.moved[:, strength], STEP_M * STRENGTHS[strength])

    @property
    def differs(self) -> float:
        """By how much the weakest loop does from the strongest; see `transfer.differs`."""
        return differs(self.gains[-1], self.gains[0])

    def report(self) -> dict[str, Any]:
        """In plain values, None for what there is none of."""
        return {
            "strengths": [self._at(i) for i in range(len(STRENGTHS))],
            "differs": plain(self.differs),
        }

    def _at(self, strength: int) -> dict[str, Any]:
        gain = self.gains[strength]
        return {
            "rms_m_s": RMS_M_S * STRENGTHS[strength],
            "step_m": STEP_M * STRENGTHS[strength],
            "step": {name: plain(value) for name, value in asdict(self.step(strength)).items()},
            "margins": {name: plain(value) for name, value in asdict(self.margins(strength)).items()},
            "gain": [plain(size) for size in np.abs(gain)],
            "phase_deg": [plain(angle) for angle in np.degrees(np.angle(gain))],
        }


@dataclass(frozen=True)
class Findings:
    """All of them.

    Attributes:
        title: what was measured.
        loops: case -> controller -> what was found.
    """

    title: str
    loops: Mapping[str, Mapping[str, Loop]]

    @classmethod
    def of(cls, title: str, drive: Drive, labels: tuple[str, ...], cases: tuple[str, ...]) -> "Findings":
        """From a drive that has come to its end."""
        sines, jump = slice(WARM_UP + STEP + SWING_IN, None), slice(WARM_UP, WARM_UP + STEP)
        wanted, added = drive.command()[sines], drive.disturbed()[sines]
        moved = drive.position()
        moved = (moved[jump] - moved[WARM_UP]).mean(3)

        def gains(i: int, j: int) -> Gains:
            each = [loop_gain(wanted[:, i, j, :, k], added[:, i, j, :, k]) for k in range(len(STRENGTHS))]
            return np.array(each)

        return cls(
            title,
            {
                case: {label: Loop(gains(i, j), moved[:, i, j]) for i, label in enumerate(labels)}
                for j, case in enumerate(cases)
            },
        )

    def figures(self) -> dict[str, Array]:
        """Each figure of step and margins by its name, (controllers, cases, strengths)."""
        each = [
            [[asdict(loop.step(k)) | asdict(loop.margins(k)) for k in range(len(STRENGTHS))] for loop in loops.values()]
            for loops in self.loops.values()
        ]
        names = each[0][0][0]
        return {
            name: np.array([[[at[name] for at in loop] for loop in case] for case in each]).swapaxes(0, 1)
            for name in names
        }

    def report(self) -> dict[str, Any]:
        """In plain values."""
        return {
            "definitions": DEFINITIONS,
            "frequencies_rad_s": FREQUENCIES.round(6).tolist(),
            "cases": {
                case: {label: loop.report() for label, loop in loops.items()} for case, loops in self.loops.items()
            },
        }

    def text(self) -> str:
        """The figures at the greatest strength as a table of plain text."""
        return aligned(Table(self.title, _HEADINGS, list(self._lines()), 2))

    def _lines(self) -> Iterator[list[str]]:
        for case, loops in self.loops.items():
            for i, (label, loop) in enumerate(loops.items()):
                step, loop_margins = loop.step(), loop.margins()
                cells = [_cell(getattr(step, name), *how) for name, *how in _OF_STEP]
                cells += [_cell(getattr(loop_margins, name), *how) for name, *how in _OF_LOOP]
                yield ["" if i else case, label, *cells, _cell(loop.differs, 100, 0)]


def _cell(value: float, factor: float, digits: int) -> str:
    return DASH if np.isnan(value) else f"{round(factor * value, digits) + 0.0:.{digits}f}"  # never -0
