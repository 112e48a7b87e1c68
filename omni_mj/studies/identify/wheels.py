"""What wheels say of the motion, and what their scales say of the wheels."""

import numpy as np

from omni_control.errors import OmniError
from omni_control.kinematics import Array
from omni_mj.scenarios.settings import Settings
from omni_mj.studies.identify.findings import Estimate
from omni_mj.studies.identify.logs import Log

GRAVITY_M_S2 = 9.81
APART = 3.0  # standard errors by which two numbers differ that are not taken for one


def twists(log: Log, settings: Settings) -> Array:
    """Body twists (F, 3) by the wheels of a log and the geometry of the start robot.

    Raises:
        OmniError: the robot has another number of wheels.
    """
    assert log.wheels is not None
    geometry = settings.wheels.kinematics
    if (have := log.wheels.shape[1]) != (count := len(geometry.azimuths)):
        raise OmniError(f"{log.name}: {have} wheels, but the robot's file has {count}; name one of {have} by --robot")
    if not np.isfinite(log.wheels).all():
        raise OmniError(f"{log.name}: wheels are missing in line {np.argmin(np.isfinite(log.wheels).all(1)) + 1}")
    if (rim := np.quantile(np.abs(log.wheels), 0.95) * geometry.radius) > 10:
        raise OmniError(f"{log.name}: wheels run at {rim:.0f} m/s; are they in degrees or counts, or before the gear?")
    return geometry.body_twist(log.wheels)


def derived(found: list[Estimate], settings: Settings) -> tuple[list[Estimate], list[str]]:
    """Effective radius, arm, and creep stiffness, as far as scales and creep tell them, and notes on what they do not.

    Scales are the gains K: motion per motion by the wheels. Where K is the same forward and sideways it is taken for
    the radius; drag that passes through creeping wheels makes it smaller, and more so sideways.
    """
    have = {e.name: e for e in found if e.source == "wheels" and e.told}
    new, notes = list[Estimate](), list[str]()
    scales = [have[name] for name in ("gain_forward", "gain_sideways") if name in have]
    geometry = settings.wheels.kinematics
    if len(scales) == 2:
        difference, error = scales[0].value - scales[1].value, float(np.hypot(scales[0].error, scales[1].error))
        if abs(difference) > APART * error and abs(difference) > 0.01:
            notes.append(
                f"wheels: scales forward and sideways differ by {difference:.3f} +- {error:.3f}, as of wheels that "
                "creep under drag, or whose angles are others; an effective radius is not told"
            )
        else:
            scale, error = mean(scales)
            quantile = (scales[0].high - scales[0].value) / scales[0].error
            new.append(
                _number(
                    "radius_m",
                    "effective wheel radius",
                    "m",
                    geometry.radius * scale,
                    geometry.radius * error,
                    quantile,
                )
            )
            if turn := have.get("gain_turning"):
                arm = geometry.arm * scale / turn.value
                off = arm * float(np.hypot(error / scale, turn.error / turn.value))
                new.append(_number("arm_m", "effective arm", "m", arm, off, quantile))
    stiff = [_stiffness(e, have[g], settings) for e, g in _creeps(have)]
    if stiff:
        value, error = mean(stiff)
        quantile = (stiff[0].high - stiff[0].value) / stiff[0].error
        new.append(_number("creep_stiffness", "creep stiffness C", "", value, error, quantile))
        if len(stiff) == 2 and abs(stiff[0].value - stiff[1].value) > APART * np.hypot(stiff[0].error, stiff[1].error):
            notes.append(
                f"wheels: forward the creep stiffness is {stiff[0].value:.2f}, sideways {stiff[1].value:.2f}; "
                "one number, their mean, is less than both tell"
            )
    return new, notes


def mean(numbers: list[Estimate]) -> tuple[float, float]:
    """Of numbers weighed by their errors, and its own error; by how they differ, where that is more."""
    values, weights = np.array([e.value for e in numbers]), np.array([e.error**-2 for e in numbers])
    value = float((weights * values).sum() / weights.sum())
    apart = float(np.sqrt((weights * (values - value) ** 2).sum() / max(len(numbers) - 1, 1)))
    return value, float(weights.sum() ** -0.5) * max(1.0, apart)


def _creeps(have: dict[str, Estimate]) -> list[tuple[Estimate, str]]:
    pairs = [("creep_forward_s2_m", "gain_forward"), ("creep_sideways_s2_m", "gain_sideways")]
    return [(have[t], g) for t, g in pairs if t in have and g in have and have[t].low > 0]


def _stiffness(creep: Estimate, gain: Estimate, settings: Settings) -> Estimate:
    """C = W K^2 / (g T sum d^2), of W wheels with direction cosines d: see `omni_mj.studies.slip.law`."""
    directions = settings.wheels.kinematics.matrix[:, 1 if "sideways" in creep.name else 0]
    value = len(directions) * gain.value**2 / (GRAVITY_M_S2 * creep.value * float((directions**2).sum()))
    relative = np.hypot(creep.error / creep.value, 2 * gain.error / gain.value)
    quantile = (creep.high - creep.value) / creep.error
    return _number("creep_stiffness", "creep stiffness C", "", value, float(value * relative), quantile)


def _number(name: str, title: str, unit: str, value: float, error: float, quantile: float) -> Estimate:
    half = quantile * error
    return Estimate(name, title, unit, "wheels", value, error, value - half, value + half, None, "")
