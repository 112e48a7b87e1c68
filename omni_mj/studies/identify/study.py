"""The whole of it: logs in, numbers of the robot out, with what they predict and what the data cannot tell."""

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
from omni_mj.studies.identify import jitter, motion, robot_file
from omni_mj.studies.identify.findings import Estimate
from omni_mj.studies.identify.logs import Log, read
from omni_mj.studies.identify.motion import Part
from omni_mj.studies.identify.motors import by_motors


@dataclass
class Identified:
    """What was found.

    Attributes:
        robot: that it started from: a name, or its file's path.
        logs: names of those that were read.
        settings: of the start robot.
        estimates: numbers, told or not.
        parts: fits to wheels and to commands, and what they predict.
        notes: what was seen on the way, a line each.
        odd_motors: those that are not as the others, a line each.
    """

    robot: str
    logs: list[str]
    settings: Settings
    estimates: list[Estimate] = field(default_factory=list)
    parts: list[Part] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    odd_motors: list[str] = field(default_factory=list)

    def __getitem__(self, name: str) -> Estimate:
        """The estimate of a name, such as `wheels.creep_stiffness` or `commands.latency_s`."""
        return {f"{e.source}.{e.name}": e for e in self.estimates}[name]

    @property
    def misfits(self) -> list[str]:
        """What the law does not predict as it should, a line each."""
        return [f"motion by {part.source}: {says}" for part in self.parts for says in _misfits(part)] + self.odd_motors

    def table(self) -> str:
        """All of it as lines of text."""
        return "\n".join(self._lines())

    def report(self) -> dict[str, Any]:
        """All of it for JSON."""
        found: dict[str, Any] = {"format": 3, "robot": self.robot, "logs": self.logs, "notes": self.notes}
        found["estimates"] = {f"{e.source}.{e.name}": e.report() for e in self.estimates}
        found["fits"] = {part.source: _report(part) for part in self.parts}
        found["odd_motors"] = self.odd_motors
        return found

    def save(self, folder: Path, file: Path | None = None) -> None:
        """Write identify.json and robot.toml; of a model of the user's, copies beside them, which robot.toml names.

        A `file` beside the folder gets the robot too.
        """
        start = robots.robot_path(self.robot).read_text("utf-8")
        misfits = [part.source for part in self.parts if part.fitted.misfit]
        made = robot_file.changes(self.estimates, misfits)
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
            cells = [f"{v:.4g}" for v in (e.value, e.error)] if e.told else [DASH, DASH]
            rows.append([e.title, e.source, e.unit, *cells, f"{e.low:.4g} to {e.high:.4g}" if e.told else DASH])
        headings = ["", "from", "unit", "value", "std. error", "95 % interval"]
        yield text(Table(f"{self.robot}, identified from {', '.join(self.logs)}", headings, rows, 3))
        for part in self.parts:
            f, p = part.fitted, part.prediction
            yield (
                f"motion by {part.source}: residuals {1e3 * f.position.rms:.2f} mm and {1e3 * f.heading.rms:.1f} mrad, "
                f"of which noise {1e3 * f.position.noise:.2f} mm and {1e3 * f.heading.noise:.1f} mrad"
            )
            if p:
                yield (
                    f"motion by {part.source}: {p.stretches} stretches not fitted to are predicted within "
                    f"{1e3 * p.identified:.1f} mm and {1e3 * p.identified_rad:.1f} mrad, by start values "
                    f"{1e3 * p.start:.1f} mm and {1e3 * p.start_rad:.1f} mrad"
                )
        for line in self.misfits:
            yield f"misfit: {line}"
        for e in self.estimates:
            if not e.told:
                said = f"{e.title} ({e.source}): {e.why_not}"
                yield f"not identifiable from these data: {said}; what would tell: {e.would_tell}"
        for note in self.notes:
            yield f"note: {note}"


def identify(logs: Sequence[Path | str], robot: str = robots.DEFAULT, model: str | None = None) -> Identified:
    """Identify a robot from its logs.

    Args:
        logs: CSV or Parquet files; see `omni_mj.studies.identify.logs`.
        robot: name or file of the robot to start from: its wheels' geometry, and what is believed of it.
        model: its MJCF, of which geometry and masses then are. [the robot's file's]

    Raises:
        OmniError: a log cannot be what it says, or holds too little; a line says what.
    """
    return of_logs([log for path in logs for log in read(Path(path))], started(robot, model))


def started(robot: str, model: str | None = None) -> Scenario:
    """The scenario whose robot an identification starts from; see `identify`."""
    return scenario("rect", robot=robot, model=model or {})


def of_logs(logs: Sequence[Log], chosen: Scenario) -> Identified:
    """Same, from logs that were read, and the scenario with the robot."""
    settings = chosen.settings
    result = Identified(chosen.robot, [log.name for log in logs], settings)
    result.notes += [note for log in logs for note in log.notes]
    part, rolled = None, None
    if those := [log for log in logs if log.wheels is not None]:
        part = motion.by_wheels(those, settings)
        _add(result, part, "wheels")
        if part and "creep" in part.fitted.names:
            rolled = part.fitted
    estimates, result.odd_motors = by_motors(logs, settings, part)
    result.estimates += estimates
    if those := [log for log in logs if log.command is not None]:
        _add(result, motion.by_commands(those, settings, rolled), "commands")
        result.estimates += jitter.of_stamps(those)
    return result


def _add(result: Identified, part: Part | None, source: str) -> None:
    if part is None:
        result.notes.append(f"{source}: the robot stands; nothing is told of its motion")
        return
    result.parts.append(part)
    result.estimates += part.estimates
    result.notes += part.notes


def _misfits(part: Part) -> Iterator[str]:
    f = part.fitted
    for kind, unit, one in (("positions", "mm", f.position), ("headings", "mrad", f.heading)):
        if one.misfit:
            yield (
                f"{1e3 * one.lasting:.2f} {unit} of the residuals of {kind} last, of robots that the law describes "
                f"{1e3 * one.allowed:g} {unit} at the most (p {one.unlikely:.1g}): it lacks something of this one"
            )
    yield from part.odd


def _report(part: Part) -> dict[str, Any]:
    f, p = part.fitted, part.prediction
    found: dict[str, Any] = {"stretches": len(part.segments), "samples": f.samples}
    for unit, one in (("m", f.position), ("rad", f.heading)):
        found |= {f"residual_rms_{unit}": one.rms, f"noise_{unit}": one.noise}
        found |= {f"lasting_{unit}": one.lasting, f"allowed_{unit}": one.allowed, f"p_{unit}": one.unlikely}
    found["misfit"] = list(_misfits(part)) or None
    found["held_out"] = p and {
        "stretches": p.stretches,
        "start_m": p.start,
        "identified_m": p.identified,
        "start_rad": p.start_rad,
        "identified_rad": p.identified_rad,
    }
    return found
