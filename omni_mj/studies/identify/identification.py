"""Identification of a user's robot from its logs: numbers, what they predict, and what the data cannot tell.

`logs` reads tables, `checks` refuses what cannot be of this robot,
`stretches` cuts logs, `law` predicts the motion and `fit` fits it, `findings` says what the data
tell, `robot_file` writes it.
"""

import json
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from omni_control.kinematics import world_to_body
from omni_mj.config import robot_files
from omni_mj.config.scenario import Scenario, load_scenario
from omni_mj.files import write_text
from omni_mj.results.result_tables import DASH, Table, format_table
from omni_mj.studies.identify import log_checks, robot_file_writer
from omni_mj.studies.identify.derived_parameters import Estimate, estimates, find_lacks
from omni_mj.studies.identify.log_segments import cut
from omni_mj.studies.identify.parameter_fit import Fit, fit_usual
from omni_mj.studies.identify.robot_logs import RobotLog, read
from omni_mj.studies.identify.slip_dynamics import LATE, Body

OTHER_RADIUS, SURE = (
    0.025,
    3.0,
)  # and standard errors, from which the radius is not that of the robot's file
ROLLS, RADIUS_SHARE = (
    0.9988,
    0.002,
)  # rolling radius over the file's (rubber is pressed), and how well it is known
CONTACTS = ("creep", "rolling_resistance", "roller_friction", "lean_x_m_s2", "lean_y_m_s2")


@dataclass
class IdentificationResult:
    """Result of an identification.

    Attributes:
        start: Scenario with the robot from which it starts.
        logs: Names of those that were read.
        estimates: Numbers, told or not, by name, such as `wheels.creep_stiffness`.
        fits: To wheels and to commands.
        notes: A line each.
    """

    start: Scenario
    logs: list[str]
    estimates: dict[str, Estimate] = field(default_factory=dict)
    fits: dict[str, Fit] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)

    def __getitem__(self, name: str) -> Estimate:
        """Return the estimate of a name, such as `wheels.creep_stiffness` or `commands.latency_s`."""
        return self.estimates[name]

    @property
    def misfits(self) -> list[str]:
        """What the law does not predict as it should, a line each."""
        return [
            f"motion by {source}: {1e3 * r.lasting:.2f} (mm or mrad) of the residuals of {what} last, of robots that "
            f"the law describes {1e3 * r.allowed:g} at the most: it lacks something of this one"
            for source, fitted in self.fits.items()
            for what, r in fitted.residuals.items()
            if r.misfit
        ]

    def table(self) -> str:
        """Return all of it as lines of text."""
        rows, missing = [], []
        for e in self.estimates.values():
            cells = (
                [f"{e.value:.4g}", f"{e.error:.4g}", f"{e.low:.4g} to {e.high:.4g}"]
                if e.is_identified
                else [DASH] * 3
            )
            rows.append([e.title, e.source, e.unit, *cells])
            if not e.is_identified:
                missing.append(
                    f"not identifiable from these data: {e.title} ({e.source}): {e.why_not}"
                )
        headings = ["", "from", "unit", "value", "std. error", "95 % interval"]
        title = f"{self.start.robot}, identified from {', '.join(self.logs)}"
        residuals = [
            f"motion by {source}: residuals of {what} {1e3 * r.rms:.2f} {unit}, "
            f"of which noise {1e3 * r.noise:.2f} {unit}"
            for source, fitted in self.fits.items()
            for (what, r), unit in zip(fitted.residuals.items(), ("mm", "mrad"), strict=True)
        ]
        misfits, notes = (
            (f"misfit: {line}" for line in self.misfits),
            (f"note: {note}" for note in self.notes),
        )
        return "\n".join(
            [format_table(Table(title, headings, rows, 3)), *residuals, *misfits, *missing, *notes]
        )

    def report(self) -> dict[str, Any]:
        """Return all of it for JSON."""
        return {
            "format": 5,
            "robot": self.start.robot,
            "logs": self.logs,
            "notes": self.notes,
            "misfits": self.misfits,
            "estimates": {name: estimate.report() for name, estimate in self.estimates.items()},
            "fits": {
                source: {"stretches": len(fitted.stretches)}
                | {what: vars(r) for what, r in fitted.residuals.items()}
                for source, fitted in self.fits.items()
            },
        }

    def save(self, folder: Path) -> None:
        """Write identify.json and robot.toml, which names a model of the user's where it is."""
        made = robot_file_writer.changes(self.estimates)
        if model := self.start.settings.model.file:
            made["model", "file"] = json.dumps(Path(model).resolve().as_posix())
        start = robot_files.find_robot_file(self.start.robot).read_text("utf-8")
        write_text(folder / "robot.toml", robot_file_writer.write_changes(start, made, self.logs))
        write_text(
            folder / "identify.json", json.dumps(self.report(), indent=2, allow_nan=False) + "\n"
        )


def identify(
    logs: Sequence[Path | str] | Path | str,
    robot: str = robot_files.DEFAULT_ROBOT,
    model: str | None = None,
) -> IdentificationResult:
    """Identify a robot from its logs.

    Args:
        logs: CSV or Parquet files, or one; see docs/identify.md.
        robot: Name or file of the robot to start from: its wheels' geometry, and what is believed
            of it.
        model: Its MJCF, which decides geometry and masses. [the robot's file's]

    Raises:
        OmniError: A log cannot be what it says, or holds too little.
    """
    paths = [logs] if isinstance(logs, Path | str) else logs
    start = load_scenario("rect", robot=robot, model=model or {})
    return identify_logs([log for path in paths for log in read(path)], start)


def identify_logs(logs: Sequence[RobotLog], start: Scenario) -> IdentificationResult:
    """Identify a robot from logs that were read, and the scenario with the start robot."""
    result = IdentificationResult(start, [log.name for log in logs])
    for source in ("wheels", "commands"):
        if driven := [log for log in logs if source in log.inputs]:
            _add_fit(result, source, driven)
    return result


def _add_fit(result: IdentificationResult, source: str, logs: Sequence[RobotLog]) -> None:
    """Fit the law to one kind of inputs and add what that tells.

    If wheels told creep and drag, these are not fitted to commands again.

    Raises:
        OmniError: Wheels or axes are not those of this robot, or there is too little.
    """
    settings, by_wheels = result.start.settings, source == "wheels"
    body, geometry, inputs, twists, delays = (
        Body.of(settings),
        settings.wheels.kinematics,
        [],
        [],
        [],
    )
    for log in logs:
        inputs.append(log.inputs[source])
        twist = log_checks.wheel_twists(log, geometry) if by_wheels else inputs[-1]
        delays.append(log_checks.starting_delay(log, twist, source, geometry))
        if not by_wheels and not log.in_body:
            known = np.isfinite(log.pose[:, 2])
            twist = world_to_body(twist, np.interp(log.time, log.time[known], log.pose[known, 2]))
        twists.append(twist)
    stretches = cut(logs, inputs, by_wheels)
    lacks = find_lacks(twists, stretches.period)
    if "motion" in lacks:
        result.notes.append(f"{source}: the robot stands; nothing is told of its motion")
        return
    start = body.parameters(settings, by_wheels) | {LATE: float(np.median(delays))}
    if by_wheels:
        free = [LATE, "scale", "arm", "compass_rad"]
    else:
        free = [LATE, "scale", "give_s", "friction_m_s", "compass_rad"] + ["turn_rate_gain"] * (
            "turning" not in lacks
        )
        start[LATE] = max(start[LATE] - 2 * start["give_s"] / len(body.along), 0.01)
    rolled = result.fits.get("wheels")
    if rolled and "creep" in rolled.free:
        start |= {name: rolled.parameters[name] for name in CONTACTS}
        start["arm"] = rolled.parameters["arm"] / rolled.parameters["scale"]
    elif "creep" not in lacks:
        free += CONTACTS
    else:
        start |= dict.fromkeys(CONTACTS, 0.0)
    fitted = fit_usual(body, stretches, start, free)
    if odd := len(stretches) - len(fitted.stretches):
        result.notes.append(
            f"{source}: {odd} of {len(stretches)} stretches with far larger residuals are left out; "
            "wheels that slide, a push, or a camera's mistake"
        )
    if by_wheels and "creep" in free:
        fitted = _believe_radius(fitted, result.notes)
    result.fits[source] = fitted
    result.estimates |= {f"{source}.{e.name}": e for e in estimates(fitted, settings, lacks)}


def _believe_radius(fitted: Fit, notes: list[str]) -> Fit:
    """Condition a fit on the radius of the robot's file, unless the data contradict it.

    Drag that is pulled through creep takes a share of the speed, as a smaller radius does; data
    know their sum well.
    """
    at = fitted.free.index("scale")
    parameters, scale, variance = (
        fitted.parameters,
        fitted.parameters["scale"],
        fitted.covariance[at, at],
    )
    if abs(scale - 1) > max(SURE * variance**0.5, OTHER_RADIUS):
        off = f"{100 * (scale - 1):+.1f} +- {100 * variance**0.5:.1f} %"
        notes.append(f"wheels: their radius is not that of the robot's file: {off}")
        return fitted
    gain = fitted.covariance[at] / (variance + RADIUS_SHARE**2)
    parameters = parameters | {
        name: float(parameters[name] + g * (ROLLS - scale))
        for name, g in zip(fitted.free, gain, strict=True)
    }
    covariance = fitted.covariance - np.outer(gain, fitted.covariance[at])
    return replace(fitted, covariance=covariance, parameters=parameters)
