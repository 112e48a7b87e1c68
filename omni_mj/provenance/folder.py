"""Reads back what a folder says was run, from copies that are what they were."""

import json
import os
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from omni_control.errors import OmniError
from omni_mj.files import read_json
from omni_mj.measure import reading
from omni_mj.measure.limits import flat
from omni_mj.measure.summary import UNFINISHED
from omni_mj.provenance import here
from omni_mj.provenance.record import FILE, FORMAT, IDENTIFIED, SOURCES
from omni_mj.robots import builtin
from omni_mj.scenarios import robots, scenario
from omni_mj.scenarios.checking import in_one
from omni_mj.scenarios.scenario import Scenario

PARTS = ("estimates", "fits")  # of identify.json; the rest are names and notes
LIVE = ("drive", "serve")  # commands that depend on a world outside, which a folder does not hold


class Folder:
    """That of a run, comparison or study.

    Args:
        path: where it is now.

    Attributes:
        path: as given.
        summary: what summary.json holds, or identify.json.
        record: what provenance.json holds.

    Raises:
        OmniError: there is no run, one that was live, none that ended, or none that says what it ran.
    """

    def __init__(self, path: Path) -> None:
        self.path, self.record = path, _record(path)
        study = self.record["study"]
        if study in LIVE:
            raise OmniError(
                f"{path} is of omni-mj {study}, which was live and is not repeated: it depends on packets, and on when"
                " they came, which the folder does not hold"
            )
        name = f"{IDENTIFIED}.json" if study == IDENTIFIED else "summary.json"
        if not (path / name).exists():
            raise OmniError(f"the run in {path} left no {name}: it was killed, or goes on; nothing to compare with")
        self.summary = read_json(path / name) if study == IDENTIFIED else reading.read(path)
        if self.summary.get("stopped") == UNFINISHED and not any(
            entry["frames"] for entry in self.summary["scenarios"].values()
        ):
            raise OmniError(f"the run in {path} is {UNFINISHED}; nothing to compare with")

    @property
    def several(self) -> bool:
        """Whether it is of several scenarios."""
        return len(self.summary["scenarios"]) > 1

    def trajectory(self, name: str) -> Path:
        """Where a scenario's frames are, if they were kept."""
        return self.path / (f"trajectories/{name}.parquet" if self.several else "trajectory.parquet")

    def copy(self, into: Path) -> None:
        """Copy what is the user's own to another folder, from which it can be run: what was run, and nothing else.

        Raises:
            OmniError: a file is missing, or is not what it was; a line for each.
        """
        errors = [str(line) for line in self.record.get("missing", [])]
        for what, entry in self._files():
            try:
                data = self._checked(what, entry)
            except OmniError as error:
                errors.append(str(error))
                continue
            target = into / entry["file"]
            target.parent.mkdir(parents=True, exist_ok=True)
            target.write_bytes(data)
        in_one(errors)

    def scenario(self, name: str, copies: Path) -> Scenario:
        """A scenario as it was run, made of the copies.

        Raises:
            OmniError: its file is missing or not what was run, or this version cannot run it; a line for each.
        """
        file = self.path / (f"scenarios/{name}.toml" if self.several else "scenario.toml")
        entry = self.summary["scenarios"][name]
        if name not in self.record["scenarios"]:
            raise OmniError(f"{self.path / FILE} says nothing of the scenario {name!r}")
        chosen = self._loaded(file, name, copies, {"seed": entry["seeds"][0], "seeds": len(entry["seeds"])})
        ours, theirs = dict(flat(json.loads(json.dumps(chosen.settings.plain())))), dict(flat(entry["settings"]))
        wrong = [key for key in {**ours, **theirs} if ours.get(key, self) != theirs.get(key, self)]
        if wrong := [key for key in wrong if key != "model.file"]:
            raise OmniError(f"{file} is not what was run: summary.json has another value of {', '.join(wrong)}")
        return chosen

    def asked(self, text: str, name: str, copies: Path) -> Scenario:
        """A scenario that a study was asked for, as TOML, made of the copies of that of its name."""
        file = copies / f"{name}.toml"
        file.write_text(text, encoding="utf-8")
        return self._loaded(file, name, copies, {})

    def _loaded(self, file: Path, name: str, copies: Path, head: Mapping[str, Any]) -> Scenario:
        said = self.record["scenarios"][name]
        named = {
            "controllers": [_kind(entry, copies) for entry in said["controllers"]],
            "plant": _kind(said["plant"], copies),
            "robot": said["robot"]["name"] if _is_here(said["robot"]) else str(copies / said["robot"]["file"]),
        }
        model = said.get("model")
        changes = [f"model.file={json.dumps(str(copies / model['file']))}"] if model else []
        try:
            return scenario.load(str(file), changes, named | dict(head))
        except OmniError as error:
            text = str(error).replace(f"{copies}{os.sep}", f"{self.path}{os.sep}")  # not where it was copied to
            lines = [f"{file} cannot be run here: {line}" for line in text.splitlines()]
            raise OmniError("\n".join([*lines, *here.differences(self.record)])) from None

    def _files(self) -> Iterator[tuple[str, Mapping[str, Any]]]:
        """What each file that was kept is, in words, and its entry."""
        for said in self.record["scenarios"].values():
            yield "the robot", said["robot"]
            if model := said.get("model"):
                yield f"the model {model['name']}", model
                yield from ((f"a part of the model {model['name']}", part) for part in model.get("parts", []))
            if "file" in said["plant"]:
                yield f"the plant {said['plant']['name']}", said["plant"]
            yield from ((f"the controller {entry['name']}", entry) for entry in said["controllers"] if "file" in entry)
        yield from ((f"the log {entry['name']}", entry) for entry in self.record.get("data", []))
        yield from (("a module that a user's file imports", entry) for entry in self.record["modules"])

    def _checked(self, what: str, entry: Mapping[str, Any]) -> bytes:
        if "why" in entry:
            raise OmniError(f"{self.path}: {entry['why']}")
        path, parts = self.path / entry["file"], Path(entry["file"]).parts
        if parts[:1] != (SOURCES,) or ".." in parts:
            raise OmniError(f"{self.path / FILE} names a file outside of {SOURCES}/: {entry['file']}")
        try:
            data = path.read_bytes()
        except OSError as error:
            raise OmniError(f"{path}, {what}, cannot be read: {error.strerror}") from None
        if (found := here.digest(data)) != entry["sha256"]:
            raise OmniError(
                f"{path}, {what}, is not what was run: its SHA-256 was {entry['sha256'][:12]}..., is {found[:12]}..."
            )
        return data


@contextmanager
def importable(folder: Path) -> Iterator[None]:
    """Within it, modules are imported from a folder before any other."""
    names = {path.stem if path.suffix == ".py" else path.name for path in folder.glob("*")}

    def loaded() -> list[str]:
        return [name for name in sys.modules if name.partition(".")[0] in names]

    before = {name: sys.modules.pop(name) for name in loaded()}
    sys.path.insert(0, str(folder))
    try:
        yield
    finally:
        sys.path.remove(str(folder))
        for name in loaded():
            del sys.modules[name]
        sys.modules.update(before)


def _record(path: Path) -> dict[str, Any]:
    if not (path / FILE).exists():
        if (path / "summary.json").exists():
            old = "an older version of omni-mj wrote it, or Python without the command line"
            raise OmniError(f"{path} does not say what was run, it has no {FILE}: {old}; make the run again")
        raise OmniError(f"{path} holds no run; give the folder that omni-mj run --out FOLDER leaves")
    record = read_json(path / FILE)
    if record.get("format") != FORMAT:
        raise OmniError(
            f"{path / FILE} is of format {record.get('format')!r}; this version of omni-mj reads format {FORMAT}"
        )
    return record


def _kind(entry: Mapping[str, Any], copies: Path) -> str:
    """How a controller or plant is named here: one of the user's own by its copy."""
    return f"{copies / entry['file']}:{entry['class']}" if "file" in entry else entry["name"]


def _is_here(robot: Mapping[str, Any]) -> bool:
    """Whether a robot that came with the package does so here, with the same file."""
    if robot["name"] not in builtin():
        return False
    return here.digest(robots.robot_path(robot["name"]).read_bytes()) == robot["sha256"]
