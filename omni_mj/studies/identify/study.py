"""The whole identification: logs in, numbers of the robot out, with what they predict and what the data cannot tell."""

import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from omni_mj.files import write
from omni_mj.measure.table import DASH, Table, text
from omni_mj.scenarios import robots
from omni_mj.scenarios.scenario import Scenario, scenario
from omni_mj.scenarios.settings import Settings
from omni_mj.studies.identify import checks, findings, motion, robot_file
from omni_mj.studies.identify.findings import Estimate
from omni_mj.studies.identify.fit import Fit, Residuals
from omni_mj.studies.identify.logs import Log, read
from omni_mj.studies.identify.motion import Part


@dataclass
class Identified:
    """Result of an identification.

    Attributes:
        robot: that it started from: a name, or its file's path; settings: of that.
        logs: names of those that were read.
        estimates: numbers, told or not.
        parts: fits to wheels and to commands.
        notes: a line each.
    """

    robot: str
    logs: list[str]
    settings: Settings
    estimates: list[Estimate] = field(default_factory=list)
    parts: list[Part] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)

    def __getitem__(self, name: str) -> Estimate:
        """Return the estimate of a name, such as `wheels.creep_stiffness` or `commands.latency_s`."""
        return {f"{e.source}.{e.name}": e for e in self.estimates}[name]

    @property
    def misfits(self) -> list[str]:
        """What the law does not predict as it should, a line each."""
        return [f"motion by {part.source}: {says}" for part in self.parts for says in _misfits(part)]

    def table(self) -> str:
        """Return all of it as lines of text."""
        return "\n".join(self._lines())

    def report(self) -> dict[str, Any]:
        """Return all of it for JSON."""
        return {
            "format": 4,
            "robot": self.robot,
            "logs": self.logs,
            "notes": self.notes,
            "estimates": {f"{e.source}.{e.name}": e.report() for e in self.estimates},
            "fits": {part.source: _report(part) for part in self.parts},
        }

    def save(self, folder: Path, file: Path | None = None) -> None:
        """Write identify.json and robot.toml, and copies of a model of the user's, which robot.toml names.

        A `file` beside the folder gets the robot too.
        """
        start = robots.robot_path(self.robot).read_text("utf-8")
        made = robot_file.changes(self.estimates, [part.source for part in self.parts if part.fitted.misfit])
        if model := self.settings.model.file:
            made |= robot_file.with_model(Path(model), folder)
        written = robot_file.written(start, made, self.logs)
        write(folder / "robot.toml", written)
        if file is not None:
            write(file, written.replace(f'"{robot_file.MODEL}/', f'"{folder.name}/{robot_file.MODEL}/'))
        write(folder / "identify.json", json.dumps(self.report(), indent=2, allow_nan=False) + "\n")

    def _lines(self) -> Iterator[str]:
        rows = []
        for e in self.estimates:
            cells = [f"{e.value:.4g}", f"{e.error:.4g}", f"{e.low:.4g} to {e.high:.4g}"] if e.told else [DASH] * 3
            rows.append([e.title, e.source, e.unit, *cells])
        headings = ["", "from", "unit", "value", "std. error", "95 % interval"]
        yield text(Table(f"{self.robot}, identified from {', '.join(self.logs)}", headings, rows, 3))
        for part in self.parts:
            position, heading = part.fitted.position, part.fitted.heading
            yield (
                f"motion by {part.source}: residuals {1e3 * position.rms:.2f} mm and {1e3 * heading.rms:.1f} mrad, "
                f"of which noise {1e3 * position.noise:.2f} mm and {1e3 * heading.noise:.1f} mrad; by start values "
                f"{1e3 * part.before[0]:.2f} mm and {1e3 * part.before[1]:.1f} mrad"
            )
        yield from (f"misfit: {line}" for line in self.misfits)
        for e in self.estimates:
            if not e.told:
                says = f"{e.title} ({e.source}): {e.why_not}; what would tell: {e.would_tell}"
                yield f"not identifiable from these data: {says}"
        yield from (f"note: {note}" for note in self.notes)


def identify(logs: Sequence[Path | str], robot: str = robots.DEFAULT, model: str | None = None) -> Identified:
    """Identify a robot from its logs.

    Args:
        logs: CSV or Parquet files, or game logs; see docs/identify.md.
        robot: name or file of the robot to start from: its wheels' geometry, and what is believed of it.
        model: its MJCF, of which geometry and masses then are. [the robot's file's]

    Raises:
        OmniError: a log cannot be what it says, or holds too little.
    """
    return of_logs([log for path in logs for log in read(Path(path))], started(robot, model))


def started(robot: str, model: str | None = None) -> Scenario:
    """Return the scenario whose robot an identification starts from; see `identify`."""
    return scenario("rect", robot=robot, model=model or {})


def of_logs(logs: Sequence[Log], chosen: Scenario) -> Identified:
    """Identify a robot from logs that were read, and the scenario with the start robot."""
    settings = chosen.settings
    result = Identified(chosen.robot, [log.name for log in logs], settings)
    for log in logs:
        checks.units(log)
        result.notes += log.notes
    rolled = None
    if driven := [log for log in logs if log.wheels is not None]:
        part = motion.by_wheels(driven, settings)
        rolled = _add(result, part, "wheels")
    if commanded := [log for log in logs if log.command is not None]:
        creep = rolled if rolled is not None and "creep" in rolled.names else None
        _add(result, motion.by_commands(commanded, settings, creep), "commands")
        result.estimates += findings.by_stamps(commanded)
    return result


def _add(result: Identified, part: Part | None, source: str) -> Fit | None:
    if part is None:
        result.notes.append(f"{source}: the robot stands; nothing is told of its motion")
        return None
    result.parts.append(part)
    result.estimates += part.estimates
    result.notes += part.notes
    return part.fitted


def _misfits(part: Part) -> Iterator[str]:
    for kind, unit, residuals in _kinds(part):
        if residuals.misfit:
            yield (
                f"{1e3 * residuals.lasting:.2f} m{unit} of the residuals of {kind} last, of robots that the law "
                f"describes {1e3 * residuals.allowed:g} m{unit} at the most: it lacks something of this one"
            )


def _kinds(part: Part) -> tuple[tuple[str, str, Residuals], ...]:
    return ("positions", "m", part.fitted.position), ("headings", "rad", part.fitted.heading)


def _report(part: Part) -> dict[str, Any]:
    report: dict[str, Any] = {"stretches": len(part.fitted.stretches), "samples": part.fitted.stretches.lines.size}
    for _, unit, residuals in _kinds(part):
        report |= {f"residual_rms_{unit}": residuals.rms, f"noise_{unit}": residuals.noise}
        report |= {f"lasting_{unit}": residuals.lasting, f"allowed_{unit}": residuals.allowed}
    report |= {"start_rms_m": part.before[0], "start_rms_rad": part.before[1], "misfit": list(_misfits(part)) or None}
    return report
