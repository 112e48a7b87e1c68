"""The loop study measures what python-control computes, where a loop is known in closed form."""

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

T, DELAY = 1 / 60, 6
# Equation 7 without doubt: no noise, a robot that does as told, limits out of the way.
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
    """K T z^-d / (z - 1): an integrator that holds its input for a frame and is d frames late."""
    return control.tf([gain * T], np.r_[1, -1, np.zeros(delay)], T)


def predicting(gain: float, delay: int = DELAY) -> control.TransferFunction:
    """The same with a predictor that knows all: K G z^-d / (1 + K G (1 - z^-d)) with G = T / (z - 1)."""
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


def stop_at(last: int) -> Callable[[int], None]:
    def after_frame(frame: int) -> None:
        if frame == last:
            raise StoppedError("interrupted")

    return after_frame


def leave_cases(patched: pytest.MonkeyPatch, *names: str) -> None:
    for name in set(loop_experiment.CASES) - set(names):
        patched.delitem(loop_experiment.CASES, name)


@pytest.fixture(scope="module")
def small() -> Iterator[LoopResult]:
    """Disturbed so little that the fuzzy law is a gain, on the plant of which all is known."""
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(loop_experiment, "RMS_M_S", 0.001)
        leave_cases(patched, REST, DRIVING)
        yield measure_loop(ideal(), list(GAINS))


@given(gain=st.floats(1.6, 15), delay=st.integers(4, 9), predicts=st.booleans())
@settings(max_examples=25)
@pytest.mark.filterwarnings(
    "ignore:(divide by zero|invalid value):RuntimeWarning"
)  # of an integrator at zero
def test_margins_agree_with_python_control(gain: float, delay: int, predicts: bool) -> None:
    """Interpolated between the frequencies measured; where they end, a phase that turns later is not seen."""
    if not predicts:
        gain = min(gain, 0.9 / (T * (2 * delay + 1)))  # of pi/2, where the loop begins to oscillate
    system = (predicting if predicts else proportional)(gain, delay)
    most, phase, distance, at, crossover, _ = control.stability_margins(system)
    found = compute_margins(gains(system))
    if FREQUENCIES[0] < crossover:
        assert found.crossover_rad_s == pytest.approx(crossover, rel=0.005)
        assert found.phase_deg == pytest.approx(phase, abs=0.1)
        assert found.delay_s == pytest.approx(np.radians(phase) / crossover, rel=0.005)
    if at < FREQUENCIES[-1]:
        assert found.gain == pytest.approx(most, rel=0.015)
    assert found.sensitivity == pytest.approx(1 / distance, rel=0.015)


@pytest.mark.parametrize("name", GAINS)
def test_measured_loops_have_the_closed_form(small: LoopResult, name: str) -> None:
    """At each frequency within what the filter of vision, whose gain is 0.99 and not 1, and the fuzzy law's bend leave.

    Driving as at rest; but for comp-flc, which then estimates alpha, and that is a loop of its own.
    """
    for case in (REST,) if name == "comp-flc" else (REST, DRIVING):
        found = small.loops[case][name]
        np.testing.assert_allclose(
            found.gains, gains(EXACT[name]), rtol=0.02 if name == "comp-flc" else 0.01
        )
        most, phase, distance, *_ = control.stability_margins(EXACT[name])
        assert found.margins.phase_deg == pytest.approx(phase, abs=1)
        assert found.margins.gain == pytest.approx(most, rel=0.04)
        assert found.margins.sensitivity == pytest.approx(1 / distance, rel=0.03)


def test_p_has_the_margins_of_its_tuning_rule(small: LoopResult) -> None:
    """Half a radian less than a right angle, and pi, with the half frame that it counts for a dead time badly known."""
    found = small.loops[REST]["p"].margins
    assert found.phase_deg - np.degrees(found.crossover_rad_s * T / 2) == pytest.approx(
        90 - np.degrees(0.5), abs=0.2
    )
    assert found.gain * 6.5 / 7 == pytest.approx(np.pi, rel=0.01)


def test_step_responses_are_those_of_the_closed_loop(small: LoopResult) -> None:
    """By python-control, frame by frame: nothing is limited here, and the filter has nothing to say."""
    for name in ("p", "smith"):
        _, wanted = control.step_response(control.feedback(EXACT[name]), T * np.arange(STEP_FRAMES))
        for case in (REST, DRIVING):
            moved = small.loops[case][name].step_response
            np.testing.assert_allclose(moved / STEP_M, wanted, atol=1e-6)


@given(damping=st.floats(0.3, 0.9), rate=st.floats(3, 12))
@settings(max_examples=10)
def test_step_metrics_agree_with_python_control(damping: float, rate: float) -> None:
    """Times to a frame: it samples, and counts from another one."""
    system = control.tf([rate**2], [1, 2 * damping * rate, rate**2])
    time = T * np.arange(600)
    info, found = (
        control.step_info(system, T=time),
        compute_step_metrics(0.05 * control.step_response(system, time)[1], 0.05),
    )
    assert found.rise_time_s == pytest.approx(info["RiseTime"], abs=1.01 * T)
    assert 100 * found.overshoot == pytest.approx(info["Overshoot"], abs=0.2)
    assert found.settling_2_percent_s == pytest.approx(info["SettlingTime"], abs=1.01 * T)
    assert found.settling_5_mm_s <= found.settling_2_percent_s
    assert found.steady_state_error_m == pytest.approx(0, abs=1e-5)


def test_delay_margin_is_the_dead_time_that_destabilizes(small: LoopResult) -> None:
    """The team is not told of it; after three seconds an error has died out, or grown."""
    frames = small.loops[REST]["p"].margins.delay_s / T
    assert frames == pytest.approx(15.5, abs=0.1)
    for more, dies_out in ((int(frames), True), (int(frames) + 1, False)):
        late = ideal(
            radio={"delay_frames": DELAY + more},
            control={**IDEAL["control"], "delay_error_frames": -more},
        )
        experiment = LoopExperiment(late.replace(controllers=("p",)))
        experiment.disturbance[:] = 0
        assert experiment.run(stop_at(WARM_UP_FRAMES + 600)) == "interrupted"
        error = np.abs(experiment.paired_responses()[0][WARM_UP_FRAMES:, 0, 0, 0] - STEP_M)
        assert (error[400:].max() < error[200:400].max()) == dies_out


def test_summary_and_table_agree(small: LoopResult) -> None:
    summary = small.summary()
    assert summary["complete"]
    assert len(small.rows().to_pylist()) == len(GAINS) * 2 * 2
    margins_of_p = summary["loop"]["cases"][REST]["p"]["margins"]
    line = next(line for line in small.table().splitlines() if line.startswith(REST))
    assert line.split()[2] == "p"
    assert f"{margins_of_p['phase_deg']:.0f}" in line.split()


def test_vision_noise_cancels_and_a_failing_controller_affects_no_other() -> None:
    """What p does of a step is within 0.1 mm of the closed form, where vision errs by 1.3 mm."""

    class Raises(om.Controller):
        def command(self, frame: int, observation: om.Observation) -> NDArray[np.float64]:
            if frame == WARM_UP_FRAMES + 30:
                raise RuntimeError("out of ideas")
            return np.zeros((len(self.predicted_pose), 3))

    result = measure_loop(ideal(vision={"miss_probability": 0.02}), ["p", Raises])
    loops = result.loops[REST]
    _, wanted = control.step_response(control.feedback(EXACT["p"]), T * np.arange(STEP_FRAMES))
    np.testing.assert_allclose(loops["p"].step_response, STEP_M * wanted, atol=1e-4)
    assert {failure.controller for failure in result.failures} == {"Raises"}
    told = result.summary()["loop"]["cases"][REST]["Raises"]
    assert set(told["margins"].values()) == set(told["step"].values()) == {None}


def test_stopped_loop_study_has_no_result_and_unknown_controller_is_rejected() -> None:
    stopped = measure_loop(ideal(), ["p"], start_progress=lambda title, frames: stop_at(3))
    assert (stopped.loops, stopped.stopped, stopped.table()) == ({}, "interrupted", "")
    assert stopped.summary()["loop"] is None
    with pytest.raises(om.OmniError, match="unknown controller 'pp'"):
        measure_loop(ideal(), ["pp"])
