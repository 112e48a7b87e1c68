"""What is measured block by block: the numbers of the whole, however it is cut, and no more memory than a block's."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from logs import failure, filled, rows

from omni_mj.measure import metrics
from omni_mj.measure.metrics import Tally
from omni_mj.measure.running import Percentile
from omni_mj.measure.way import Way
from omni_mj.scenarios.settings import Settings
from omni_mj.simulate.log import Log

FRAMES = 150
FAULTS = (
    {"kind": "push", "at": 0.2, "for": 0.1, "force_n": 10.0},
    {"kind": "tilt", "at": 0.5, "angle_deg": 2.0},
    {"kind": "tilt", "at": 9.0, "angle_deg": 2.0},  # to which nobody comes
)


def anything(rng: np.random.Generator, n: int) -> Log:
    """Robots that rest now and then, that meet faults or none, with motors or without; each its own length."""
    own = [Settings(), Settings(fault=FAULTS), Settings(wheels={"creep": "off"}, fault=FAULTS[1:])]
    table = [replace(row, settings=own[rng.integers(3)]) for row in rows(("a",), range(n))]
    moves = rng.random((FRAMES, n, 1)) < rng.choice([0.05, 0.9], (n, 1))
    moves[FRAMES // 2 :] &= rng.random((n, 1)) < 0.5
    ref = np.cumsum(np.where(moves, rng.normal(0, 0.02, (FRAMES, n, 3)), 0.0), axis=0)
    motors = np.where(rng.random((n, 1)) < 0.5, 1.0, np.nan)
    return filled(
        table, FRAMES, rng.integers(0, FRAMES + 1, n), ref=ref, pose=ref + rng.normal(0, 0.012, ref.shape),
        command=rng.normal(0, 1, ref.shape), slip=motors * rng.normal(0, 0.05, (FRAMES, n, 4)),
        duty_peak=motors * np.minimum(1, rng.normal(0.9, 0.1, (FRAMES, n, 1))),
        current_limited=motors * (rng.random((FRAMES, n, 4)) < 0.1), voltage_peak=motors * rng.random((FRAMES, n, 1)),
    )  # fmt: skip


def tally(log: Log, table: list[int]) -> Tally:
    """Of some rows of a log, at the start."""
    ways = [Way(log.channel("ref")[: log.lengths[row], row]) for row in table]
    return Tally([log.rows[row] for row in table], ways)


@settings(deadline=None, derandomize=True, max_examples=30)
@given(st.integers(0, 2**32 - 1), st.integers(1, 4), st.lists(st.integers(0, FRAMES), max_size=6))
def test_however_frames_are_cut_the_numbers_are_those_of_the_whole(seed: int, n: int, cuts: list[int]) -> None:
    """To the bit, since sums are made frame by frame. References may be known to go on after a robot has failed."""
    rng = np.random.default_rng(seed)
    log = anything(rng, n)
    failed = [failure(log, int(row)) for row in np.flatnonzero(rng.random(n) < 0.3)]
    found = tally(log, list(range(n)))
    edges = [0, *sorted(cuts), FRAMES]
    for first, stop in pairwise(edges):
        found.add(log.part(first, stop))
    whole = metrics.row_metrics(log, failed)
    for name, values in found.row_metrics(failed).items():
        np.testing.assert_array_equal(values, whole[name], err_msg=name)
    assert list(found.row_metrics(failed)) == list(whole)  # asked again it says the same


def test_a_log_that_is_emptied_now_and_then_holds_the_frames_since() -> None:
    """A row that ended before has none of them, whatever was there before it was emptied."""
    log = filled(rows(("a", "b")), 30, [30, 12], pose=1.0)
    log.clear()
    assert (log.length, log.lengths.tolist()) == (0, [0, 0])
    values = {name: np.full((2, len(titles)), 2.0) for name, titles in log.columns.items()}
    for _ in range(5):
        log.write(np.array([True, False]), {}, **values)
    assert (log.length, log.lengths.tolist()) == (5, [5, 0])
    np.testing.assert_array_equal(log.channel("pose"), np.broadcast_to([[2.0] * 3, [np.nan] * 3], (5, 2, 3)))
    assert not log.channel("vision_valid")[:, 1].any()


@pytest.mark.parametrize("frames", [1, 2, 99, 100, 101, 1500, 4000])
def test_the_percentile_is_numpys_and_needs_one_per_cent_of_the_values(frames: int) -> None:
    """Values that come in order are the worst to be kept; rows that end before, or have no frame, have their own.

    Twice as many as matter, and a block, are held at most. Between two values both interpolate, and round otherwise.
    """
    rng = np.random.default_rng(frames)
    values = np.sort(rng.exponential(size=(frames, 4)), axis=0)
    values[:, 1], values[frames // 3 :, 2], values[:, 3] = values[::-1, 1], np.nan, np.nan
    found, block, most = Percentile(4, frames), 64, 0
    for first in range(0, frames, block):
        found.add(values[first : first + block])
        most = max(most, found.kept)
    known = [values[~np.isnan(values[:, row]), row] for row in range(4)]
    wanted = [np.percentile(each, 99) if each.size else np.nan for each in known]
    np.testing.assert_allclose(found.value, wanted, rtol=1e-14)
    assert most <= 2 * (0.01 * frames + 2) + block
