"""Numbers of the robot with their intervals, or the reason why the data cannot tell them and what would."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from scipy.optimize import approx_fprime

from omni_control.kinematics import Array
from omni_mj.scenarios import told
from omni_mj.scenarios.settings import PERIOD_S, Settings
from omni_mj.scenarios.told import GRAVITY_M_S2
from omni_mj.studies.identify.fit import LATE, RANGES, Fit
from omni_mj.studies.identify.law import NAMES, Body
from omni_mj.studies.identify.logs import Log

FAST_M_S, PULLING_M_S2, MOVING_M_S, LONG_ENOUGH_S = 1.0, 1.0, 0.5, 0.2  # what creep needs, and for how long
DRIVES_M_S, TURNS_RAD_S = 0.1, 0.3  # root mean square along an axis, below which its gain is not told
LAWLESS = {True: 10.0, False: 2.0}  # by wheels, by commands: residuals over noise, from which nothing is told
AXES = ("forward", "sideways")
NORMAL, LEAST_STAMPS = 1.96, 20


class Kind(NamedTuple):
    """What is told of a number.

    Attributes:
        title, unit: of it.
        limit: half width of the 95 % interval above which it is not told; share: the same, over the value.
        needs: what the motion must have: forward, sideways, turning, creep.
        would_tell: what to drive.
        law: standard error of the law itself, over the value if `share` is: `tests/bench_identify.py`.
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
RECEIVED = "a column received_s: when the robot got each line's command, by any clock"
SLOW = "moves at 0.1 to 0.3 m/s beside fast ones"
KINDS = {
    LATE: Kind("latency of the loop", "s", 0.5 * PERIOD_S, 0, "", STEPS, 8e-4),
    "clock_s": Kind("poses later than wheels by", "s", 0.5 * PERIOD_S, 0, "", STEPS, 4.5e-4),
    "drift": Kind("and more so by, each second", "", 1e-3, 0, "", "a log of a minute or more", 5e-5),
    "creep_stiffness": Kind("creep stiffness C", "", 0, 0.25, "creep", CREEP, 0.014),
    "pile": Kind("drag of the pile, over load", "", 0.02, 0, "creep", CREEP, 7e-3),
    "roller_friction": Kind("friction of rollers, over load", "", 0.03, 0, "creep", CREEP, 8e-3),
    "radius_m": Kind("effective wheel radius", "m", 0, 0.01, "", GAIN, 1.1e-3),
    "arm_m": Kind("effective arm", "m", 0, 0.02, "turning", GAIN, 3e-3),
    "lag_forward_s": Kind("lag tau forward", "s", 0.02, 0, "forward", LAG, 1e-3),
    "friction_forward_m_s": Kind("dry friction c forward", "m/s", 0.03, 0, "forward", SLOW),
    "jitter_s": Kind("jitter of the delay, standard deviation", "s", 0.004, 0.5, "", RECEIVED),
    "lost": Kind("commands that were lost, share", "", 0.02, 0, "", RECEIVED),
    "compass_rad": Kind("angle of the robot's axes", "rad", 0.05, 0, "", "straight moves of a metre or more"),
}
for _axis in (*AXES, "turning"):
    KINDS[f"gain_{_axis}"] = Kind(f"gain K {_axis}", "", 0.05, 0, _axis, GAIN, 2e-3)
    KINDS[f"creep_{_axis}_s2_m"] = Kind(f"creep T {_axis}", "s^2/m", 0.03, 0, f"creep {_axis}", CREEP, 1e-3)
    KINDS[f"drag_{_axis}_m_s2"] = Kind(
        f"drag through the contacts {_axis}", "m/s^2", 0, 0.25, f"creep {_axis}", CREEP, 0.025
    )
for _axis in "xy":
    KINDS[f"slope_{_axis}_rad"] = Kind(f"slope of the carpet down along {_axis}", "rad", 0.01, 0, "creep", CREEP, 4e-4)


@dataclass(frozen=True)
class Estimate:
    """A number of the robot.

    Attributes:
        name, title, unit: of it; source: commands, wheels or stamps.
        value, error: with its standard error; low, high: ends of the 95 % interval.
        why_not: why the data cannot tell it, or None; would_tell: what to drive then.
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
        """Return it as JSON has it, without numbers where the data cannot tell."""
        head = {"title": self.title, "unit": self.unit, "source": self.source}
        if not self.told:
            return head | {"value": None, "not_identifiable": self.why_not, "would_tell": self.would_tell}
        return head | {
            "value": self.value,
            "standard_error": self.error,
            "interval_95": [self.low, self.high],
        }


class Excitation:
    """What the motion has, by the inputs.

    Args:
        twists: of each log, body frame, (F, 3).
        period: of the lines, s.

    Attributes:
        rms: speed along the axes, m/s, and turn rate, rad/s, (3,).
        speed, pulling: 99 % quantiles of the speed, and of the acceleration along both axes.
        creeps: whether it is fast and pulling for long enough along both axes.
    """

    def __init__(self, twists: Sequence[Array], period: float) -> None:
        window = max(1, round(0.1 / period))
        self.rms = np.sqrt((np.concatenate(twists) ** 2).mean(0))
        pull = np.concatenate([np.abs(t[window:, :2] - t[:-window, :2]) / (window * period) for t in twists])
        speed = np.concatenate([np.hypot(t[window:, 0], t[window:, 1]) for t in twists])
        self.speed, self.pulling = np.quantile(speed, 0.99), np.quantile(pull, 0.99, axis=0)
        hard = (pull >= PULLING_M_S2) & (speed >= MOVING_M_S)[:, None]
        self.creeps = period * np.minimum(hard.sum(0), (speed >= FAST_M_S).sum()) >= LONG_ENOUGH_S

    @property
    def stands(self) -> bool:
        """Whether the robot neither drives nor turns."""
        return bool(np.hypot(*self.rms[:2]) < DRIVES_M_S / 2 and self.rms[2] < TURNS_RAD_S / 2)

    def lacks(self, needs: str) -> str | None:
        """Return what the motion lacks of the needs of a number, or None."""
        axes = [i for i, axis in enumerate(AXES) if axis in needs] or [int(self.creeps.argmax())]
        for i in axes:
            if AXES[i] in needs and self.rms[i] < DRIVES_M_S:
                return f"the robot moves {AXES[i]} at {self.rms[i]:.2f} m/s (rms) only"
            if "creep" in needs and not self.creeps[i]:
                have = f"these data hold {self.speed:.2f} m/s and {self.pulling[i]:.2f} m/s^2"
                return f"it needs {FAST_M_S:g} m/s and {PULLING_M_S2:g} m/s^2 {AXES[i]}; {have}"
        if "turning" in needs and self.rms[2] < TURNS_RAD_S:
            return f"the robot turns at {self.rms[2]:.2f} rad/s (rms) only"
        return None


def numbers(body: Body, settings: Settings, parameters: Array, by_wheels: bool) -> dict[str, float]:
    """Return the numbers of a robot that follows the law with these parameters; see `omni_mj.scenarios.told`."""
    p = dict(zip(NAMES, map(float, parameters), strict=True))
    give, scale, mass = p["give_s"], p["scale"], settings.body.mass_kg
    creeping = settings.model_copy(
        update={
            "drive": settings.drive.model_copy(
                update={"creep_stiffness": 1 / max(p["creep"], 1e-9), "roller_friction": p["roller_friction"]}
            ),
            "carpet": settings.carpet.model_copy(update={"pile": p["pile"]}),
            "wheels": settings.wheels.model_copy(update={"creep": "on", "arm_m": settings.wheels.arm_m * p["arm"]}),
        }
    )
    law, cosines = told.creep(creeping), np.abs(body.along[:, 0])
    result = {}
    for i, axis in enumerate(AXES):
        result[f"gain_{axis}"], result[f"creep_{axis}_s2_m"] = scale * float(law.gain[i]), scale * float(law.time[i])
        result[f"drag_{axis}_m_s2"] = float(law.drag[i]) / mass
    turning = float(law.gain[2])
    if by_wheels:
        result |= {
            "gain_turning": scale / p["arm"] * turning,
            "radius_m": body.radius * scale,
            "arm_m": creeping.wheels.arm_m,
        }
    else:
        result["gain_turning"] = scale * (1 + p["turn_gain"]) / (1 / turning + scale * p["turn_gain"])
        squares, drag = (cosines**2).sum(), float(law.drag[0]) / mass
        result["lag_forward_s"] = give * (1 / squares + body.hub)
        result["friction_forward_m_s"] = (p["friction_m_s"] * cosines.sum() + give * drag) / squares
    result["creep_stiffness"] = 1 / max(p["creep"], 1e-9)
    result |= {name: p[name] for name in ("pile", "roller_friction", "compass_rad", "drift")}
    return result | {f"slope_{axis}_rad": p[f"lean_{axis}_m_s2"] / GRAVITY_M_S2 for axis in "xy"}


def estimates(fitted: Fit, settings: Settings, excited: Excitation) -> Iterator[Estimate]:
    """Yield the delay, and all numbers that depend on what was fitted, with errors by the delta method."""
    by_wheels, free = fitted.stretches.are_wheels, fitted.names[1:]
    columns, covariance = [NAMES.index(name) for name in free], fitted.covariance[1:, 1:]

    def of(x: Array) -> dict[str, float]:
        parameters = fitted.parameters.copy()
        parameters[columns] = x
        return numbers(fitted.body, settings, parameters, by_wheels)

    steps = [1e-3 * RANGES[name][0] for name in free]
    gradient = approx_fprime(fitted.value[1:], lambda x: np.array(list(of(x).values())), steps)
    errors = np.sqrt(np.einsum("ki,ij,kj->k", gradient, covariance, gradient))
    delay = {"clock_s" if by_wheels else LATE: fitted.late}
    values = delay | of(fitted.value[1:])
    for (name, value), error in zip(values.items(), [fitted.covariance[0, 0] ** 0.5, *errors], strict=True):
        kind = KINDS[name]
        why = excited.lacks(kind.needs) or _lawless(fitted)
        if "creep" in name and not fitted.parameters[0] and not why:
            why = "it needs faster moves"
        if name in fitted.at_bound or ("creep" in name and "creep" in fitted.at_bound):
            why = why or f"the fit stopped at a bound, {value:.3g} {kind.unit}".rstrip()
        if (error > 0 and ("creep" in free or "creep" not in name)) or (name == "creep_stiffness" and by_wheels):
            yield judged(name, "wheels" if by_wheels else "commands", value, float(error), fitted.quantile, why)


def _lawless(fitted: Fit) -> str | None:
    """Say that the law does not describe the motion at all, if so."""
    for residuals, unit in ((fitted.position, "mm"), (fitted.heading, "mrad")):
        if fitted.misfit and residuals.rms > LAWLESS[fitted.stretches.are_wheels] * residuals.noise:
            return (
                f"the law does not describe this motion: residuals of {1e3 * residuals.rms:.1f} {unit}, of which noise "
                f"{1e3 * residuals.noise:.1f} {unit}"
            )
    return None


def judged(
    name: str, source: str, value: float, error: float, quantile: float = NORMAL, why: str | None = None
) -> Estimate:
    """Return a number and the standard error of its data as an estimate.

    The number is told unless `why` says why not or its interval is too wide.
    """
    kind, size = KINDS[name], abs(value)
    error = float(np.hypot(error, kind.law * (size if kind.share and not kind.limit else 1.0)))
    half, limit = quantile * error, max(kind.limit, kind.share * size)
    if why is None and not half <= limit:
        why = f"its 95 % interval is +-{_number(half, kind)}, wider than +-{_number(limit, kind)}"
    ends = value - half, value + half
    return Estimate(name, kind.title, kind.unit, source, value, error, *ends, why, kind.would_tell)


def _number(value: float, kind: Kind) -> str:
    return f"{value:.2g} {kind.unit}".rstrip()


def by_stamps(logs: Sequence[Log]) -> Iterator[Estimate]:
    """Yield jitter and losses of commands, of logs that say when these were received."""
    late, lost = list[Array](), list[np.ndarray]()
    for log in logs:
        if log.received is not None and (arrived := np.isfinite(log.received)).sum() >= LEAST_STAMPS:
            time, delay = log.time[arrived], (log.received - log.time)[arrived]
            late.append(delay - np.polynomial.Polynomial.fit(time, delay, 1)(time))  # without a drift of the clocks
            lost.append(~arrived)
    if late:
        delays, share, count = np.concatenate(late), float(np.mean(np.concatenate(lost))), sum(map(len, lost))
        spread = float(delays.std())
        error = np.sqrt(max(float((delays**4).mean()) - spread**4, 0.0) / (4 * len(delays))) / max(spread, 1e-12)
        yield judged("jitter_s", "stamps", spread, float(error))
        yield judged("lost", "stamps", share, (share * (1 - share) / count) ** 0.5)
