"""Reads back what a folder says was run, from copies that are what they were."""

import json
import os
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from omni_control.errors import OmniError
from omni_mj.files import text_of
from omni_mj.measure import reading
from omni_mj.measure.summary import UNFINISHED
from omni_mj.provenance import here, identified
from omni_mj.provenance.record import FILE, FORMAT, SOURCES
from omni_mj.robots import builtin
from omni_mj.scenarios import robots, scenario, toml_files
from omni_mj.scenarios.checking import in_one
from omni_mj.scenarios.scenario import Scenario

PARTS = {
    "study": str,
    "given": dict,
    "frames_kept": bool,
    "scenarios": dict,
    "modules": list,
    "versions": dict,
    "source": dict,
}
LIVE = {  # studies that hang together with the world outside, and why they cannot be run again
    "drive": "what robots outside of this program did, and when packets came, cannot be had again",
    "serve": "what its robots did came of a client's packets and of when they came, and the folder does not hold them;"
    " in lockstep, a client that sends the same packets gets the same bytes",
}


class Folder:
    """That of a run or comparison.

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
        self.path = path
        self.record = _record(path)
        study = self.record["study"]
        if why := LIVE.get(study):
            raise OmniError(f"{path} is of omni-mj {study}, which was live and is not repeated: {why}")
        of_logs = study == identified.STUDY
        name = identified.FILE if of_logs else "summary.json"
        if not (path / name).exists():
            raise OmniError(f"the run in {path} left no {name}: it was killed, or goes on; nothing to compare with")
        self.summary = identified.read(path) if of_logs else reading.read(path)
        if self.summary.get("stopped") == UNFINISHED and not any(
            each["frames"] for each in self.summary["scenarios"].values()
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
            if "why" in entry:
                errors.append(f"{self.path}: {entry['why']}")
                continue
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
        entry, said = self.summary["scenarios"][name], self.record["scenarios"].get(name)
        if said is None:
            raise OmniError(f"{self.path / FILE} says nothing of the scenario {name!r}")
        self._check_settings(file, entry)
        return self.loaded(file, name, copies, {"seed": entry["seeds"][0], "seeds": len(entry["seeds"])})

    def loaded(self, file: Path, name: str, copies: Path, head: Mapping[str, Any] | None = None) -> Scenario:
        """A scenario's file, read with the copies in place of what is the user's own.

        Args:
            file: of the scenario.
            name: under which the record says what it is made of.
            copies: where the user's files are.
            head: fields that replace those in the file.

        Raises:
            OmniError: this version cannot run it; a line for each reason.
        """
        said = self.record["scenarios"][name]
        plant, robot = said["plant"], said["robot"]
        named = {
            "controllers": [_kind(each, copies) for each in said["controllers"]],
            "plant": _kind(plant, copies),
            "robot": robot["name"] if _is_here(robot) else str(copies / robot["file"]),
        }
        mine = said.get("model")
        changes = [f"model.file={json.dumps(str(copies / mine['file']))}"] if mine else []
        try:
            return scenario.load(str(file), changes, named | dict(head or {}))
        except OmniError as error:
            told = str(error).replace(f"{copies}{os.sep}", f"{self.path}{os.sep}")  # not where it was copied to
            lines = [f"{file} cannot be run here: {line}" for line in told.splitlines()]
            raise OmniError("\n".join([*lines, *here.differences(self.record)])) from None

    def _files(self) -> Iterator[tuple[str, Mapping[str, Any]]]:
        """What each file that was kept is, in words, and its entry."""
        for said in self.record["scenarios"].values():
            yield "the robot", said["robot"]
            if mine := said.get("model"):
                yield f"the model {mine['name']}", mine
                yield from ((f"a part of the model {mine['name']}", part) for part in mine.get("parts", []))
            if "file" in said["plant"]:
                yield f"the plant {said['plant']['name']}", said["plant"]
            for each in said["controllers"]:
                if "file" in each:
                    yield f"the controller {each['name']}", each
        for each in self.record.get("data", []):
            yield f"the log {each['name']}", each
        for each in self.record["modules"]:
            yield "a module that a user's file imports", each

    def _checked(self, what: str, entry: Mapping[str, Any]) -> bytes:
        path = self.path / entry["file"]
        if not Path(entry["file"]).parts[:1] == (SOURCES,) or ".." in Path(entry["file"]).parts:
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

    def _check_settings(self, file: Path, entry: Mapping[str, Any]) -> None:
        """See that a scenario's file has the settings that the summary says were run."""
        try:
            data = toml_files.parse(text_of(file))
        except OSError as error:
            raise OmniError(f"{file} cannot be read: {error.strerror}") from None
        except ValueError as error:
            raise OmniError(f"{file} is not valid TOML: {' '.join(str(error).split())}") from None
        wrong = []
        for section, values in entry["settings"].items():
            if not isinstance(values, dict):  # the faults
                wrong += [section] if data.get(section, []) != values else []
                continue
            found = data.get(section, {})
            names = dict.fromkeys([*values, *found]) if isinstance(found, dict) else values
            wrong += [f"{section}.{key}" for key in names if not isinstance(found, dict) or _other(key, values, found)]
        if wrong:
            raise OmniError(f"{file} is not what was run: summary.json has another value of {', '.join(wrong)}")


@contextmanager
def importable(folder: Path) -> Iterator[None]:
    """Within it, modules are imported from a folder before any other."""
    names = {path.stem if path.suffix == ".py" else path.name for path in folder.glob("*")}
    ours = [name for name in sys.modules if name.partition(".")[0] in names]
    before = {name: sys.modules.pop(name) for name in ours}
    sys.path.insert(0, str(folder))
    try:
        yield
    finally:
        sys.path.remove(str(folder))
        for name in [name for name in sys.modules if name.partition(".")[0] in names]:
            del sys.modules[name]
        sys.modules.update(before)


def _record(path: Path) -> dict[str, Any]:
    file = path / FILE
    try:
        record = json.loads(text_of(file))
    except FileNotFoundError:
        if (path / "summary.json").exists():
            old = "an older version of omni-mj wrote it, or Python without the command line"
            raise OmniError(f"{path} does not say what was run, it has no {FILE}: {old}; make the run again") from None
        raise OmniError(f"{path} holds no run; give the folder that omni-mj run --out FOLDER leaves") from None
    except OSError as error:
        raise OmniError(f"{file} cannot be read: {error.strerror}") from None
    except (ValueError, RecursionError) as error:
        raise OmniError(f"{file} is not valid JSON: {error}") from None
    if not isinstance(record, dict) or "format" not in record:
        raise OmniError(f"{file} does not say what was run; make the run again")
    if record["format"] != FORMAT:
        raise OmniError(f"{file} is of format {record['format']!r}; this version of omni-mj reads format {FORMAT}")
    wrong = [name for name, kind in PARTS.items() if not isinstance(record.get(name), kind)]
    wrong = wrong or [name for name, said in record["scenarios"].items() if not _whole(said)]
    wrong = wrong or [name for name in ("modules",) if not all(_names_file(each) for each in record[name])]
    if wrong:
        raise OmniError(f"{file} does not say what was run: {', '.join(wrong)} missing or wrong; make the run again")
    return record


def _whole(said: Any) -> bool:
    """Whether a scenario's plant, robot and controllers are there, each with a name and, where it has one, its file."""
    if not isinstance(said, dict) or not isinstance(said.get("controllers"), list):
        return False
    named = [said.get("plant"), said.get("robot"), *said["controllers"]]
    if not all(isinstance(each, dict) and isinstance(each.get("name"), str) for each in named):
        return False
    mine = said.get("model", {"parts": []})
    if not isinstance(mine, dict) or not ("why" in mine or _names_files(mine)):
        return False
    classes = [each for each in (said["plant"], *said["controllers"]) if "file" in each]
    return all(_names_file(each) and "class" in each for each in classes) and _names_file(said["robot"])


def _names_file(entry: Any) -> bool:
    return isinstance(entry, dict) and all(isinstance(entry.get(name), str) for name in ("file", "sha256"))


def _names_files(model: Mapping[str, Any]) -> bool:
    """Whether a model is there with its parts; an empty one is none."""
    parts = model.get("parts")
    whole = "file" not in model or (isinstance(model.get("name"), str) and _names_file(model))
    return whole and isinstance(parts, list) and all(map(_names_file, parts))


def _kind(entry: Mapping[str, Any], copies: Path) -> str:
    """How a controller or plant is named here: one of the user's own by its copy."""
    return f"{copies / entry['file']}:{entry['class']}" if "file" in entry else entry["name"]


def _is_here(robot: Mapping[str, Any]) -> bool:
    """Whether a robot that came with the package does so here, with the same file."""
    if robot["name"] not in builtin():
        return False
    return here.digest(robots.robot_path(robot["name"]).read_bytes()) == robot["sha256"]


def _other(key: str, values: Mapping[str, Any], found: Mapping[str, Any]) -> bool:
    missing = object()
    return values.get(key, missing) != found.get(key, missing)
