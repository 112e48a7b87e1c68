"""Which parameters of the law are fitted to wheels and to commands, and what is tried if the law misfits."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from omni_control.kinematics import Array, world_to_body
from omni_mj.scenarios.settings import PERIOD_S, Settings
from omni_mj.studies.identify import checks
from omni_mj.studies.identify.findings import TURNS_RAD_S, Estimate, Excitation, estimates
from omni_mj.studies.identify.fit import Fit, Problem, fit
from omni_mj.studies.identify.law import NAMES, Body
from omni_mj.studies.identify.logs import Log
from omni_mj.studies.identify.stretches import LEAST, cut

ODD, MOST_ODD = 3.0, 0.25  # residuals over their median, and share, of stretches that may be left out
DRIFTS_S = 30.0  # length of logs from which clocks may run at different speeds
OTHER_RADIUS, SURE = 0.025, 3.0  # and standard errors, from which the radius is not that of the robot's file
ROLLS, RADIUS_SHARE = 0.9988, 0.002  # rolling radius over the file's (rubber is pressed), and how well it is known
CONTACTS = ("creep", "pile", "roller_friction", "lean_x_m_s2", "lean_y_m_s2")


@dataclass
class Part:
    """The fit to one kind of inputs.

    Attributes:
        source: wheels or commands.
        fitted: to most stretches.
        before: residuals (rms) of the same by the start values, of positions in m and headings in rad.
        estimates: numbers, told or not.
        notes: a line each.
    """

    source: str
    fitted: Fit
    before: tuple[float, float]
    estimates: list[Estimate] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)


def by_wheels(logs: Sequence[Log], settings: Settings) -> Part | None:
    """Fit the law to wheels and poses; return None if the robot stands still.

    Raises:
        OmniError: wheels or axes are not those of this robot, or there is too little.
    """
    body, notes = Body.of(settings), list[str]()
    twists = [checks.wheel_twists(log, settings) for log in logs]
    late = np.median([checks.delay(log, t, True, "wheels", settings) for log, t in zip(logs, twists, strict=True)])
    stretches = cut(logs, [log.wheels for log in logs if log.wheels is not None], [True] * len(logs), True)
    excited = Excitation(twists, stretches.period)
    if excited.stands:
        return None
    believed, free = body.parameters(settings, by_wheels=True), ["scale", "arm", "compass_rad"]
    if max(np.ptp(log.time) for log in logs) > DRIFTS_S:
        free.append("drift")
    start = believed.copy()
    if excited.creeps.any():
        free += CONTACTS
    else:
        start[[NAMES.index(name) for name in CONTACTS]] = 0.0
        notes.append("wheels: too slow for creep; what creeps under drag is in radius and gains")
    fitted = _without_odd(fit(body, stretches, start, float(late), free), notes, "wheels")
    if excited.creeps.any():
        fitted = _believing_the_radius(fitted, notes)
    before = _residuals(fitted, believed, 0.0)
    return Part("wheels", fitted, before, list(estimates(fitted, settings, excited)), notes)


def by_commands(logs: Sequence[Log], settings: Settings, rolled: Fit | None) -> Part | None:
    """Fit the law to commands and poses; return None if the robot stands still.

    Args:
        logs: with commands.
        settings: of the start robot.
        rolled: the fit to wheels, whose creep and drag are not fitted again; or None.

    Raises:
        OmniError: axes are others than said, or there is too little.
    """
    body, notes = Body.of(settings), list[str]()
    inputs = [log.command for log in logs if log.command is not None]
    late = [checks.delay(log, u, log.in_body, "commands", settings) for log, u in zip(logs, inputs, strict=True)]
    stretches = cut(logs, inputs, [log.in_body for log in logs], False)
    excited = Excitation([_along_body(log, u) for log, u in zip(logs, inputs, strict=True)], stretches.period)
    if excited.stands:
        return None
    believed = body.parameters(settings, by_wheels=False)
    start, at = believed.copy(), NAMES.index
    free = ["scale", "give_s", "friction_m_s", "compass_rad"]
    free += ["turn_gain"] * bool(excited.rms[2] > TURNS_RAD_S)
    if rolled is not None:
        shared = [at(name) for name in CONTACTS]
        start[shared] = rolled.parameters[shared]
        start[at("arm")] = rolled.parameters[at("arm")] / rolled.parameters[at("scale")]
    elif excited.creeps.any():
        free += CONTACTS
    else:
        start[[at(name) for name in CONTACTS]] = 0.0
    lag = 2 * believed[at("give_s")] / len(body.along)
    fitted = _without_odd(fit(body, stretches, start, max(np.median(late) - lag, 0.01), free), notes, "commands")
    before = _residuals(fitted, believed, settings.radio.delay_frames * PERIOD_S)
    return Part("commands", fitted, before, list(estimates(fitted, settings, excited)), notes)


def _along_body(log: Log, command: Array) -> Array:
    """Return commands along the body's axes, by the headings that are known."""
    known = np.isfinite(log.pose[:, 2])
    heading = np.interp(log.time, log.time[known], log.pose[known, 2])
    return command if log.in_body else world_to_body(command, heading)


def _believing_the_radius(fitted: Fit, notes: list[str]) -> Fit:
    """Condition a fit on the radius of the robot's file, unless the data contradict it.

    Drag that is pulled through creep takes a share of the speed, as a smaller radius does; data know their sum well.
    """
    at = fitted.names.index("scale")
    scale, variance = fitted.value[at], fitted.covariance[at, at]
    off = f"{100 * (scale - 1):+.1f} +- {100 * variance**0.5:.1f} %"
    if abs(scale - 1) > max(SURE * variance**0.5, OTHER_RADIUS):
        notes.append(f"wheels: their radius is not that of the robot's file: {off}")
        return fitted
    share = 100 * RADIUS_SHARE
    notes.append(
        f"wheels: the file's radius is believed within {share:.1f} %; without it, it were {off}, and drag with it"
    )
    gain = fitted.covariance[at] / (variance + RADIUS_SHARE**2)
    value, parameters = fitted.value + gain * (ROLLS - scale), fitted.parameters.copy()
    parameters[[NAMES.index(name) for name in fitted.names[1:]]] = value[1:]
    covariance = fitted.covariance - np.outer(gain, fitted.covariance[at])
    return replace(fitted, value=value, covariance=covariance, parameters=parameters)


def _without_odd(fitted: Fit, notes: list[str], source: str) -> Fit:
    """Fit again without the stretches with far larger residuals, if there are a few."""
    usual = fitted.stretch_rms <= ODD * np.median(fitted.stretch_rms)
    if usual.all() or usual.mean() < 1 - MOST_ODD or usual.sum() < LEAST:
        return fitted
    odd = fitted.stretches.some(~usual).where()
    notes.append(
        f"{source}: {len(odd)} of {len(usual)} stretches with residuals of over {ODD:g} times the median are left out: "
        f"{', '.join(odd[:4])}{', ...' * (len(odd) > 4)}; wheels that slide, a push, or a camera's mistake"
    )
    return fit(fitted.body, fitted.stretches.some(usual), fitted.parameters, fitted.late, fitted.names[1:])


def _residuals(fitted: Fit, parameters: Array, late: float) -> tuple[float, float]:
    """Return residuals (rms) of positions and headings by other parameters and another delay."""
    problem = Problem(fitted.body, fitted.stretches, parameters, [])
    residual = problem.residual(np.array([late])) / problem.metres
    return float((residual[..., :2] ** 2).mean() ** 0.5), float((residual[..., 2] ** 2).mean() ** 0.5)
