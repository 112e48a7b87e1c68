"""Derive a robot's parameters from a fit, with 95 % intervals.

A parameter whose interval is too wide is marked as weak, and one that the data do not determine as
not identified, with the reason.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from scipy.optimize import approx_fprime

from omni_control.kinematics import Array
from omni_control.traction_limits import GRAVITY
from omni_mj.config import PERIOD_S, nominal_model
from omni_mj.studies.identify.parameter_fit import Fit, Prior
from omni_mj.studies.identify.slip_dynamics import DEAD_TIME, RobotDynamics

# To identify creep, a log needs the speed FAST_M_S for MIN_DURATION_S, and the acceleration
# ACCELERATION_M_S2 above the speed MOVING_M_S for MIN_DURATION_S.
FAST_M_S, ACCELERATION_M_S2, MOVING_M_S, MIN_DURATION_S = 1.0, 1.0, 0.5, 0.2
# To identify the gain of an axis, the velocity along it needs this root mean square.
MIN_RMS_M_S, MIN_RMS_RAD_S = 0.1, 0.3
# An estimate is weak if the half width of its interval exceeds the limit of its parameter, and not
# identified if its standard error exceeds this fraction of the prior's.
MAX_PRIOR_FRACTION = 0.95
# Nothing is identified from a misfit whose residuals exceed this multiple of the noise.
MAX_NOISE_RATIO = {"wheels": 10.0, "commands": 2.0}
AXES = ("forward", "sideways")


class ParameterInfo(NamedTuple):
    """Properties of a derived parameter.

    Attributes:
        title: Meaning, for tables.
        unit: Unit, empty for a ratio.
        excitation: Required excitations, separated by spaces; see `find_missing_excitation`.
        limit: Largest half width of the 95 % interval of an estimate that is not weak.
        model_error: Standard error caused by the model, measured by `tests/bench_identify.py`.
        relative: Whether `limit` and `model_error` are relative to the value.
    """

    title: str
    unit: str
    excitation: str
    limit: float
    model_error: float
    relative: bool = False


PARAMETERS = {
    DEAD_TIME: ParameterInfo("dead time of the loop", "s", "", 0.5 * PERIOD_S, 8e-4),
    "clock_offset_s": ParameterInfo("clock offset of poses", "s", "", 0.5 * PERIOD_S, 8e-4),
    "creep_stiffness": ParameterInfo("creep stiffness C", "", "creep", 0.25, 0.014, relative=True),
    "rolling_resistance": ParameterInfo("rolling resistance p", "", "creep", 0.02, 7e-3),
    "roller_friction": ParameterInfo("roller friction b", "", "creep", 0.03, 8e-3),
    "radius_m": ParameterInfo("effective wheel radius", "m", "", 0.01, 1.1e-3, relative=True),
    "arm_m": ParameterInfo("effective arm", "m", "turning", 0.02, 3e-3, relative=True),
    "lag_forward_s": ParameterInfo("lag tau forward", "s", "forward", 0.02, 1e-3),
    "loop_gain": ParameterInfo(
        "gain kp of wheel loops", "V s/rad", "forward", 0.6, 0.15, relative=True
    ),
    "friction_forward_m_s": ParameterInfo("dry friction c forward", "m/s", "forward", 0.03, 0.0),
    "gain_turning": ParameterInfo("gain K turning", "", "turning", 0.05, 2e-3),
    "heading_offset_rad": ParameterInfo("heading offset", "rad", "", 0.05, 0.0),
}
for _axis in AXES:
    PARAMETERS |= {
        f"gain_{_axis}": ParameterInfo(f"gain K {_axis}", "", _axis, 0.05, 2e-3),
        f"creep_{_axis}_s2_m": ParameterInfo(
            f"slip time T {_axis}", "s^2/m", f"{_axis} creep", 0.03, 1e-3
        ),
        f"drag_{_axis}_m_s2": ParameterInfo(
            f"drag / mass {_axis}", "m/s^2", f"{_axis} creep", 0.25, 0.025, relative=True
        ),
    }
for _axis in "xy":
    PARAMETERS[f"slope_{_axis}_rad"] = ParameterInfo(
        f"downward slope along {_axis}", "rad", "creep", 0.01, 4e-4
    )


@dataclass(frozen=True)
class Estimate:
    """Estimate of a parameter of the robot.

    Attributes:
        name: Name of the parameter, a key of `PARAMETERS`.
        source: Inputs of the fit: "commands" or "wheels".
        value: Estimated value.
        standard_error: Standard error of the value.
        low: Lower end of the 95 % interval.
        high: Upper end of the 95 % interval.
        why_not: Reason why the data do not identify the parameter, or None.
        is_weak: Whether the interval is wider than `ParameterInfo.limit`.
    """

    name: str
    source: str
    value: float
    standard_error: float
    low: float
    high: float
    why_not: str | None
    is_weak: bool

    @property
    def info(self) -> ParameterInfo:
        """Properties of the parameter."""
        return PARAMETERS[self.name]

    @property
    def is_identified(self) -> bool:
        """Whether the data identify the parameter, at least weakly."""
        return self.why_not is None

    def report(self) -> dict[str, Any]:
        """Return plain values for JSON; without numbers if the parameter is not identified."""
        head = {"title": self.info.title, "unit": self.info.unit, "source": self.source}
        if not self.is_identified:
            return head | {"value": None, "not_identifiable": self.why_not}
        return head | {
            "value": self.value,
            "weak": self.is_weak,
            "standard_error": self.standard_error,
            "interval_95": [self.low, self.high],
        }


def find_missing_excitation(twists: Sequence[Array], periods: Sequence[float]) -> dict[str, str]:
    """Return the excitations that the motion in all logs lacks.

    Args:
        twists: Twists of each log, body frame, (F, 3).
        periods: Time between lines of each log, s.

    Returns:
        Mapping from a missing excitation to the reason. Excitations are "motion", "creep",
        "forward", "sideways" and "turning".
    """
    rms = np.sqrt((np.concatenate(twists) ** 2).mean(0))
    samples = []
    for twist, period in zip(twists, periods, strict=True):
        window = max(1, round(0.1 / period))
        change = twist[window:, :2] - twist[:-window, :2]
        accelerations = np.hypot(*change.T) / (window * period)
        speeds = np.hypot(*twist[window:, :2].T)
        samples.append([accelerations, speeds, np.full(len(change), period)])
    acceleration, speed, duration = np.concatenate(samples, axis=1)
    reasons = {}
    if np.hypot(*rms[:2]) < MIN_RMS_M_S / 2 and rms[2] < MIN_RMS_RAD_S / 2:
        reasons["motion"] = "the robot does not move"
    is_accelerating = (acceleration >= ACCELERATION_M_S2) & (speed >= MOVING_M_S)
    if min(duration[is_accelerating].sum(), duration[speed >= FAST_M_S].sum()) < MIN_DURATION_S:
        present = [f"{np.quantile(values, 0.99):.2f}" for values in (speed, acceleration)]
        reasons["creep"] = (
            f"it needs {FAST_M_S:g} m/s and {ACCELERATION_M_S2:g} m/s^2; "
            f"these data reach {present[0]} m/s and {present[1]} m/s^2"
        )
    for i, axis in enumerate(AXES):
        if rms[i] < MIN_RMS_M_S:
            reasons[axis] = f"the robot moves {axis} at {rms[i]:.2f} m/s (rms) only"
    if rms[2] < MIN_RMS_RAD_S:
        reasons["turning"] = f"the robot turns at {rms[2]:.2f} rad/s (rms) only"
    return reasons


def estimate_parameters(
    fit: Fit, prior: Prior, missing_excitation: Mapping[str, str]
) -> Iterator[Estimate]:
    """Yield an estimate of each parameter that depends on fitted ones.

    Standard errors follow from the covariance of the fit by the delta method.

    Args:
        fit: Fit of the slip dynamics, with its prior.
        prior: The prior.
        missing_excitation: Missing excitations and reasons; see `find_missing_excitation`.
    """
    problem, free, source = fit.problem, fit.problem.free, fit.problem.segments.source
    by_wheels, settings = source == "wheels", problem.dynamics.settings

    def evaluate(x: Array) -> dict[str, float]:
        return derive_parameters(problem.dynamics, problem.parameters(x), by_wheels)

    gradient = approx_fprime(
        fit.values, lambda x: np.array(list(evaluate(x).values())), 1e-3 * problem.scale
    )
    errors = np.sqrt(np.einsum("ki,ij,kj->k", gradient, fit.covariance, gradient))
    prior_errors = np.hypot.reduce(gradient * prior.error, axis=1)
    for (name, value), error, prior_error in zip(
        evaluate(fit.values).items(), errors, prior_errors, strict=True
    ):
        is_creep_fitted = "creep" not in name or "creep_compliance" in free
        is_fitted = error != 0 and is_creep_fitted
        if not is_fitted and not (name == "creep_stiffness" and by_wheels):
            continue
        info = PARAMETERS[name]
        size = abs(value) if info.relative else 1.0
        total_error = float(np.hypot(error, info.model_error * size))
        half = fit.quantile * total_error
        reason = _why_not_identified(fit, name, value, missing_excitation)
        if reason is None and error > MAX_PRIOR_FRACTION * prior_error:
            reason = "these data tell hardly more than the robot's file does"
        elif reason is None and name == "loop_gain" and abs(value - settings.firmware.kp) < half:
            reason = f"the {settings.firmware.kp:g} {info.unit} of the robot's file lies within"
        is_weak = not half <= info.limit * size  # also if it is NaN
        yield Estimate(
            name, source, value, total_error, value - half, value + half, reason, is_weak
        )


def derive_parameters(
    dynamics: RobotDynamics, p: Mapping[str, float], by_wheels: bool
) -> dict[str, float]:
    """Return the values of `PARAMETERS` for parameters p of the slip dynamics.

    The equations are those of `omni_mj.config.nominal_model`.

    Args:
        dynamics: Known properties of the start robot.
        p: Mapping from name to parameter; see `RobotDynamics.nominal_parameters`.
        by_wheels: Whether the inputs were wheel speeds, otherwise commands.

    Returns:
        Mapping from keys of `PARAMETERS` to values; only those that the inputs determine.
    """
    settings, scale = dynamics.settings, p["scale"]
    stiffness = 1 / max(p["creep_compliance"], 1e-9)
    arm = settings.wheels.arm_m * p["arm"]
    changes = {
        "drivetrain": {"creep_stiffness": stiffness, "roller_friction": p["roller_friction"]},
        "carpet": {"rolling_resistance": p["rolling_resistance"]},
        "wheels": {"arm_m": arm},
    }
    sections = {
        name: getattr(settings, name).model_copy(update=fields) for name, fields in changes.items()
    }
    slip = nominal_model.compute_creep_law(settings.model_copy(update=sections))
    (forward, sideways, turning), drag = map(float, slip.gain), slip.drag / settings.body.mass_kg
    unchanged = ("rolling_resistance", "roller_friction", "heading_offset_rad")
    derived = {
        "clock_offset_s" if by_wheels else DEAD_TIME: p[DEAD_TIME],
        "creep_stiffness": stiffness,
        **{name: p[name] for name in unchanged},
    }
    if by_wheels:
        gain_turning = scale / p["arm"] * turning
        derived |= {"radius_m": settings.wheels.radius_m * scale, "arm_m": arm}
    else:
        gyro_gain = p["turn_rate_gain"]
        gain_turning = scale * (1 + gyro_gain) / (1 / turning + scale * gyro_gain)
        cosines = np.abs(dynamics.rim_directions[:, 0])
        squares = (cosines**2).sum()
        compliance = p["compliance_s"]
        derived["lag_forward_s"] = float(compliance * (1 / squares + dynamics.rotor_inertia))
        firmware, back_emf = settings.firmware, settings.motor.wheel_back_emf_v_s
        if not (firmware.ki or firmware.kd):
            nominal = settings.body.mass_kg * nominal_model.compute_rim_compliance(settings)
            derived["loop_gain"] = (firmware.kp + back_emf) * nominal / compliance - back_emf
        derived["friction_forward_m_s"] = float(
            (p["dry_friction_m_s"] * cosines.sum() + compliance * drag[0]) / squares
        )
    derived |= {
        "gain_forward": scale * forward,
        "gain_sideways": scale * sideways,
        "gain_turning": gain_turning,
    }
    for i, axis in enumerate(AXES):
        derived[f"creep_{axis}_s2_m"] = scale * float(slip.coefficient[i])
        derived[f"drag_{axis}_m_s2"] = float(drag[i])
    for axis in "xy":
        derived[f"slope_{axis}_rad"] = p[f"slope_{axis}_m_s2"] / GRAVITY
    return derived


def _why_not_identified(
    fit: Fit, name: str, value: float, missing_excitation: Mapping[str, str]
) -> str | None:
    """Return the reason why a parameter is not identified, or None if it is.

    Args:
        fit: Fit of the slip dynamics.
        name: Name of the parameter.
        value: Value of the parameter.
        missing_excitation: Missing excitations and reasons; see `find_missing_excitation`.
    """
    info = PARAMETERS[name]
    for excitation in info.excitation.split():
        if excitation in missing_excitation:
            return missing_excitation[excitation]
    for quantity, residuals in fit.residuals.items():
        # A log may have no noise.
        ratio = residuals.rms / max(residuals.noise, residuals.allowed)
        if fit.misfit and ratio > MAX_NOISE_RATIO[fit.problem.segments.source]:
            return (
                "the model does not describe this motion: residuals of "
                f"{quantity} are {ratio:.1f} times the noise"
            )
    is_creep_at_bound = "creep" in name and "creep_compliance" in fit.at_bound
    if name in fit.at_bound or is_creep_at_bound:
        return f"the fit stopped at a bound, {value:.3g} {info.unit}".rstrip()
    return None
