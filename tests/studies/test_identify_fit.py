"""Identification of robots whose law is known: truth within the errors that are stated, and what cannot be told."""

from functools import cache

import numpy as np
import pytest
from synthetic import logs

from omni_mj.studies.identify import axes, law
from omni_mj.studies.identify.findings import estimates
from omni_mj.studies.identify.fit import Fit, fit
from omni_mj.studies.identify.logs import Log
from omni_mj.studies.identify.predict import predict
from omni_mj.studies.identify.segments import Segments, cut

# Latencies are whole eighths of a line at 30 Hz, so that the steps of the truth hit the changes of commands.
TRUTHS = np.array(
    [
        [12 / 120, 1.10, 1.25, 0.06, 0.12, 0.03, 0.05, 0.04, 0.02],
        [8 / 120, 1.00, 1.05, 0.04, 0.08, 0.05, 0.06, 0.02, -0.03],
        [18 / 120, 1.15, 1.10, 0.09, 0.15, 0.04, 0.03, 0.06, 0.00],
    ]
)
WRONG = np.array([0.11, 1.0, 1.0, 0.02, 0.02, 0.02, 0.02, 0.0, 0.0])


def segments(time: np.ndarray, poses: np.ndarray, command: np.ndarray) -> Segments:
    return cut([Log("log", time, poses, command, False, None)], [command], [False])


@cache
def twenty() -> list[tuple[np.ndarray, Fit]]:
    """Twenty logs of six seconds and what was found, three robots in turn."""
    truths = TRUTHS[np.arange(20) % 3]
    time, poses, commands = logs(truths, 6.4, seed=1)
    return [
        (truth, fit(segments(time, poses[:, i], commands[:, i]), WRONG if i < 3 else truth))
        for i, truth in enumerate(truths)
    ]


def test_errors_are_as_large_as_stated() -> None:
    """Deviations over standard errors have root mean square 1: of 180, within 0.7 and 1.4 with room for their ties.

    Of independent numbers it would be 1 +- 0.05.
    """
    scores = np.array([(found.value - truth) / found.error for truth, found in twenty()])
    assert 0.7 < np.sqrt((scores**2).mean()) < 1.4
    assert (np.abs(scores) < 3.182).mean() > 0.95  # of Student's with four stretches


def test_wrong_starts_lead_to_the_same() -> None:
    for truth, found in twenty()[:3]:
        assert np.abs((found.value - truth) / found.error).max() < 4
        assert not found.at_bound.any()
        assert not found.misfit
        assert found.noise == pytest.approx(0.0013, rel=0.15)


def test_what_the_law_lacks_is_a_misfit() -> None:
    """A swing of 0.05 m/s at 1.1 Hz: 5 mm rms of way, which no parameter can follow; residuals are not white."""
    time, poses, commands = logs(TRUTHS[:1], 9.3, seed=3, push=0.05)
    found = fit(segments(time, poses[:, 0], commands[:, 0]), TRUTHS[0])
    assert found.misfit
    assert found.rms > 1.5 * found.noise


def test_slow_data_do_not_tell_creep() -> None:
    """As of a robot in a laboratory: 0.4 m/s and 0.8 m/s^2. Creep is not told, and it says why."""
    time, poses, commands = logs(TRUTHS[:1], 9.3, seed=4, speed=0.4, pull=0.8)
    cuts = segments(time, poses[:, 0], commands[:, 0])
    told = {e.name: e for e in estimates(fit(cuts, TRUTHS[0]), cuts, "commands")}
    for name in ("creep_forward_s2_m", "creep_sideways_s2_m"):
        assert "it needs 1 m/s and 1.5 m/s^2" in (told[name].why_not or "")
        assert told[name].report()["value"] is None
        assert "--plan" in told[name].would_tell


def test_motion_along_one_axis_tells_nothing_of_the_other() -> None:
    time, poses, commands = logs(TRUTHS[:1] * [1, 1, 1, 1, 1, 1, 1, 1, 0], 8.3, seed=5)
    commands[:, :, 1:] = 0.0
    rate, late = 30.0, TRUTHS[0, 0]
    v = np.zeros(len(time))
    for k in range(1, len(time)):  # a lag alone, exact from line to line
        u = commands[max(k - 1 - round(late * rate), 0), 0, 0]
        v[k] = u + (v[k - 1] - u) * np.exp(-1 / (rate * 0.04))
    poses = np.zeros((len(time), 1, 3))
    poses[:, 0, 0] = np.cumsum(v) / rate
    poses += np.random.default_rng(0).normal(size=poses.shape) * [0.0013, 0.0013, 0.003]
    cuts = segments(time, poses[:, 0], commands[:, 0])
    told = {e.name: e for e in estimates(fit(cuts, WRONG), cuts, "commands")}
    assert told["gain_forward"].told
    for name in ("gain_sideways", "lag_sideways_s", "creep_sideways_s2_m"):
        assert "the robot moves sideways at 0.0" in (told[name].why_not or "")


def test_turning_has_a_gain_and_a_lag_of_its_own() -> None:
    """First order: w' = (u - g w) / tau, exact from step to step of a tenth of a line."""
    rng, rate, late, effort, tau = np.random.default_rng(2), 50.0, 0.06, 1.05, 0.05
    lines, fine = 700, 10
    rates = np.repeat(rng.uniform(-5, 5, lines // 25), 25)
    w, angle, angles = 0.0, 0.0, np.zeros(lines)
    for k in range(lines * fine):
        if k % fine == 0:
            angles[k // fine] = angle
        u = rates[max(int((k / fine / rate - late) * rate + 1e-6), 0)] if k / fine / rate >= late else 0.0
        kept = np.exp(-effort / (rate * fine * tau))
        angle += u / effort / (rate * fine) + tau / effort * (w - u / effort) * (1 - kept)
        w = u / effort + (w - u / effort) * kept
    time, poses, commands = np.arange(lines) / rate, np.zeros((lines, 3)), np.zeros((lines, 3))
    poses[:, 2], commands[:, 2] = angles + 0.005 * rng.normal(size=lines), rates
    found = fit(segments(time, poses, commands), np.array([0.03, 1.0, 0.02]), turning=True)
    assert found.names == law.TURNING
    assert np.abs((found.value - [late, effort, tau]) / found.error).max() < 3.5
    assert found.error[1] < 0.01


def test_what_was_found_predicts_what_was_not_fitted_to() -> None:
    """Of stretches that were held out; what was found at most 8 mm in a second, starts at least twice as much."""
    time, poses, commands = logs(TRUTHS[:1], 9.3, seed=6)
    used, held = segments(time, poses[:, 0], commands[:, 0]).held_out()
    assert len(held) == 1
    assert held.time.min() > used.time.max()
    found = fit(used, WRONG)
    result = predict(held, WRONG, found.value)
    assert result.identified < 0.008
    assert result.start > 2 * result.identified


def test_a_first_look_finds_delay_and_axes() -> None:
    time, poses, commands = logs(TRUTHS[:1], 9.3, seed=7)
    log = Log("log", time, poses[:, 0], commands[:, 0], False, None)
    seen = axes.look(log, commands[:, 0], False, "commands")
    assert TRUTHS[0, 0] < seen.delay < TRUTHS[0, 0] + 0.15  # latency, lag, and creep
    assert seen.follows > 0.8
    assert seen.turning == pytest.approx(1.0, abs=0.05)
