"""Identify the parameters of a robot from its logs.

`robot_logs` reads the files, `log_cutting` cuts out poses that the inputs do not explain, and
`log_checks` rejects logs of another robot or in other units. `log_segments` cuts logs into
segments, `slip_dynamics` predicts the motion in them, `parameter_fit` fits it, and
`cross_validation` tests the fit. `derived_parameters` computes the estimates, and
`robot_file_writer` writes them into a robot's file.
"""

import json
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from omni_control.arguments import check_types
from omni_control.kinematics import Array, Kinematics, world_to_body
from omni_mj.config import robot_files, toml_files
from omni_mj.config.scenario import Scenario, load_scenario
from omni_mj.io.atomic_files import encode_json, write_files
from omni_mj.results.text_table import DASH, Table, format_table
from omni_mj.studies.identify import robot_file_writer
from omni_mj.studies.identify.cross_validation import Prediction, cross_validate
from omni_mj.studies.identify.derived_parameters import (
    Estimate,
    estimate_parameters,
    find_missing_excitation,
)
from omni_mj.studies.identify.log_checks import LoggedMotion, check_and_estimate_delay
from omni_mj.studies.identify.log_cutting import discard_unexplained_poses
from omni_mj.studies.identify.log_segments import cut_segments
from omni_mj.studies.identify.parameter_fit import RANGES, Fit, Prior, fit_parameters
from omni_mj.studies.identify.robot_logs import RobotLog, read_logs
from omni_mj.studies.identify.slip_dynamics import DEAD_TIME, Parameters, RobotDynamics

# The radius of the file is rejected if the fitted one deviates by more than both limits: a fraction
# of the radius, and a number of standard errors.
MAX_RADIUS_DEVIATION, MAX_RADIUS_SIGMAS = 0.025, 3.0
# Rolling radius over the radius of the file, with compressed rubber, and its standard error, also
# if the radius is not trusted
ROLLING_RADIUS, RADIUS_ERROR, UNKNOWN_RADIUS_ERROR = 0.9988, 0.002, 1.0
CONTACT_PARAMETERS = (
    "creep_compliance",
    "rolling_resistance",
    "roller_friction",
    "slope_x_m_s2",
    "slope_y_m_s2",
)
# Parameters that are always fitted, by source of the inputs
FREE_PARAMETERS = {
    "wheels": (DEAD_TIME, "scale", "arm", "heading_offset_rad"),
    "commands": (DEAD_TIME, "scale", "compliance_s", "dry_friction_m_s", "heading_offset_rad"),
}
MIN_DEAD_TIME_S = 0.01  # smallest initial value of a fit to commands


@dataclass
class IdentificationResult:
    """Result of an identification.

    Attributes:
        start: Scenario with the start robot.
        logs: Names of the logs.
        estimates: All estimates, identified or not. Keys are source and name, such as
            "wheels.creep_stiffness".
        fits: Fits by source of the inputs: "wheels" and "commands".
        predictions: Tests of the fits, by source; None without enough motion.
        remarks: Remarks for the user, one line each.
        has_coarse_logs: Whether some of them are about coarse times or inputs of a log.
    """

    start: Scenario
    logs: list[str]
    estimates: dict[str, Estimate] = field(default_factory=dict)
    fits: dict[str, Fit] = field(default_factory=dict)
    predictions: dict[str, Prediction | None] = field(default_factory=dict)
    remarks: list[str] = field(default_factory=list)
    has_coarse_logs: bool = False

    @property
    def misfits(self) -> list[str]:
        """Messages about residuals that the model cannot explain, one line each."""
        coarse = ", or the log is too coarse (see the notes)" if self.has_coarse_logs else ""
        return [
            f"motion by {source}: persistent residuals of {quantity} are "
            f"{1e3 * residuals.persistent:.2f} (mm or mrad), but at most "
            f"{1e3 * residuals.allowed:g} for robots that the model describes: it lacks a property "
            f"of this one{coarse}"
            for source, fit in self.fits.items()
            for quantity, residuals in fit.residuals.items()
            if residuals.misfit
        ]

    def table(self) -> str:
        """Return estimates, residuals and remarks as lines of text."""
        lines = [f"{self.start.robot}, identified from {', '.join(self.logs)}"]
        headings = ["", "unit", "value", "std. error", "95 % interval"]
        for source in dict.fromkeys(estimate.source for estimate in self.estimates.values()):
            rows = [_estimate_row(e) for e in self.estimates.values() if e.source == source]
            lines += [format_table(Table(f"by {source}", headings, rows, 2)), ""]
        lines += [
            f"motion by {source}: residuals of {quantity} {1e3 * residuals.rms:.2f} {unit}, "
            f"noise alone {1e3 * residuals.noise:.2f} {unit}"
            for source, fit in self.fits.items()
            for (quantity, residuals), unit in zip(
                fit.residuals.items(), ("mm", "mrad"), strict=True
            )
        ]
        lines += [
            self._describe_prediction(source, prediction)
            for source, prediction in self.predictions.items()
        ]
        lines += [f"misfit: {line}" for line in self.misfits]
        if any(e.is_identified and e.is_weak for e in self.estimates.values()):
            lines.append(
                "weak: a 95 % interval is wide; robot.toml has weak numbers only of fits that "
                f"predict better than {self.start.robot}"
            )
        lines += [
            f"not identifiable from these data: {e.info.title} ({e.source}): {e.why_not}"
            for e in self.estimates.values()
            if not e.is_identified
        ]
        return "\n".join(lines + [f"note: {remark}" for remark in self.remarks])

    def _describe_prediction(self, source: str, prediction: Prediction | None) -> str:
        """Return a line about the test of a fit."""
        if prediction is None:
            return f"motion by {source}: not tested, the robot hardly moves in these data"
        return (
            f"motion by {source}: {prediction.n_segments} segments with motion, each left out of "
            f"the fit, are predicted within {1e3 * prediction.fitted_m:.2f} mm, by "
            f"{self.start.robot} within {1e3 * prediction.start_m:.2f} mm"
        )

    def report(self) -> dict[str, Any]:
        """Return the content of identify.json."""
        fits = {
            source: {"segments": len(fit.problem.segments)}
            | {quantity: vars(residuals) for quantity, residuals in fit.residuals.items()}
            for source, fit in self.fits.items()
        }
        return {
            "format": 8,
            "robot": self.start.robot,
            "logs": self.logs,
            "remarks": self.remarks,
            "misfits": self.misfits,
            "estimates": {name: estimate.report() for name, estimate in self.estimates.items()},
            "fits": fits,
            "predictions": {
                source: prediction and vars(prediction)
                for source, prediction in self.predictions.items()
            },
        }

    def save(self, folder: Path) -> None:
        """Write robot.toml and identify.json, and copies of a custom model's files to model/.

        The last file is identify.json, so a folder that has it is complete.
        """
        report = encode_json(self.report()).encode()
        trusted_sources = [
            source
            for source, prediction in self.predictions.items()
            if prediction and prediction.fitted_m < prediction.start_m
        ]
        changes = robot_file_writer.list_changes(self.estimates, trusted_sources)
        files = dict[str, bytes]()
        if model := self.start.settings.model.file:
            contents = robot_files.read_model_files(Path(model))
            files |= {f"model/{name}": content for name, content in contents.items()}
            changes["model.file"] = json.dumps(next(iter(files)))
        start = toml_files.decode_utf8(robot_files.find_robot_file(self.start.robot).read_bytes())
        robot_file = robot_file_writer.apply_changes(start, changes, self.logs)
        write_files(folder, files | {"robot.toml": robot_file.encode(), "identify.json": report})


@check_types
def identify(
    logs: Sequence[Path | str] | Path | str,
    robot: str = robot_files.DEFAULT_ROBOT,
    model: str | None = None,
) -> IdentificationResult:
    """Identify a robot from its logs.

    Args:
        logs: CSV or Parquet files, or one file; see docs/how-to/identify-a-robot.md.
        robot: Name or file of the start robot, which sets the geometry of the wheels and the
            initial parameters.
        model: MJCF file of the robot, which sets geometry and masses. Default: the robot file's.

    Raises:
        OmniError: A log cannot be read, is too short, or fails a check of `log_checks`.
    """
    paths = [logs] if isinstance(logs, Path | str) else logs
    start = load_scenario("rect", robot=robot, model=model or {})
    return identify_logs([log for path in paths for log in read_logs(path)], start)


def identify_logs(logs: Sequence[RobotLog], start: Scenario) -> IdentificationResult:
    """Identify a robot from logs, starting with the robot of a scenario."""
    result = IdentificationResult(start, [log.name for log in logs])
    geometry = start.settings.wheels.kinematics
    explained_logs = []
    for log in logs:
        explained_log, remarks = discard_unexplained_poses(log, geometry)
        explained_logs.append(explained_log)
        result.remarks += [*log.remarks, *remarks]
        result.has_coarse_logs |= bool(log.remarks)
    for source in ("wheels", "commands"):
        if logs_with_source := [log for log in explained_logs if source in log.inputs]:
            _add_fit(result, source, logs_with_source)
    return result


def _add_fit(result: IdentificationResult, source: str, logs: Sequence[RobotLog]) -> None:
    """Fit the model to one source of inputs, and add the estimates to the result.

    Raises:
        OmniError: A log fails a check of `log_checks`, or the logs are too short.
    """
    settings, by_wheels = result.start.settings, source == "wheels"
    dynamics = RobotDynamics(settings)
    twists, delays = _check_logs(logs, source, settings.wheels.kinematics)
    segments = cut_segments(logs, source)
    missing_excitation = find_missing_excitation(
        twists, [float(np.median(np.diff(log.time))) for log in logs]
    )
    if "motion" in missing_excitation:
        result.remarks.append(
            f"{source}: the robot does not move; nothing is identified from its motion"
        )
        return
    nominal = dynamics.nominal_parameters(by_wheels)
    start = nominal | {DEAD_TIME: float(np.median(delays))}
    if not by_wheels:  # the delay of commands is dead time plus lag
        lag = 2 * start["compliance_s"] / len(dynamics.rim_directions)
        start[DEAD_TIME] = max(start[DEAD_TIME] - lag, MIN_DEAD_TIME_S)
    free = list(FREE_PARAMETERS[source])
    if not by_wheels and "turning" not in missing_excitation:
        free.append("turn_rate_gain")
    free += _prepare_contacts(result.fits.get("wheels"), start, "creep" in missing_excitation)
    fit = fit_parameters(dynamics, segments, start, free)
    if n_outliers := len(segments) - len(fit.problem.segments):
        result.remarks.append(
            f"{source}: {n_outliers} of {len(segments)} segments with far larger residuals are "
            "left out; causes may be sliding wheels, a collision, or a false detection"
        )
    prior = _choose_prior(result, fit, nominal)
    result.predictions[source] = cross_validate(fit, prior, nominal)
    result.fits[source] = fit = fit.with_prior(prior)
    for estimate in estimate_parameters(fit, prior, missing_excitation):
        result.estimates[f"{source}.{estimate.name}"] = estimate


def _check_logs(
    logs: Sequence[RobotLog], source: str, geometry: Kinematics
) -> tuple[list[Array], list[float]]:
    """Return the twists of each log, body frame, (F, 3), and the delays of the inputs, s.

    Raises:
        OmniError: A log fails a check of `log_checks`.
    """
    twists, delays = [], []
    for log in logs:
        motion = LoggedMotion.from_log(log, source, geometry)
        delays.append(check_and_estimate_delay(log, motion, geometry))
        twist = motion.twist
        if not motion.in_body:
            is_known = np.isfinite(log.pose[:, 2])
            heading = np.interp(log.time, log.time[is_known], log.pose[is_known, 2])
            twist = world_to_body(twist, heading)
        twists.append(twist)
    return twists, delays


def _prepare_contacts(
    wheel_fit: Fit | None, start: Parameters, lacks_creep: bool
) -> tuple[str, ...]:
    """Set the initial contact parameters, and return the names of those to fit.

    If a fit to wheels identified creep and drag, they are not fitted to commands again.

    Args:
        wheel_fit: Fit to wheels, or None.
        start: Initial parameters; the contact parameters are changed in place.
        lacks_creep: Whether the motion does not excite creep.
    """
    if wheel_fit and "creep_compliance" in wheel_fit.problem.free:
        fitted = wheel_fit.parameters
        start |= {name: fitted[name] for name in CONTACT_PARAMETERS}
        start["arm"] = fitted["arm"] / fitted["scale"]
        return ()
    if not lacks_creep:
        return CONTACT_PARAMETERS
    start |= dict.fromkeys(CONTACT_PARAMETERS, 0.0)
    return ()


def _choose_prior(result: IdentificationResult, fit: Fit, nominal: Parameters) -> Prior:
    """Return the prior of a fit: the values of the robot's file, and a level carpet.

    Drag and a smaller radius both lower the speed, and the data cannot tell them apart well. So
    the radius of the file is trusted. If the data contradict it, the result gets a remark instead.
    """
    mean = np.array([nominal[name] for name in fit.problem.free])
    error = np.array([RANGES[name].prior_error for name in fit.problem.free])
    if fit.problem.segments.source == "commands":
        return Prior(mean, error)
    i = fit.problem.free.index("scale")
    mean[i], error[i] = ROLLING_RADIUS, UNKNOWN_RADIUS_ERROR
    if "creep_compliance" in fit.problem.free:
        deviation = fit.parameters["scale"] - 1
        sigma = fit.misfit_ratio * fit.covariance[i, i] ** 0.5
        if abs(deviation) > max(MAX_RADIUS_SIGMAS * sigma, MAX_RADIUS_DEVIATION):
            result.remarks.append(
                "wheels: their radius is not that of the robot's file: "
                f"{100 * deviation:+.1f} +- {100 * sigma:.1f} %"
            )
        else:
            error[i] = RADIUS_ERROR
    return Prior(mean, error)


def _estimate_row(estimate: Estimate) -> list[str]:
    """Return the cells of an estimate in the table."""
    info = estimate.info
    if not estimate.is_identified:
        return [info.title, info.unit, DASH, DASH, DASH]
    value_and_error = [f"{estimate.value:.4g}", f"{estimate.standard_error:.2g}"]
    interval = f"{estimate.low:.4g} to {estimate.high:.4g}"
    title = f"{info.title} (weak)" if estimate.is_weak else info.title
    return [title, info.unit, *value_and_error, interval]
