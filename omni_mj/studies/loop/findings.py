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
from omni_mj.studies.loop.motion import FREQUENCIES, RMS_M_S, SPEED_M_S, WEAVE_M_S
from omni_mj.studies.loop.response import Gains, Margins, Step, differs, loop_gain, margins, measure

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
# Figure -> its heading, factor, digits.
COLUMNS = {
    "rise": ("rise, ms", 1e3, 0), "overshoot": ("overshoot, %", 1e2, 0), "within_5_mm": ("5 mm, s", 1, 2),
    "within_2_percent": ("2 %, s", 1, 2), "left": ("left, mm", 1e3, 1), "crossover": ("w, rad/s", 1, 1),
    "phase": ("phase, °", 1, 0), "delay": ("delay, ms", 1e3, 0), "gain": ("gain", 1, 2), "sensitivity": ("Ms", 1, 2),
}  # fmt: skip


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
        """Return those of the strongest, or of another."""
        return margins(self.gains[strength])

    def step(self, strength: int = -1) -> Step:
        """Return that of the strongest, or of another."""
        return measure(self.moved[:, strength], STEP_M * STRENGTHS[strength])

    @property
    def differs(self) -> float:
        """By how much the weakest loop does from the strongest; see `response.differs`."""
        return differs(self.gains[-1], self.gains[0])

    def report(self) -> dict[str, Any]:
        """Return all in plain values, None for what there is none of."""
        strengths = [
            {
                "rms_m_s": RMS_M_S * strength,
                "step_m": STEP_M * strength,
                "step": _plain(asdict(self.step(i))),
                "margins": _plain(asdict(self.margins(i))),
                "gain": [plain(size) for size in np.abs(self.gains[i])],
                "phase_deg": [plain(angle) for angle in np.degrees(np.angle(self.gains[i]))],
            }
            for i, strength in enumerate(STRENGTHS)
        ]
        return {"strengths": strengths, "differs": plain(self.differs)}


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
        """Return those of a drive that has come to its end."""
        sines, jump = slice(WARM_UP + STEP + SWING_IN, None), slice(WARM_UP, WARM_UP + STEP)
        wanted, added, moved = drive.command()[sines], drive.disturbed()[sines], drive.position()
        moved = (moved[jump] - moved[WARM_UP]).mean(3)

        def loop(i: int, j: int) -> Loop:
            both = ((wanted[:, i, j, :, k], added[:, i, j, :, k]) for k in range(len(STRENGTHS)))
            return Loop(np.array([loop_gain(*each) for each in both]), moved[:, i, j])

        return cls(title, {case: {label: loop(i, j) for i, label in enumerate(labels)} for j, case in enumerate(cases)})

    def report(self) -> dict[str, Any]:
        """Return all in plain values."""
        cases = {case: {label: loop.report() for label, loop in loops.items()} for case, loops in self.loops.items()}
        return {"definitions": DEFINITIONS, "frequencies_rad_s": FREQUENCIES.round(6).tolist(), "cases": cases}

    def text(self) -> str:
        """Return the figures at the greatest strength as a table of plain text."""
        headings = ["", "", *(heading for heading, _, _ in COLUMNS.values()), "differs, %"]
        return aligned(Table(self.title, headings, list(self._lines()), 2))

    def _lines(self) -> Iterator[list[str]]:
        for case, loops in self.loops.items():
            for i, (label, loop) in enumerate(loops.items()):
                figures = asdict(loop.step()) | asdict(loop.margins())
                cells = [_cell(figures[name], factor, digits) for name, (_, factor, digits) in COLUMNS.items()]
                yield ["" if i else case, label, *cells, _cell(loop.differs, 100, 0)]


def _plain(figures: Mapping[str, float]) -> dict[str, float | None]:
    return {name: plain(value) for name, value in figures.items()}


def _cell(value: float, factor: float, digits: int) -> str:
    return DASH if np.isnan(value) else f"{round(factor * value, digits) + 0.0:.{digits}f}"  # never -0
