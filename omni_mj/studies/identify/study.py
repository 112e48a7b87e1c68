"""The whole of it: logs in, numbers of the robot out, with what they predict and what the data cannot tell."""

import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from omni_control.errors import OmniError
from omni_control.kinematics import Array
from omni_mj.measure.table import DASH, Table, text
from omni_mj.scenarios import robots
from omni_mj.scenarios.scenario import scenario
from omni_mj.scenarios.settings import PERIOD_S, Settings
from omni_mj.studies.identify import axes, law, robot_file, wheels
from omni_mj.studies.identify.findings import DRIVES_M_S, TURNS_RAD_S, Estimate, estimates
from omni_mj.studies.identify.fit import Fit, fit
from omni_mj.studies.identify.logs import Log, read
from omni_mj.studies.identify.predict import Prediction, predict
from omni_mj.studies.identify.segments import SEGMENT_S, Segments, cut

LEAST_STRETCHES = 4
ODD, MOST_ODD = 3.0, 0.25  # residuals over their median, and share, of stretches that may be left out
OF_WHEELS = ("lag_forward_s", "lag_sideways_s", "friction_m_s")  # that motion has, but not motion by its wheels
PARTS = {("commands", False): "motion by commands", ("commands", True): "turning by commands"} | {
    ("wheels", False): "motion by wheels",
    ("wheels", True): "turning by wheels",
}


@dataclass
class Part:
    """One fit: of motion or turning, to commands or wheels.

    Attributes:
        name: of `PARTS`.
        fitted: to stretches; how many are `stretches`.
        prediction: of those that were held out, or None where there are too few.
    """

    name: str
    fitted: Fit
    stretches: int
    prediction: Prediction | None

    @property
    def unit(self) -> str:
        """Of its residuals."""
        return "rad" if len(self.fitted.names) == len(law.TURNING) else "m"


@dataclass
class Identified:
    """What was found.

    Attributes:
        robot: that it started from, and its file's path.
        logs: names of those that were read.
        estimates: numbers, told or not.
        parts: fits, and what they predict.
        notes: what was seen on the way, a line each.
    """

    robot: str
    logs: list[str]
    settings: Settings
    estimates: list[Estimate] = field(default_factory=list)
    parts: list[Part] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)

    def table(self) -> str:
        """All of it as lines of text."""
        return "\n".join(self._lines())

    def report(self) -> dict[str, Any]:
        """All of it for JSON."""
        found: dict[str, Any] = {"format": 1, "robot": self.robot, "logs": self.logs, "notes": self.notes}
        found["estimates"] = {f"{e.source}.{e.name}": e.report() for e in self.estimates}
        found["fits"] = {part.name: _report(part) for part in self.parts}
        return found

    def save(self, folder: Path) -> None:
        """Write identify.json and robot.toml."""
        (folder / "identify.json").write_text(json.dumps(self.report(), indent=2, allow_nan=False) + "\n", "utf-8")
        start = robots.robot_path(self.robot).read_text("utf-8")
        misfits = [source for source in ("commands", "wheels") if self._misfits(PARTS[source, False])]
        written = robot_file.written(start, robot_file.changes(self.estimates, misfits), self.logs)
        (folder / "robot.toml").write_text(written, "utf-8")

    def _misfits(self, name: str) -> bool:
        return any(part.name == name and part.fitted.misfit for part in self.parts)

    def _lines(self) -> Iterator[str]:
        rows = []
        for e in self.estimates:
            cells = [f"{v:.4g}" for v in (e.value, e.error)] if e.told else [DASH, DASH]
            rows.append([e.title, e.source, e.unit, *cells, f"{e.low:.4g} to {e.high:.4g}" if e.told else DASH])
        headings = ["", "from", "unit", "value", "std. error", "95 % interval"]
        yield text(Table(f"{self.robot}, identified from {', '.join(self.logs)}", headings, rows, 3))
        for part in self.parts:
            f, p, factor = part.fitted, part.prediction, 1e3
            unit = "mm" if part.unit == "m" else "mrad"
            line = f"{part.name}: residuals {factor * f.rms:.2f} {unit}, of which noise {factor * f.noise:.2f} {unit}"
            if p:
                line += (
                    f"; {p.stretches} stretches not fitted to, predicted for 1 s: {factor * p.identified:.1f} {unit}, "
                    f"by start values {factor * p.start:.1f} {unit}"
                )
            yield line
            if f.misfit:
                yield f"misfit: {part.name}: {_misfit(part)}"
        for e in self.estimates:
            if not e.told:
                said = f"{e.title} ({e.source}): {e.why_not}"
                yield f"not identifiable from these data: {said}; what would tell: {e.would_tell}"
        for note in self.notes:
            yield f"note: {note}"


def identify(paths: Sequence[Path | str], robot: str = robots.DEFAULT) -> Identified:
    """Identify a robot from its logs.

    Args:
        paths: CSV or Parquet files; see `omni_mj.studies.identify.logs`.
        robot: name or file of the robot to start from: its wheels' geometry, and what is believed of it.

    Raises:
        OmniError: a log cannot be what it says, or holds too little; a line says what.
    """
    settings = scenario("rect", robot=robot).settings
    logs = [log for path in paths for log in read(Path(path))]
    result = Identified(robot, [log.name for log in logs], settings)
    result.notes += [note for log in logs for note in log.notes]
    if commanded := [log for log in logs if log.command is not None]:
        inputs = [log.command for log in commanded if log.command is not None]
        _source(result, "commands", commanded, inputs, [log.in_body for log in commanded])
    if rolled := [log for log in logs if log.wheels is not None]:
        twists = [wheels.twists(log, settings) for log in rolled]
        _source(result, "wheels", rolled, twists, [True] * len(rolled))
        derived, notes = wheels.derived(result.estimates, settings)
        result.estimates += derived
        result.notes += notes
    return result


def _source(result: Identified, source: str, logs: list[Log], inputs: list[Array], in_body: list[bool]) -> None:
    """Fit motion and turning to one kind of inputs."""
    looks = [
        axes.look(log, given, body, source, -0.25 if source == "wheels" else 0.0)
        for log, given, body in zip(logs, inputs, in_body, strict=True)
    ]
    segments = cut(logs, inputs, in_body)
    if len(segments) < LEAST_STRETCHES:
        raise OmniError(
            f"{len(segments)} stretches of {SEGMENT_S:g} s without a gap are too few to identify anything; "
            f"at least {LEAST_STRETCHES}"
        )
    fixed = OF_WHEELS if source == "wheels" else ()
    believed = _believed(result.settings, source)
    late = float(np.median([look.delay for look in looks]))
    used, held = segments.held_out()
    speed = np.sqrt((np.abs(segments.inputs) ** 2).mean())
    if speed > DRIVES_M_S / 2:
        start = believed.copy()
        start[0] = late - (0.0 if source == "wheels" else min(late, believed[5]))
        _part(result, PARTS[source, False], source, used, held, believed, start, fixed)
    else:
        result.notes.append(f"{source}: {speed:.2f} m/s (rms) only; nothing is told of motion along the axes")
    rate = float(np.sqrt((segments.turns**2).mean()))
    if rate > TURNS_RAD_S:
        turning = np.array([believed[0], 1.0, believed[5]])
        start = np.array([max(late - believed[5], 0.0) if source == "commands" else late, 1.0, believed[5]])
        which = ("lag_turning_s",) if source == "wheels" else ()
        _part(result, PARTS[source, True], source, used, held, turning, start, which)
    else:
        result.notes.append(
            f"{source}: {rate:.2f} rad/s (rms) only; nothing is told of turning; turns at 4 to 8 rad/s do"
        )


def _part(
    result: Identified,
    name: str,
    source: str,
    used: Segments,
    held: Segments,
    believed: Array,
    start: Array,
    fixed: tuple[str, ...],
) -> None:
    turning = len(start) == len(law.TURNING)
    fitted = fit(used, start, fixed, turning)
    usual = fitted.each <= ODD * np.median(fitted.each)
    if not usual.all() and usual.mean() >= 1 - MOST_ODD and usual.sum() >= LEAST_STRETCHES:
        odd = ", ".join(f"{result.logs[log]} at {t:.1f} s" for log, t in _where(used.some(~usual))[:4])
        result.notes.append(
            f"{name}: {(~usual).sum()} of {len(used)} stretches with residuals of over {ODD:g} times the median are "
            f"left out: {odd}{', ...' if (~usual).sum() > 4 else ''}; wheels that slide, a push, or a camera's mistake"
        )
        used = used.some(usual)
        fitted = fit(used, fitted.value, fixed, turning)
    prediction = predict(held, believed, fitted.value, turning) if len(held) else None
    result.parts.append(Part(name, fitted, len(used), prediction))
    new = estimates(fitted, used, source, fixed)
    have = {(e.name, e.source): e for e in result.estimates}
    for e in new:  # turning has a latency of its own, which counts where motion tells none
        before = have.get((e.name, e.source))
        if before is None:
            result.estimates.append(e)
        elif e.told and not before.told:
            result.estimates[result.estimates.index(before)] = e


def _where(segments: Segments) -> list[tuple[int, float]]:
    """Number of the log, and the time since its first line, at which each stretch begins."""
    begun = segments.clock[segments.begins[segments.log]]
    return [(int(log), float(t)) for log, t in zip(segments.log, segments.time[:, 0] - begun, strict=True)]


def _believed(settings: Settings, source: str) -> Array:
    """Parameters as the start robot and the defaults have them."""
    control = settings.control
    aside = (settings.wheels.kinematics.matrix[:, :2] ** 2).sum(0)
    creep = control.creep_s2_m * np.array([1.0, aside[0] / aside[1]])
    if source == "wheels":
        return np.array([0.0, 1.0, 1.0, *creep, law.LEAST_LAG_S, law.LEAST_LAG_S, 0.0, 0.0])
    delay = settings.radio.delay_frames * PERIOD_S
    return np.array([delay, 1.0, 1.0, *creep, control.lag_s, control.lag_s, control.drag_m_s, 0.0])


def _misfit(part: Part) -> str:
    f, unit = part.fitted, "mm" if part.unit == "m" else "mrad"
    over = 1e3 * float(np.sqrt(max(f.rms**2 - f.noise**2, 0.0)))
    return (
        f"residuals are not white (autocorrelation {f.memory:.2f} over 5 samples, p {f.unlikely:.1g}): {over:.2f} "
        f"{unit} beside the noise are of something that the law lacks"
    )


def _report(part: Part) -> dict[str, Any]:
    f, p = part.fitted, part.prediction
    return {
        "stretches": part.stretches,
        "samples": f.samples,
        f"residual_rms_{part.unit}": f.rms,
        f"noise_{part.unit}": f.noise,
        "autocorrelation": f.memory,
        "white_p": f.unlikely,
        "misfit": _misfit(part) if f.misfit else None,
        "held_out": p and {"stretches": p.stretches, f"start_{p.unit}": p.start, f"identified_{p.unit}": p.identified},
    }
