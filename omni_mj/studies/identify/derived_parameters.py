"""Numbers of the robot with their intervals, or the reason why the data cannot tell them."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from scipy.optimize import approx_fprime

from omni_control.kinematics import Array
from omni_control.traction import GRAVITY
from omni_mj.config import nominal_model
from omni_mj.config.settings import PERIOD_S, Settings
from omni_mj.studies.identify.parameter_fit import RANGES, Fit
from omni_mj.studies.identify.slip_dynamics import LATE, Body

FAST_M_S, PULLING_M_S2, MOVING_M_S, LONG_ENOUGH_S = (
    1.0,
    1.0,
    0.5,
    0.2,
)  # what creep needs, and for how long
DRIVES_M_S, TURNS_RAD_S = (
    0.1,
    0.3,
)  # root mean square along an axis, below which its gain is not told
LAWLESS = {
    True: 10.0,
    False: 2.0,
}  # by wheels, by commands: residuals over noise, from which nothing is told
AXES = ("forward", "sideways")


class Kind(NamedTuple):
    """What is told of a number.

    Attributes:
        title: What it is.
        unit: Of it.
        needs: What the motion must have: forward, sideways, turning, creep; see `find_lacks`.
        limit: Half width of the 95 % interval above which it is not told.
        law: Standard error of the law itself: `tests/bench_identify.py`.
        relative: Whether these two are shares of the value.
    """

    title: str
    unit: str
    needs: str
    limit: float
    law: float
    relative: bool = False


KINDS = {
    LATE: Kind("latency of the loop", "s", "", 0.5 * PERIOD_S, 8e-4),
    "clock_s": Kind("poses later than wheels by", "s", "", 0.5 * PERIOD_S, 4.5e-4),
    "creep_stiffness": Kind("creep stiffness C", "", "creep", 0.25, 0.014, relative=True),
    "rolling_resistance": Kind("drag of the pile, over load", "", "creep", 0.02, 7e-3),
    "roller_friction": Kind("friction of rollers, over load", "", "creep", 0.03, 8e-3),
    "radius_m": Kind("effective wheel radius", "m", "", 0.01, 1.1e-3, relative=True),
    "arm_m": Kind("effective arm", "m", "turning", 0.02, 3e-3, relative=True),
    "lag_forward_s": Kind("lag tau forward", "s", "forward", 0.02, 1e-3),
    "friction_forward_m_s": Kind("dry friction c forward", "m/s", "forward", 0.03, 0.0),
    "gain_turning": Kind("gain K turning", "", "turning", 0.05, 2e-3),
    "compass_rad": Kind("angle of the robot's axes", "rad", "", 0.05, 0.0),
}
for _axis in AXES:
    KINDS |= {
        f"gain_{_axis}": Kind(f"gain K {_axis}", "", _axis, 0.05, 2e-3),
        f"creep_{_axis}_s2_m": Kind(f"creep T {_axis}", "s^2/m", f"{_axis} creep", 0.03, 1e-3),
        f"drag_{_axis}_m_s2": Kind(
            f"drag through the contacts {_axis}",
            "m/s^2",
            f"{_axis} creep",
            0.25,
            0.025,
            relative=True,
        ),
    }
for _axis in "xy":
    KINDS[f"slope_{_axis}_rad"] = Kind(
        f"slope of the carpet down along {_axis}", "rad", "creep", 0.01, 4e-4
    )


@dataclass(frozen=True)
class Estimate:
    """A number of the robot.

    Attributes:
        name: Of the number.
        title: What it is.
        unit: Of it.
        source: commands or wheels.
        value: Of it.
        error: Standard error.
        low: End of the 95 % interval.
        high: Its other end.
        why_not: Why the data cannot tell it, or None.
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

    @property
    def is_identified(self) -> bool:
        """Whether the data tell it."""
        return self.why_not is None

    def report(self) -> dict[str, Any]:
        """Return it as JSON has it, without numbers where the data cannot tell."""
        head = {"title": self.title, "unit": self.unit, "source": self.source, "value": self.value}
        if not self.is_identified:
            return head | {"value": None, "not_identifiable": self.why_not}
        return head | {"standard_error": self.error, "interval_95": [self.low, self.high]}


def find_lacks(twists: Sequence[Array], period: float) -> dict[str, str]:
    """Return needs of numbers that a motion lacks, each with the reason.

    Args:
        twists: Of each log, body frame, (F, 3).
        period: Of the lines, s.
    """
    window = max(1, round(0.1 / period))
    rms = np.sqrt((np.concatenate(twists) ** 2).mean(0))
    pull = np.concatenate(
        [np.hypot(*(t[window:] - t[:-window]).T[:2]) / (window * period) for t in twists]
    )
    speed = np.concatenate([np.hypot(*t[window:].T[:2]) for t in twists])
    lacks = {}
    if np.hypot(*rms[:2]) < DRIVES_M_S / 2 and rms[2] < TURNS_RAD_S / 2:
        lacks["motion"] = "the robot stands"
    hard = (pull >= PULLING_M_S2) & (speed >= MOVING_M_S)
    if period * min(hard.sum(), (speed >= FAST_M_S).sum()) < LONG_ENOUGH_S:
        have = f"these data hold {np.quantile(speed, 0.99):.2f} m/s and {np.quantile(pull, 0.99):.2f} m/s^2"
        lacks["creep"] = f"it needs {FAST_M_S:g} m/s and {PULLING_M_S2:g} m/s^2; {have}"
    for i, axis in enumerate(AXES):
        if rms[i] < DRIVES_M_S:
            lacks[axis] = f"the robot moves {axis} at {rms[i]:.2f} m/s (rms) only"
    if rms[2] < TURNS_RAD_S:
        lacks["turning"] = f"the robot turns at {rms[2]:.2f} rad/s (rms) only"
    return lacks


def estimates(fitted: Fit, settings: Settings, lacks: Mapping[str, str]) -> Iterator[Estimate]:
    """Yield all numbers that depend on what was fitted, with errors by the delta method.

    Args:
        fitted: The fit.
        settings: Of the start robot.
        lacks: What the motion lacks; see `find_lacks`.
    """
    by_wheels, free = fitted.stretches.are_wheels, fitted.free

    def evaluate(x: Array) -> dict[str, float]:
        parameters = fitted.parameters | dict(zip(free, x.tolist(), strict=True))
        return numbers(fitted.body, settings, parameters, by_wheels)

    fit = np.array([fitted.parameters[name] for name in free])
    steps = [1e-3 * RANGES[name][0] for name in free]
    gradient = approx_fprime(fit, lambda x: np.array(list(evaluate(x).values())), steps)
    errors = np.sqrt(np.einsum("ki,ij,kj->k", gradient, fitted.covariance, gradient))
    for (name, value), error in zip(evaluate(fit).items(), errors, strict=True):
        kind, of_creep = KINDS[name], "creep" in name
        if not (name == "creep_stiffness" and by_wheels) and (
            error == 0 or (of_creep and "creep" not in free)
        ):
            continue  # not fitted
        size = abs(value) if kind.relative else 1.0
        error = float(np.hypot(error, kind.law * size))
        half, limit = fitted.quantile * error, kind.limit * size
        why = next((lacks[need] for need in kind.needs.split() if need in lacks), _lawless(fitted))
        if not why and (name in fitted.at_bound or (of_creep and "creep" in fitted.at_bound)):
            why = f"the fit stopped at a bound, {value:.3g} {kind.unit}".rstrip()
        if not why and not half <= limit:
            why = (
                f"its 95 % interval is +-{half:.2g} {kind.unit}".rstrip()
                + f", wider than +-{limit:.2g}"
            )
        source = "wheels" if by_wheels else "commands"
        yield Estimate(
            name, kind.title, kind.unit, source, value, error, value - half, value + half, why
        )


def numbers(
    body: Body, settings: Settings, p: Mapping[str, float], by_wheels: bool
) -> dict[str, float]:
    """Return the numbers of a robot that follows the law with these parameters; see `omni_mj.config.nominal_model`."""
    give, scale, stiffness = p["give_s"], p["scale"], 1 / max(p["creep"], 1e-9)
    arm = settings.wheels.arm_m * p["arm"]
    changes = {
        "drivetrain": {"creep_stiffness": stiffness, "roller_friction": p["roller_friction"]},
        "carpet": {"rolling_resistance": p["rolling_resistance"]},
        "wheels": {"arm_m": arm},
    }
    sections = {
        name: getattr(settings, name).model_copy(update=fields) for name, fields in changes.items()
    }
    law = nominal_model.compute_creep_law(settings.model_copy(update=sections))
    (forward, sideways, turning), drag = map(float, law.gain), law.drag / settings.body.mass_kg
    result = {"clock_s" if by_wheels else LATE: p[LATE], "creep_stiffness": stiffness}
    result |= {name: p[name] for name in ("rolling_resistance", "roller_friction", "compass_rad")}
    if by_wheels:
        gain_turning = scale / p["arm"] * turning
        result |= {"radius_m": body.radius * scale, "arm_m": arm}
    else:
        gain_turning = (
            scale * (1 + p["turn_rate_gain"]) / (1 / turning + scale * p["turn_rate_gain"])
        )
        cosines = np.abs(body.along[:, 0])
        squares = (cosines**2).sum()
        result["lag_forward_s"] = float(give * (1 / squares + body.hub))
        result["friction_forward_m_s"] = float(
            (p["friction_m_s"] * cosines.sum() + give * drag[0]) / squares
        )
    result |= {
        "gain_forward": scale * forward,
        "gain_sideways": scale * sideways,
        "gain_turning": gain_turning,
    }
    for i, axis in enumerate(AXES):
        result |= {
            f"creep_{axis}_s2_m": scale * float(law.time[i]),
            f"drag_{axis}_m_s2": float(drag[i]),
        }
    return result | {f"slope_{axis}_rad": p[f"lean_{axis}_m_s2"] / GRAVITY for axis in "xy"}


def _lawless(fitted: Fit) -> str | None:
    """Say that the law does not describe the motion at all, if so."""
    most = LAWLESS[fitted.stretches.are_wheels]
    for what, r in fitted.residuals.items():
        if fitted.misfit and r.rms > most * r.noise:
            return f"the law does not describe this motion: residuals of {what} are {r.rms / r.noise:.1f} times the noise"
    return None
