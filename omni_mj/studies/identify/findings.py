"""What the data tell of each number, with its interval, and where they do not, why, and what would."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from omni_control.kinematics import Array
from omni_mj.studies.identify.fit import Fit
from omni_mj.studies.identify.segments import Segments

FRAME_S = 1 / 60
FAST_M_S, PULLING_M_S2, MOVING_M_S = 1.0, 1.5, 0.5  # what creep needs: this speed, and this acceleration while moving
LONG_ENOUGH_S = 0.2
DRIVES_M_S, TURNS_RAD_S = 0.1, 0.3  # root mean square along an axis, below which its gain is not told
# Parameter -> unit, half width of the 95 % interval above which it is not told.
LIMITS = {
    "latency": ("s", 0.5 * FRAME_S),
    "gain": ("", 0.05),
    "creep": ("s^2/m", 0.03),
    "lag": ("s", 0.02),
    "friction": ("m/s", 0.03),
    "compass": ("rad", 0.05),
}
TITLES = {
    "latency_s": "latency of the loop",
    "effort_forward": "gain K forward",
    "effort_sideways": "gain K sideways",
    "effort_turning": "gain K turning",
    "creep_forward_s2_m": "creep T forward",
    "creep_sideways_s2_m": "creep T sideways",
    "lag_forward_s": "lag tau forward",
    "lag_sideways_s": "lag tau sideways",
    "lag_turning_s": "lag turning",
    "friction_m_s": "dry friction c",
    "compass_rad": "angle of the robot's axes",
}
EXPERIMENTS = {
    "latency": "changes of the command of 1 m/s or more, twenty or so",
    "gain": "half a minute along that axis, with plateaus at two or three speeds",
    "creep": "moves along that axis to 1, 1.5 and 2 m/s at 2 m/s^2 and more, there and back, ten each (--plan)",
    "lag": "steps of the command at low speed along that axis, where creep is small",
    "friction": "moves at 0.1 to 0.3 m/s beside fast ones",
    "compass": "straight moves of a metre or more",
}


@dataclass(frozen=True)
class Estimate:
    """A number of the robot.

    Attributes:
        name, title, unit: of it; `source` is what it was found from: commands or wheels.
        value, error: with its standard error; low and high: ends of the 95 % interval. Kept where it is not told, too,
            so that the reason can be checked.
        why_not: why the data cannot tell it, or None.
        would_tell: what to drive then.
    """

    name: str
    title: str
    unit: str
    source: str
    value: float
    error: float
    low: float
    high: float
    why_not: str | None
    would_tell: str

    @property
    def told(self) -> bool:
        """Whether the data tell it."""
        return self.why_not is None

    def report(self) -> dict[str, Any]:
        """As JSON has it: no numbers where the data cannot tell."""
        head = {"title": self.title, "unit": self.unit, "source": self.source}
        if self.told:
            return head | {"value": self.value, "standard_error": self.error, "interval_95": [self.low, self.high]}
        return head | {"value": None, "not_identifiable": self.why_not, "would_tell": self.would_tell}


def estimates(found: Fit, segments: Segments, source: str, fixed: tuple[str, ...] = ()) -> list[Estimate]:
    """Of a fit's parameters, all but those that were fixed."""
    return [_estimate(found, i, name, segments, source) for i, name in enumerate(found.names) if name not in fixed]


def _estimate(found: Fit, i: int, name: str, segments: Segments, source: str) -> Estimate:
    value, error = float(found.value[i]), float(found.error[i])
    kind = "gain" if name.startswith("effort") else name.split("_")[0]
    unit, limit = LIMITS[kind]
    axis = 1 if "sideways" in name else 0
    title = TITLES[name]
    if kind == "gain":
        name, value, error = name.replace("effort", "gain"), 1 / value, error / value**2
    if source == "wheels" and kind == "latency":
        title, name = "clock of the wheels, late by", "clock_s"
    half = found.quantile * error
    why = _lacking(kind, axis, found, segments)
    if why is None and not half < limit:
        width = f"+-{half:.2g} {unit}".rstrip() if np.isfinite(half) else "without end"
        why = f"its 95 % interval is {width}, wider than +-{limit:.2g} {unit}".rstrip()
    if why is None and found.at_bound[i]:
        why = f"the fit stopped at a bound, {value:.3g} {unit}".rstrip()
    return Estimate(name, title, unit, source, value, error, value - half, value + half, why, EXPERIMENTS[kind])


def _lacking(kind: str, axis: int, found: Fit, segments: Segments) -> str | None:
    """What the motion lacks to show a parameter, or None."""
    if len(found.names) == 3:
        rates = found.velocity.real[segments.there]
        rms = float(np.sqrt((rates**2).mean()))
        return f"the robot turns at {rms:.2f} rad/s (rms) only" if rms < TURNS_RAD_S else None
    along, speed, pulling = excitation(found, segments, axis)
    rms = float(np.sqrt((along**2).mean()))
    way = ("forward", "sideways")[axis]
    if kind in ("gain", "creep", "lag") and rms < DRIVES_M_S:
        return f"the robot moves {way} at {rms:.2f} m/s (rms) only"
    if kind != "creep":
        return None
    fast = segments.period * (speed >= FAST_M_S).sum()
    hard = segments.period * ((pulling >= PULLING_M_S2) & (speed >= MOVING_M_S)).sum()
    if fast < LONG_ENOUGH_S or hard < LONG_ENOUGH_S:
        return (
            f"it needs {FAST_M_S:g} m/s and {PULLING_M_S2:g} m/s^2 {way}; these data hold "
            f"{np.quantile(speed, 0.99):.2f} m/s and {np.quantile(pulling, 0.99):.2f} m/s^2"
        )
    return None


def excitation(found: Fit, segments: Segments, axis: int) -> tuple[Array, Array, Array]:
    """Speed along an axis, speed, and acceleration along the axis, all of the fitted motion, at its samples."""
    v, there = found.velocity, segments.there
    along = v.imag if axis else v.real
    step = np.maximum(np.diff(segments.time, axis=1), 1e-9)
    pulling = np.abs(np.diff(along, axis=1)) / step
    both = there[:, 1:] & there[:, :-1]
    return along[:, 1:][both], np.abs(v[:, 1:][both]), pulling[both]
