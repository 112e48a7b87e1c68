"""Test the loop study against python-control, for loops that are known in closed form."""

import copy
from collections.abc import Callable, Iterator

import numpy as np
import pytest
from benches.studies import (
    FREQUENCIES,
    STEP_FRAMES,
    STEP_M,
    WARM_UP_FRAMES,
    LoopExperiment,
    LoopResult,
    StoppedError,
    compute_margins,
    compute_step_metrics,
    loop_experiment,
    measure_loop,
)
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

import control
import omni_mj as om
from omni_control.controllers.base import TeamModel
from omni_control.controllers.baselines import Proportional
from omni_control.reference import Reference, SampledReference

T, DELAY = 1 / 60, 6
# Equation 7 without uncertainty: no noise, alpha 1, no limits
IDEAL = {
    "vision": {"position_noise_m": 0.0, "heading_noise_rad": 0.0, "miss_probability": 0.0},
    "kinematic": {"alpha_low": 1.0, "alpha_high": 1.0},
    "control": {"max_acceleration_m_s2": 1000.0},
}
# K by the rules that the controllers state: SIMC for a latency of 7 frames, and of one; the fuzzy
# law's at zero error.
GAINS = {"p": 30 / 7, "smith": 30.0, "comp-flc": 15.0}
REST, DRIVING = "rest, forward", "driving, sideways"


def proportional(gain: float, delay: int = DELAY) -> control.TransferFunction:
    """Return the loop K T z^-d / (z - 1): an integrator with zero-order hold and dead time d."""
    return control.tf([gain * T], np.r_[1, -1, np.zeros(delay)], T)


def predicting(gain: float, delay: int = DELAY) -> control.TransferFunction:
    """Return it with an exact predictor: K G z^-d / (1 + K G (1 - z^-d)), G = T / (z - 1)."""
    denominator = np.zeros(delay + 2)
    denominator[:2] = 1, gain * T - 1
    denominator[-1] -= gain * T
    return control.tf([gain * T], denominator, T)


EXACT = {
    "p": proportional(GAINS["p"]),
    "smith": predicting(GAINS["smith"]),
    "comp-flc": predicting(GAINS["comp-flc"]),
}


def gains(system: control.TransferFunction) -> NDArray[np.complex128]:
    return np.asarray(system(np.exp(1j * FREQUENCIES * T)))


def ideal(**sections: dict[str, object]) -> om.Scenario:
    return om.load_scenario("rect", plant="kinematic", **(IDEAL | sections))


def stop_at(last_frame: int) -> Callable[[int], None]:
    def after_frame(frame: int) -> None:
        if frame == last_frame:
            raise StoppedError("interrupted")

    return after_frame


def keep_cases(patched: pytest.MonkeyPatch, *names: str) -> None:
    for name in set(loop_experiment.CASES) - set(names):
        patched.delitem(loop_experiment.CASES, name)


@pytest.fixture(scope="module")
def small() -> Iterator[LoopResult]:
    """Measure with a disturbance so small that the fuzzy controller is linear."""
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(loop_experiment, "RMS_M_S", 0.001)
        keep_cases(patched, REST, DRIVING)
        yield measure_loop(ideal(), list(GAINS))


@given(gain=st.floats(1.6, 15), delay=st.integers(4, 9), predicts=st.booleans())
@settings(max_examples=25)
@pytest.mark.filterwarnings(
    "ignore:(divide by zero|invalid value):RuntimeWarning"
)  # of an integrator at zero
def test_margins_agree_with_python_control(gain: float, delay: int, predicts: bool) -> None:
    """Margins are interpolated; a phase crossing above the highest frequency is not measured."""
    if not predicts:
        gain = min(gain, 0.9 / (T * (2 * delay + 1)))  # of pi/2, the limit of stability
    system = (predicting if predicts else proportional)(gain, delay)
    gain_margin, phase, distance, phase_crossover, crossover, _ = control.stability_margins(system)
    measured = compute_margins(gains(system))
    if FREQUENCIES[0] < crossover:
        assert measured.crossover_rad_s == pytest.approx(crossover, rel=0.005)
        assert measured.phase_deg == pytest.approx(phase, abs=0.1)
        assert measured.delay_s == pytest.approx(np.radians(phase) / crossover, rel=0.005)
    if phase_crossover < FREQUENCIES[-1]:
        assert measured.gain == pytest.approx(gain_margin, rel=0.015)
    assert measured.sensitivity == pytest.approx(1 / distance, rel=0.015)


@pytest.mark.parametrize("name", GAINS)
def test_measured_loops_have_the_closed_form(small: LoopResult, name: str) -> None:
    """Within the vision filter's gain of 0.99 and the curvature of the fuzzy controller.

    comp-flc is measured at rest only, because its estimate of alpha is a loop of its own.
    """
    for case in (REST,) if name == "comp-flc" else (REST, DRIVING):
        measured = small.loops[case][name]
        np.testing.assert_allclose(
            measured.gains, gains(EXACT[name]), rtol=0.02 if name == "comp-flc" else 0.01
        )
        gain_margin, phase, distance, *_ = control.stability_margins(EXACT[name])
        assert measured.margins.phase_deg == pytest.approx(phase, abs=1)
        assert measured.margins.gain == pytest.approx(gain_margin, rel=0.04)
        assert measured.margins.sensitivity == pytest.approx(1 / distance, rel=0.03)


def test_p_has_the_margins_of_its_tuning_rule(small: LoopResult) -> None:
    """Phase margin 90 degrees - 0.5 rad and gain margin pi; the rule adds half a frame of delay."""
    measured = small.loops[REST]["p"].margins
    assert measured.phase_deg - np.degrees(measured.crossover_rad_s * T / 2) == pytest.approx(
        90 - np.degrees(0.5), abs=0.2
    )
    assert measured.gain * 6.5 / 7 == pytest.approx(np.pi, rel=0.01)


def test_step_responses_are_those_of_the_closed_loop(small: LoopResult) -> None:
    """Compare frame by frame, without limits and without noise."""
    for name in ("p", "smith"):
        _, expected = control.step_response(
            control.feedback(EXACT[name]), T * np.arange(STEP_FRAMES)
        )
        for case in (REST, DRIVING):
            response = small.loops[case][name].step_response
            np.testing.assert_allclose(response / STEP_M, expected, atol=1e-6)


@given(damping=st.floats(0.3, 0.9), rate=st.floats(3, 12))
@settings(max_examples=10)
def test_step_metrics_agree_with_python_control(damping: float, rate: float) -> None:
    """Times agree within a frame."""
    system = control.tf([rate**2], [1, 2 * damping * rate, rate**2])
    time = T * np.arange(600)
    info, measured = (
        control.step_info(system, T=time),
        compute_step_metrics(0.05 * control.step_response(system, time)[1], 0.05),
    )
    assert measured.rise_time_s == pytest.approx(info["RiseTime"], abs=1.01 * T)
    assert 100 * measured.overshoot == pytest.approx(info["Overshoot"], abs=0.2)
    assert measured.settling_2_percent_s == pytest.approx(info["SettlingTime"], abs=1.01 * T)
    assert measured.settling_5_mm_s <= measured.settling_2_percent_s
    assert measured.steady_state_error_m == pytest.approx(0, abs=1e-5)


def test_delay_margin_is_the_dead_time_that_destabilizes(small: LoopResult) -> None:
    """The team does not know the added delay; the error decays below the margin and grows above."""
    frames = small.loops[REST]["p"].margins.delay_s / T
    assert frames == pytest.approx(15.5, abs=0.1)
    for added, decays in ((int(frames), True), (int(frames) + 1, False)):
        delayed = ideal(
            radio={"delay_frames": DELAY + added},
            control={**IDEAL["control"], "delay_error_frames": -added},
        )
        experiment = LoopExperiment(delayed.replace(controllers=("p",)))
        experiment.disturbance[:] = 0
        outcome = experiment.run(stop_at(WARM_UP_FRAMES + 600))
        assert outcome.entry["reason"] == "interrupted"
        error = np.abs(experiment.paired_responses()[0][WARM_UP_FRAMES:, 0, 0, 0] - STEP_M)
        assert (error[400:].max() < error[200:400].max()) == decays


def test_summary_and_table_agree(small: LoopResult) -> None:
    summary = small.summary()
    assert summary["complete"]
    assert len(small.rows().to_pylist()) == len(GAINS) * 2 * 2
    margins_of_p = summary["loop"]["cases"][REST]["p"]["margins"]
    _, line = (line for line in small.table().splitlines() if line.startswith(REST))
    assert line.split()[2] == "p"
    assert f"{margins_of_p['phase_deg']:.0f}" in line.split()


def test_vision_noise_cancels_and_a_failing_controller_affects_no_other() -> None:
    """The response of p is within 0.1 mm of the closed form with vision noise of 1.3 mm."""

    class Raises(om.Controller):
        def command(self, frame: int, observation: om.Observation) -> NDArray[np.float64]:
            if frame == WARM_UP_FRAMES + 30:
                raise RuntimeError("out of ideas")
            return np.zeros((len(self.predicted_pose), 3))

    result = measure_loop(ideal(vision={"miss_probability": 0.02}), ["p", Raises])
    loops = result.loops[REST]
    _, expected = control.step_response(control.feedback(EXACT["p"]), T * np.arange(STEP_FRAMES))
    np.testing.assert_allclose(loops["p"].step_response, STEP_M * expected, atol=1e-4)
    assert {failure.controller for failure in result.failures} == {"Raises"}
    reported = result.summary()["loop"]["cases"][REST]["Raises"]
    assert set(reported["margins"].values()) == set(reported["step"].values()) == {None}


def test_a_users_controller_that_copies_its_reference_sees_the_step(
    small: LoopResult, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A subclass of p has the response of p, whatever it does to its reference beforehand."""

    class Mine(Proportional):
        def __init__(self, model: TeamModel, reference: Reference, n: int) -> None:
            super().__init__(model, copy.deepcopy(copy.copy(reference)), n)

    keep_cases(monkeypatch, REST)
    loop = measure_loop(ideal(), [Mine]).loops[REST]["Mine"]
    np.testing.assert_allclose(loop.step_response, small.loops[REST]["p"].step_response, atol=1e-9)


def test_no_step_response_is_shown_of_a_controller_that_read_its_reference_before(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Its margins are those of p, because the disturbance is not part of the reference."""

    class Table(Proportional):
        def __init__(self, model: TeamModel, reference: Reference, n: int) -> None:
            frames, count = np.zeros(n), loop_experiment.TOTAL_FRAMES + 100
            poses, _ = reference.preview(frames, np.zeros((n, 3)), count)
            super().__init__(model, SampledReference(poses, T), n)

    keep_cases(monkeypatch, REST)
    result = measure_loop(ideal(), [Table, "p"])
    loop, expected = (result.loops[REST][label] for label in ("Table", "p"))
    assert np.isnan([*loop.step_metrics]).all()
    assert loop.margins == pytest.approx(expected.margins, rel=1e-6, nan_ok=True)
    assert "note: Table did not respond to the step" in result.table()
    assert "note: p" not in result.table()


def test_stopped_loop_study_has_no_result_and_unknown_controller_is_rejected() -> None:
    stopped = measure_loop(ideal(), ["p"], start_progress=lambda title, frames: stop_at(3))
    assert (stopped.loops, stopped.stopped, stopped.table()) == ({}, "interrupted", "")
    assert stopped.summary()["loop"] is None
    with pytest.raises(om.OmniError, match="unknown controller 'pp'"):
        measure_loop(ideal(), ["pp"])
