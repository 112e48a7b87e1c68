"""Writes down what a run is made of: provenance.json, and copies of what is the user's own in sources/."""

import hashlib
import json
import sys
from collections.abc import Iterable, Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from omni_control import controllers as known_controllers
from omni_control.registry import CONTROLLERS
from omni_mj.files import whole, write
from omni_mj.mjcf.files import copies
from omni_mj.provenance import here, modules
from omni_mj.scenarios import controllers, plants, resolve, robots, user_files
from omni_mj.scenarios.scenario import Scenario

FORMAT = 1
FILE, SOURCES = "provenance.json", "sources"  # also in `omni_mj.cli.folders`, which must not import what this does
DATA, LARGEST_BYTES = "data", 100_000_000  # folder in that of the sources, for logs and the like; largest that is kept
ASKED = "scenarios"  # in `given` of a study: the scenarios that it was asked for, as TOML by name
IDENTIFIED = "identify"  # the study that leaves identify.json
MODULES = "modules"  # folder in that of the sources, for modules that a user's files import


def save(
    folder: Path,
    study: str,
    command: str | None,
    scenarios: Sequence[Scenario],
    frames: bool = True,
    given: Mapping[str, Any] | None = None,
    missing: Sequence[str] = (),
    data: Sequence[Path] = (),
) -> None:
    """Write what is about to be run.

    Args:
        folder: of the run, which is there.
        study: the command's name.
        command: the command line.
        scenarios: what is run.
        frames: whether trajectories are kept.
        given: what the study was given beside scenarios.
        missing: why it cannot be repeated from the folder alone, a line each.
        data: files that it reads, such as logs, of which copies are kept.

    Raises:
        OmniError: a user's file has gone.
    """
    shelf = _Shelf(folder)
    described = {each.name: _scenario(each, shelf) for each in scenarios}
    found = here.environment()
    found["versions"] |= modules.versions(shelf.python)
    found |= {"missing": list(missing)} if missing else {}
    found |= {"data": [shelf.put_data(file) for file in data]} if data else {}
    content = {
        "format": FORMAT, "study": study, "command": command,
        "began": _now(), "frames_kept": frames, "given": dict(given or {}),
        "scenarios": described, "modules": shelf.modules(), **found,
    }  # fmt: skip
    write(folder / FILE, json.dumps(content, indent=2, ensure_ascii=False) + "\n")  # by which the folder is ours
    shelf.write()


def save_result(folder: Path, study: str, scenarios: Sequence[Scenario], frames: bool) -> None:
    """Write what a result from Python is made of, as far as that can be known, and what is missing to repeat it.

    Args:
        folder: of the result.
        study: run, compare, or another whose arguments are not known.
        scenarios: that were run.
        frames: whether trajectories are kept.
    """
    kinds = dict.fromkeys(kind for scenario in scenarios for kind in scenario.controllers)
    missing = [line for kind in kinds for line in _missing(kind)]
    if study not in ("run", "compare"):
        missing.append(f"it is of om.{study}, called from Python: what that was given beside scenarios is not known")
    save(folder, study, None, scenarios, frames, missing=missing)


def asked(scenarios: Iterable[tuple[str, Scenario]]) -> dict[str, Any]:
    """Return what a record must hold so that a study can be run again.

    Args:
        scenarios: that it was asked for, by the names under which the record has them.
    """
    return {ASKED: {name: scenario.to_toml() for name, scenario in scenarios}}


def _now() -> str:
    return datetime.now(UTC).isoformat(timespec="seconds")


def _missing(kind: controllers.Kind) -> list[str]:
    """Return why a controller cannot be run again from a copy of its file alone, in lines."""
    if isinstance(kind, str) or kind.__name__ in CONTROLLERS:
        return []
    label, file = controllers.label(kind), getattr(sys.modules.get(kind.__module__), "__file__", None)
    if file is None:
        return [f"the controller {label} was made in Python, and is in no file"]
    why = "is inside of another definition" if "." in kind.__qualname__ else ""
    if kind.__module__ == "__main__":
        why = "is a class of the program that ran, which would run anew"
    copy = f"sources/{Path(file).name} has it"
    return [f"the controller {label} {why}; {copy}; give file.py:{label} of a file that only defines it"] if why else []


class _Shelf:
    """The folder of sources: a copy of each file, once."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._kept: dict[str, bytes] = {}
        self._models: dict[Path, int] = {}

    def put(self, name: str, data: bytes) -> dict[str, str]:
        """Keep a file; where it is in the run's folder, and its hash. Others of its name have a folder each."""
        place, number = f"{SOURCES}/{name}", 1
        while self._kept.get(place, data) != data:
            number += 1
            place = f"{SOURCES}/{number}/{name}"
        self._kept[place] = data
        return {"file": place, "sha256": here.digest(data)}

    def write(self) -> None:
        """Write all that is kept."""
        for place, data in self._kept.items():
            path = self._folder / place
            path.parent.mkdir(parents=True, exist_ok=True)
            with whole(path) as file:
                file.write(data)

    def put_model(self, file: Path) -> dict[str, Any]:
        """Keep a model with all that it is made of, side by side as it was; or say why that cannot be."""
        try:
            found = copies(file)
        except (OSError, ValueError) as error:
            return {"name": file.name, "why": f"{file.name} could not be kept: {' '.join(str(error).split())}"}
        number = self._models.setdefault(file, len(self._models))
        shelf = f"model{number + 1}" if number else "model"
        first, *others = (self.put(f"{shelf}/{place}", data) for place, data in found.items())
        return {"name": file.name, **first, "parts": others}

    def put_data(self, file: Path) -> dict[str, str]:
        """Keep a file of data, unless it is too large."""
        if (size := file.stat().st_size) > LARGEST_BYTES:
            why = f"{file.name} was not kept: it has {size / 1e6:.0f} MB, and {LARGEST_BYTES / 1e6:.0f} is the most"
            with file.open("rb") as opened:
                return {"name": file.name, "sha256": hashlib.file_digest(opened, "sha256").hexdigest(), "why": why}
        return {"name": file.name, **self.put(f"{DATA}/{file.name}", file.read_bytes())}

    @property
    def python(self) -> dict[str, bytes]:
        """The Python sources that are kept."""
        return {place: data for place, data in self._kept.items() if place.endswith(".py")}

    def modules(self) -> list[dict[str, str]]:
        """Keep the modules that the sources import."""
        files = {name: path for data in self.python.values() for name, path in modules.own(data).items()}
        return [self.put(f"{MODULES}/{name}", path.read_bytes()) for name, path in files.items()]


def _scenario(scenario: Scenario, shelf: _Shelf) -> dict[str, Any]:
    path = robots.robot_path(scenario.robot)
    name = path.name if scenario.robot.endswith(".toml") else scenario.robot
    model = scenario.settings.model
    mine: dict[str, Any] = {"model": shelf.put_model(Path(model.file))} if model.file else {}
    if mine:
        mine["model"]["differences"] = list(resolve.differences(scenario.robot, model))
    return mine | {
        "plant": _class(scenario.plant, shelf) if scenario.plant not in plants.PLANTS else {"name": scenario.plant},
        "robot": {"name": name, **shelf.put(path.name, path.read_bytes())},
        "controllers": [_controller(kind, scenario, shelf) for kind in scenario.controllers],
    }


def _controller(kind: controllers.Kind, scenario: Scenario, shelf: _Shelf) -> dict[str, Any]:
    found, label = controllers.find(kind), controllers.label(kind)
    own = {} if kind in CONTROLLERS else _class(kind, shelf)
    values = known_controllers.parameters(found) | dict(scenario.settings.controller.get(label, {}))
    return {"name": label, "class": found.__qualname__, **own, "parameters": values}


def _class(kind: controllers.Kind, shelf: _Shelf) -> dict[str, Any]:
    """What is said of a class of the user's own: by its name as in `user_files`, or itself, in a file or none."""
    file, _, name = controllers.written(kind).rpartition(":")
    own = {"name": controllers.label(kind), "class": name}
    if isinstance(kind, str):
        return own | shelf.put(Path(file).name, user_files.source(kind))
    return own | (shelf.put(Path(file).name, Path(file).read_bytes()) if Path(file).is_file() else {})
