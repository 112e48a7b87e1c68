"""What the tests of figures share: a run made by hand, and its figures drawn."""

from collections.abc import Callable

import numpy as np
from logs import failure, filled, rows
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from omni_mj.measure import metrics, summary
from omni_mj.measure.result import Outcome
from omni_mj.scenarios import scenario
from omni_mj.scenarios.settings import PERIOD_S, ControlSettings
from omni_mj.show import figures, style
from omni_mj.show.figures.first import FirstRows

FRAMES, SPEED, ALPHA = 240, 0.5, 0.8
TURN = 0.02  # rad, by which each controller is turned per cm that it is off


def made(
    controllers: int = 2,
    n_seeds: int = 3,
    frames: int = FRAMES,
    heat: bool = True,
    failed: dict[int, int] | None = None,
    estimate: float = 0.9,
) -> Outcome:
    """Robots that drive x, then turn a corner into y; the i-th controller is off by i cm and all achieve 0.8 of it.

    `failed` are rows that stop after so many frames.
    """
    table = rows([f"c{i}" for i in range(controllers)], range(n_seeds))
    off = 0.01 * np.repeat(np.arange(controllers), n_seeds) + 0.001 * np.tile(np.arange(n_seeds), controllers)
    velocity = np.where(np.arange(frames)[:, None] < FRAMES / 2, (SPEED, 0.0), (0.0, SPEED))
    ref = np.zeros((frames, len(table), 3))
    ref[1:, :, :2] = (np.cumsum(velocity, axis=0)[:-1] * PERIOD_S)[:, None]
    pose = ref + np.stack([off, off, 100 * TURN * off], axis=-1)
    command = np.zeros((frames, len(table), 3))
    command[..., :2] = velocity[:, None] / ALPHA
    warm = (25 + 0.1 * np.arange(frames) if heat else np.full(frames, np.nan))[:, None, None]
    ends = [(failed or {}).get(row, frames) for row in range(len(table))]
    log = filled(
        table, frames, ends, ref=ref, pose=pose, command=command, applied=command, alpha_hat=estimate, winding=warm,
        housing=warm,
    )  # fmt: skip
    failures = [failure(log, row) for row in failed or {}]
    chosen = scenario.load("rect", (), {"plant": "kinematic"})
    measured = metrics.row_metrics(log, failures)
    entry = summary.entry(chosen, log, failures, measured, 0.0, None)
    return Outcome(chosen, entry, table, failures, measured, log)


def first(outcome: Outcome) -> FirstRows:
    assert outcome.log
    return FirstRows(outcome.log, outcome.failures)


def drawings(outcome: Outcome) -> dict[str, Callable[[], Figure]]:
    return figures.drawings(first(outcome), outcome.entry, ControlSettings())


def drawn(draw: Callable[[], Figure]) -> Figure:
    with figures.matplotlib_style.context(style.SHEET):
        return draw()


def curves(axes: Axes, label: str) -> list[np.ndarray]:
    return [np.asarray(line.get_ydata()) for line in axes.get_lines() if line.get_label() == label]
