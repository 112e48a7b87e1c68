"""Write down what a run is made of: provenance.json, and copies of the user's own files in sources/.

No names of users, hosts or folders are in it, but for what the command line holds.
"""

import hashlib
import json
import platform
import re
import subprocess
from collections.abc import Iterator, Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import omni_control
from omni_control.controllers import CONTROLLERS, get_parameters
from omni_mj.config import plugins, robot_files
from omni_mj.config.scenario import Scenario
from omni_mj.files import write_text
from omni_mj.mjcf.model_files import read_model_files
from omni_mj.results.summary import package_versions

FORMAT = 1
FILE, SOURCES = "provenance.json", "sources"
SUFFIXES = (".py", ".toml", ".xml")  # of files on which a result can depend
GIT_S = 5.0  # that git may take, s
_PACKAGE = Path(__file__).parents[1]


def save_provenance(
    folder: Path,
    study: str,
    command: str | None,
    scenarios: Sequence[Scenario],
    frames: bool = True,
) -> None:
    """Write what is about to be run.

    Args:
        folder: Of the run, which exists.
        study: Name of the command.
        command: The command line; None for a result from Python.
        scenarios: What is run.
        frames: Whether trajectories are kept.

    Raises:
        OmniError: A user's file has gone.
    """
    files: dict[str, bytes] = {}
    content = {
        "format": FORMAT,
        "study": study,
        "command": command,
        "began": datetime.now(UTC).isoformat(timespec="seconds"),
        "frames_saved": frames,
        "scenarios": {scenario.name: _describe(scenario, files) for scenario in scenarios},
        **describe_environment(),
    }
    # First of all, since by this file --overwrite knows the folder of a run.
    write_text(folder / FILE, json.dumps(content, indent=2, ensure_ascii=False) + "\n")
    for place, data in files.items():
        path = folder / place
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(data)


def describe_environment() -> dict[str, Any]:
    """Return versions, a digest of the packages' source, the commit, the processor."""
    cpu = Path("/proc/cpuinfo")  # Python leaves the processor's name out on Linux
    text = cpu.read_text(encoding="utf-8", errors="replace") if cpu.exists() else ""
    name = re.search(r"^model name\s*: (.*)$", text, re.MULTILINE)
    return {
        "versions": package_versions(),
        "source": source_digest(),
        "git": _commit(),
        "machine": {
            "CPU": name[1] if name else platform.processor(),
            "system": f"{platform.system()} {platform.machine()}",
        },
    }


def sha256(data: bytes) -> str:
    """Return the SHA-256 of data, in hexadecimal digits."""
    return hashlib.sha256(data).hexdigest()


def source_digest() -> str:
    """Return a digest of names and contents of the packages' files and of the models."""
    folders = _PACKAGE, Path(omni_control.__file__).parent, robot_files.find_models_folder()
    return sha256("".join(line for folder in folders for line in _digests(folder)).encode())


def _digests(folder: Path) -> Iterator[str]:
    for path in sorted(path for path in folder.rglob("*") if path.suffix in SUFFIXES):
        yield f"{sha256(path.read_bytes())} {path.relative_to(folder).as_posix()}\n"


def _commit() -> str | None:
    """Return the commit of the checkout that this package is in, "-dirty" if files differ."""
    root = _PACKAGE.parent
    if not (root / ".git").exists():
        return None
    words = (
        "git",
        "-C",
        str(root),
        "describe",
        "--always",
        "--dirty",
        "--abbrev=40",
        "--exclude=*",
    )
    try:
        done = subprocess.run(words, capture_output=True, text=True, timeout=GIT_S, check=True)
    except (OSError, subprocess.SubprocessError):
        return None
    return done.stdout.strip()


def _describe(scenario: Scenario, files: dict[str, bytes]) -> dict[str, Any]:
    """Return what a scenario is made of, and add copies of the user's own files to `files`."""
    robot, plant = robot_files.find_robot_file(scenario.robot), scenario.plant
    (robot_copy,) = _copy(files, {robot.name: robot.read_bytes()})
    entry: dict[str, Any] = {
        "plant": {"name": plant} if plant in plugins.PLANTS else _class(plant, files),
        "robot": {"name": Path(scenario.robot).name} | robot_copy,
        "controllers": [_controller(kind, scenario, files) for kind in scenario.controllers],
    }
    if name := scenario.settings.model.file:
        entry["model"] = {"name": Path(name).name}
        try:
            found = read_model_files(Path(name))
        except (OSError, ValueError) as error:
            entry["model"]["reason"] = f"could not be copied: {error}"
        else:
            model, *parts = _copy(files, {f"model/{part}": data for part, data in found.items()})
            entry["model"] |= model | {"parts": parts}
    return entry


def _controller(kind: plugins.Kind, scenario: Scenario, files: dict[str, bytes]) -> dict[str, Any]:
    label, found = plugins.label_controller(kind), plugins.find_controller(kind)
    entry = {"name": label} if kind in CONTROLLERS else _class(kind, files)
    given = scenario.settings.controller.get(label, {})
    return entry | {"parameters": get_parameters(found) | dict(given)}


def _class(kind: plugins.Kind, files: dict[str, bytes]) -> dict[str, Any]:
    """Return the entry of a class of the user's own, and copy the file that defines it."""
    file, _, name = plugins.reference_controller(kind).rpartition(":")
    entry = {"name": plugins.label_controller(kind), "class": name}
    is_main = isinstance(kind, type) and kind.__module__ == "__main__"
    if is_main or "." in name or not Path(file).is_file():
        return entry | {"reason": "is not defined at the top level of a file that can be imported"}
    (copy,) = _copy(files, {Path(file).name: Path(file).read_bytes()})
    return entry | copy


def _copy(files: dict[str, bytes], own: Mapping[str, bytes]) -> list[dict[str, str]]:
    """Add files that belong together, and return each one's place in the run's folder and hash."""
    folder = SOURCES
    while any(files.get(f"{folder}/{name}", data) != data for name, data in own.items()):
        folder += "/other"  # there are other files of these names
    files |= {f"{folder}/{name}": data for name, data in own.items()}
    return [{"file": f"{folder}/{name}", "sha256": sha256(data)} for name, data in own.items()]
