"""What the data tell of each number, with its interval, and where they do not, why, and what would."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from omni_control.kinematics import Array
from omni_mj.scenarios.settings import Settings
from omni_mj.studies.identify import law, numbers
from omni_mj.studies.identify.fit import LATE, Fit
from omni_mj.studies.identify.segments import Segments

FRAME_S = 1 / 60
FAST_M_S, PULLING_M_S2, MOVING_M_S = 1.0, 1.0, 0.5  # what creep needs: this speed, and this acceleration while moving
LONG_ENOUGH_S = 0.2
# Residuals over noise, from which a law that misfits tells nothing. That of wheels leaves out slip at the most; it
# is 3 to 8 of a robot in a laboratory whose radius it tells (docs/identify.md), 18 where two wheels are swapped.
LAWLESS, LAWLESS_WHEELS = 2.0, 10.0
DRIVES_M_S, TURNS_RAD_S = 0.1, 0.3  # root mean square along an axis, below which its gain is not told


@dataclass(frozen=True)
class Kind:
    """What is told of a number.

    Attributes:
        title, unit: of it.
        limit: half width of the 95 % interval above which it is not told; share: the same, over the value.
        needs: what the motion must have: forward, sideways, turning or creep, several separated by blanks.
        would_tell: what to drive.
        law: standard error of the law itself, over the value where it is a share (`share`): how far it was off on our
            plant where noise does not explain it (docs/identify.md).
    """

    title: str
    unit: str
    limit: float
    share: float
    needs: str
    would_tell: str
    law: float = 0.0


GAIN = "half a minute along that axis, with plateaus at two or three speeds"
CREEP = "moves along that axis to 1, 1.5 and 2 m/s at 2 m/s^2 and more, there and back, ten each (--plan)"
LAG = "steps of the command at low speed along that axis, where creep is small"
STEPS = "changes of the command of 1 m/s or more, twenty or so"
STRAIGHT = "straight moves of a metre or more"
DRAG = "as for creep; roll-outs with motors off, or motors' currents"
KINDS = {
    LATE: Kind("latency of the loop", "s", 0.5 * FRAME_S, 0, "", STEPS, 8e-4),
    "clock_s": Kind("poses later than wheels by", "s", 0.5 * FRAME_S, 0, "", STEPS, 4.5e-4),
    "drift": Kind("and more so by, each second", "", 1e-3, 0, "", "a log of a minute or more", 5e-5),
    "gain_forward": Kind("gain K forward", "", 0.05, 0, "forward", GAIN, 2e-3),
    "gain_sideways": Kind("gain K sideways", "", 0.05, 0, "sideways", GAIN, 2e-3),
    "gain_turning": Kind("gain K turning", "", 0.05, 0, "turning", GAIN, 2e-3),
    "creep_stiffness": Kind("creep stiffness C", "", 0, 0.25, "creep", CREEP, 0.014),
    "creep_forward_s2_m": Kind("creep T forward", "s^2/m", 0.03, 0, "creep forward", CREEP, 8e-4),
    "creep_sideways_s2_m": Kind("creep T sideways", "s^2/m", 0.03, 0, "creep sideways", CREEP, 1.1e-3),
    "drag_forward_m_s2": Kind("drag through the contacts forward", "m/s^2", 0, 0.25, "creep forward", DRAG, 0.03),
    "drag_sideways_m_s2": Kind("drag through the contacts sideways", "m/s^2", 0, 0.25, "creep sideways", DRAG, 0.017),
    "pile": Kind("drag of the pile, over load", "", 0.02, 0, "creep", DRAG, 7e-3),
    "roller_friction": Kind("friction of rollers, over load", "", 0.03, 0, "creep", DRAG, 8e-3),
    "radius_m": Kind("effective wheel radius", "m", 0, 0.01, "", GAIN, 1.1e-3),
    "arm_m": Kind("effective arm", "m", 0, 0.02, "turning", GAIN, 3e-3),
    "lag_forward_s": Kind("lag tau forward", "s", 0.02, 0, "forward", LAG, 1e-3),
    "lag_sideways_s": Kind("lag tau sideways", "s", 0.02, 0, "sideways", LAG, 1.5e-3),
    "lag_turning_s": Kind("lag turning", "s", 0.02, 0, "turning", LAG, 1e-3),
    "friction_forward_m_s": Kind(
        "dry friction c forward", "m/s", 0.03, 0, "forward", "moves at 0.1 to 0.3 m/s beside fast ones"
    ),
    "friction_sideways_m_s": Kind(
        "dry friction c sideways", "m/s", 0.03, 0, "sideways", "moves at 0.1 to 0.3 m/s beside fast ones"
    ),
    "stiffness_n_s_m": Kind("stiffness of a wheel's loop", "N s/m", 0, 0.25, "", LAG, 0.03),
    "integral_1_s": Kind("integral over proportional gain of loops", "1/s", 0, 0.5, "", STEPS),
    "grip": Kind("friction of wheels on the carpet", "", 0, 0.1, "", "moves on which wheels slide"),
    "slope_x_rad": Kind("slope of the carpet down along x", "rad", 0.01, 0, "creep", CREEP, 4e-4),
    "slope_y_rad": Kind("slope of the carpet down along y", "rad", 0.01, 0, "creep", CREEP, 4e-4),
    "compass_rad": Kind("angle of the robot's axes", "rad", 0.05, 0, "", STRAIGHT),
}


@dataclass(frozen=True)
class Estimate:
    """A number of the robot.

    Attributes:
        name, title, unit: of it; `source` is what it was found from: commands, wheels or motors.
        value, error: with its standard error, of which `noise` is what the data's noise and what is believed explain,
            the rest the law's; low and high: ends of the 95 % interval. Kept where it is not told, too, so that the
            reason can be checked.
        why_not: why the data cannot tell it, or None.
        would_tell: what to drive then.
    """

    name: str
    title: str
    unit: str
    source: str
    value: float
    error: float
    noise: float
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
            return head | {
                "value": self.value,
                "standard_error": self.error,
                "of_noise": self.noise,
                "interval_95": [self.low, self.high],
            }
        return head | {"value": None, "not_identifiable": self.why_not, "would_tell": self.would_tell}


@dataclass(frozen=True)
class Excitation:
    """What the motion of stretches has, for each of forward and sideways (2,).

    Attributes:
        rms: of the speed along the axis, m/s; turning: of the turn rate, rad/s.
        speed, pulling: 99 % of the speed and of the acceleration along the axis.
        creeps: whether it is long enough fast and pulling.
    """

    rms: Array
    turning: float
    speed: float
    pulling: Array
    creeps: np.ndarray

    @classmethod
    def of(cls, fitted: Fit, segments: Segments) -> "Excitation":
        """That of the fitted motion."""
        both = segments.there[:, 1:] & segments.there[:, :-1]
        step = np.maximum(np.diff(segments.time, axis=1), 1e-9)[both]
        along, pull = fitted.twist[:, 1:][both], np.abs(np.diff(fitted.twist, axis=1)[both] / step[:, None])[:, :2]
        speed = np.hypot(along[:, 0], along[:, 1])
        fast = segments.period * (speed >= FAST_M_S).sum()
        hard = segments.period * ((pull >= PULLING_M_S2) & (speed >= MOVING_M_S)[:, None]).sum(0)
        rms = np.sqrt((along**2).mean(0))
        creeps = (fast >= LONG_ENOUGH_S) & (hard >= LONG_ENOUGH_S)
        high = np.quantile(pull, 0.99, axis=0)
        return cls(rms[:2], float(rms[2]), float(np.quantile(speed, 0.99)), high, creeps)

    def lacks(self, needs: str) -> str | None:
        """What of the needs there is not, or None."""
        for axis, way in enumerate(("forward", "sideways")):
            if way in needs and self.rms[axis] < DRIVES_M_S:
                return f"the robot moves {way} at {self.rms[axis]:.2f} m/s (rms) only"
            if "creep" in needs and (way in needs or needs == "creep") and not self.creeps[axis]:
                if needs == "creep" and self.creeps.any():
                    continue
                return (
                    f"it needs {FAST_M_S:g} m/s and {PULLING_M_S2:g} m/s^2 {way}; these data hold "
                    f"{self.speed:.2f} m/s and {self.pulling[axis]:.2f} m/s^2"
                )
        if "turning" in needs and self.turning < TURNS_RAD_S:
            return f"the robot turns at {self.turning:.2f} rad/s (rms) only"
        return None


def estimates(
    fitted: Fit, body: law.Body, settings: Settings, segments: Segments, given: str = ""
) -> Iterator[Estimate]:
    """Of a fit, all numbers that depend on what it was free to change.

    Args:
        fitted: to segments.
        body: that it was fitted with.
        settings: of the start robot.
        segments: that it was fitted to.
        given: why what was not free was not, for numbers that only depend on that.
    """
    source = "wheels" if segments.wheels else "commands"
    excited, beyond = Excitation.of(fitted, segments), _beyond(fitted, LAWLESS_WHEELS if segments.wheels else LAWLESS)
    found = numbers.with_errors(fitted, lambda p: numbers.of(body, settings, p, segments.wheels))
    for i, value in enumerate(fitted.late):
        name = f"clock_{i + 1}_s" if len(fitted.late) > 1 else "clock_s"
        name, kind = (name, KINDS["clock_s"]) if segments.wheels else (LATE, KINDS[LATE])
        yield judged(name, kind, source, float(value), float(fitted.error[i]), fitted.quantile, excited, beyond)
    bounds = dict(zip(fitted.names, fitted.at_bound, strict=True))
    for name, (value, error) in found.items():
        if error == 0.0 or (not segments.wheels and "creep" not in fitted.names and name.startswith("creep")):
            continue  # what other data told
        stopped = bounds.get("creep" if name == "creep_stiffness" else name, False)
        why = f"the fit stopped at a bound, {value:.3g} {KINDS[name].unit}".rstrip() if stopped else None
        yield judged(name, KINDS[name], source, value, error, fitted.quantile, excited, beyond or why)
    if "creep" not in fitted.names and given:
        for name in ("creep_stiffness",):
            kind = KINDS[name]
            nan = float("nan")
            why = excited.lacks(kind.needs) or given
            yield Estimate(name, kind.title, kind.unit, source, nan, nan, nan, nan, nan, why, kind.would_tell)


def _beyond(fitted: Fit, most: float) -> str | None:
    """That the law does not describe the motion, where residuals say so: then its numbers are none of the robot's."""
    if not fitted.misfit:
        return None
    for one, unit in ((fitted.position, "mm"), (fitted.heading, "mrad")):
        if one.rms > most * one.noise:
            return (
                f"the law does not describe this motion: residuals of {1e3 * one.rms:.1f} {unit}, of which noise "
                f"{1e3 * one.noise:.1f} {unit}"
            )
    return None


def judged(
    name: str,
    kind: Kind,
    source: str,
    value: float,
    error: float,
    quantile: float,
    excited: Excitation | None = None,
    wrong: str | None = None,
) -> Estimate:
    """A number with its interval, or with the reason for which it is not told; `wrong`, if there is one, is another."""
    noise = error
    error = float(np.hypot(noise, kind.law * (abs(value) if kind.share and not kind.limit else 1.0)))
    half = quantile * error
    why = excited.lacks(kind.needs) if excited and kind.needs else None
    limit = max(kind.limit, kind.share * abs(value))
    if why is None and not half <= limit:
        width = f"+-{half:.2g} {kind.unit}".rstrip() if np.isfinite(half) else "without end"
        why = f"its 95 % interval is {width}, wider than +-{limit:.2g} {kind.unit}".rstrip()
    why = why or wrong
    ends = value - half, value + half
    return Estimate(name, kind.title, kind.unit, source, value, error, noise, *ends, why, kind.would_tell)
