"""Jitter of the delay: from steps of the command, and from stamps; not from smooth moves, of which it says why."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from omni_mj.studies.identify import jitter
from omni_mj.studies.identify.findings import Estimate
from omni_mj.studies.identify.fit import LATE, Fit
from omni_mj.studies.identify.logs import Log
from omni_mj.studies.identify.residuals import residuals
from omni_mj.studies.identify.segments import cut

RATE, EACH, LATE_S, NOISE_M = 60, 45, 0.1, 0.0013  # EACH: lines from one velocity to the next


def log(ramp: int) -> Log:
    """Commands of another velocity every 3/4 s, within so many lines; what moves does not matter here."""
    goals = np.random.default_rng(1).uniform(-1, 1, (40, 3)) * [1.2, 1.2, 0.0]
    share = np.minimum(np.arange(EACH) / ramp, 1.0)[:, None]
    sent = np.concatenate([a + (b - a) * share for a, b in pairwise(goals)])
    return Log("log", np.arange(len(sent)) / RATE, np.zeros_like(sent), sent, False, None)


def told(ramp: int, spread: float) -> Estimate:
    """Of stretches whose commands are late by LATE_S +- spread (s, one deviation), each by itself, and noise.

    Residuals are what a velocity that is held from another line on moves, less what a first pose and velocity explain.
    """
    rng, one = np.random.default_rng(2), log(ramp)
    assert one.command is not None
    segments = cut([one], [one.command], [False])
    change, delays = np.diff(one.command, axis=0, prepend=0), rng.normal(size=len(one.time)) * spread
    residual, slope = np.zeros((2, *segments.there.shape, 3))
    for s, time in enumerate(segments.time):
        free = np.linalg.qr(np.stack([np.ones_like(time), time - time[0]], 1))[0]

        def way(late: np.ndarray, time: np.ndarray = time, free: np.ndarray = free) -> np.ndarray:
            moved = np.maximum(time[:, None] - one.time - late, 0.0) @ change
            return moved - free @ (free.T @ moved)

        exact, none = way(np.full(len(one.time), LATE_S)), np.zeros_like(one.time)
        slope[s] = (way(none + LATE_S + 1e-4) - exact) / 1e-4
        residual[s] = exact - way(LATE_S + delays) + NOISE_M * rng.normal(size=exact.shape)
    white, zeros = residuals(residual, segments.there, 0.0), np.zeros_like(residual)
    names, late = (LATE,), np.array([LATE_S])
    none = np.zeros(1)
    fitted = Fit(names, late, np.eye(1), none, late, 2.0, none, white, white, zeros, 0, none, residual, slope, 1.0)
    return jitter.of_moves(fitted, segments)


@pytest.mark.parametrize("spread", [0.0, 0.015])
def test_steps_tell_jitter(spread: float) -> None:
    """The interval of 95 % holds the truth, and 0 only if it is."""
    found = told(1, spread)
    assert found.told
    assert found.low <= spread <= found.high
    assert (found.low > 0.005) == (spread > 0)


def test_smooth_moves_do_not() -> None:
    """Of a ramp of half a second thirty commands are told as one mean."""
    found = told(30, 0.015)
    assert not found.told
    assert "commands share" in (found.why_not or "")
    assert "received_s" in found.would_tell


def test_stamps_tell_jitter_and_losses() -> None:
    """Within four standard errors, whatever the clock of the receiver shows, and if it runs faster."""
    rng, one = np.random.default_rng(4), log(1)
    received = one.time + 1000 + 1e-3 * one.time + rng.exponential(0.006, len(one.time))
    received[rng.random(len(received)) < 0.05] = np.nan
    found = {e.name: e for e in jitter.of_stamps([replace(one, received=received)])}
    assert abs(found["jitter_s"].value - 0.006) < 4 * found["jitter_s"].error
    assert abs(found["lost"].value - 0.05) < 4 * found["lost"].error
    assert not list(jitter.of_stamps([one]))
