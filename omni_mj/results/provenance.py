"""Provenance of a run: provenance.json, and copies of the user's files in sources/.

provenance.json names no users, hosts or folders, except those in the command line.
"""

import hashlib
import json
import platform
import re
import subprocess
from collections.abc import Iterator, Mapping, Sequence
from datetime import UTC, datetime
from functools import cache
from pathlib import Path
from typing import Any

import omni_control
from omni_control.controllers.registry import CONTROLLERS, get_parameters
from omni_control.errors import OmniError
from omni_mj.config import plugins, robot_files
from omni_mj.config.scenario import Scenario
from omni_mj.io.atomic_files import read_json, write_files, write_json
from omni_mj.results.arithmetic import describe_arithmetic
from omni_mj.results.summary import package_versions

PROVENANCE_FORMAT = 4  # version of the keys of provenance.json
PROVENANCE_FILE, SOURCES_FOLDER = "provenance.json", "sources"
SOURCE_SUFFIXES = (".py", ".toml", ".xml")  # of files that can affect the results
ENVIRONMENT_KEYS = ("versions", "source", "git", "machine")
ABSENT = "absent"  # text in place of a value that one of two records lacks
GIT_TIMEOUT_S = 5.0
_PACKAGE = Path(__file__).parents[1]


def save_provenance(
    folder: Path,
    study: str,
    command: str | None,
    scenarios: Sequence[Scenario],
    options: Mapping[str, Any],
) -> None:
    """Write provenance.json and copies of the user's files before a run starts.

    Args:
        folder: Folder of the run, which exists.
        study: Name of the command.
        command: Command line, or None for a result from Python.
        scenarios: Scenarios of the run.
        options: Further keys and values about the results; see `describe_options`.

    Raises:
        OmniError: A file of the user no longer exists.
    """
    files: dict[str, bytes] = {}
    content = describe_study(study, scenarios, files) | {
        "command": command,
        "started": datetime.now(UTC).isoformat(timespec="seconds"),
        **options,
    }
    # Written first, because --overwrite recognizes the folder of a run by it.
    write_json(folder / PROVENANCE_FILE, content)
    write_files(folder, files)


def describe_options(
    input_files: Mapping[str, str], frames_saved: bool = False, subject: str | None = None
) -> dict[str, Any]:
    """Return keys of provenance.json that `omni_mj.verify` needs to repeat a study.

    Args:
        input_files: Path in the folder -> text of each file that describes the study.
        frames_saved: Whether trajectories are saved.
        subject: Controller that the verdicts are about, or None.
    """
    hashes = {name: sha256(text.encode()) for name, text in input_files.items()}
    return {"inputs": hashes, "frames_saved": frames_saved, "subject": subject}


def describe_scenarios(scenarios: Sequence[Scenario], files: dict[str, bytes]) -> dict[str, Any]:
    """Return a description of everything in scenarios that affects the results, by their names.

    Args:
        scenarios: The scenarios.
        files: Path in the run's folder -> content. Copies of the user's files are added.

    Raises:
        OmniError: A file of the user no longer exists.
    """
    return {scenario.name: _describe_scenario(scenario, files) for scenario in scenarios}


def list_changes(
    saved: Mapping[str, Any], current: Mapping[str, Any], keys: Sequence[str]
) -> list[str]:
    """Return the differences of two records, a line each.

    Args:
        saved: Content of a provenance.json.
        current: What it would be now. Values that JSON writes alike are equal.
        keys: Keys of both that are compared.
    """
    records = ({key: record[key] for key in keys if key in record} for record in (saved, current))
    differences = find_differences(*records)
    return [
        f"{name} was {saved_value} in the run, is {current_value} here"
        for name, (saved_value, current_value) in differences.items()
    ]


def find_differences(
    saved: Mapping[str, Any], current: Mapping[str, Any]
) -> dict[str, tuple[Any, Any]]:
    """Return both values, or `ABSENT`, of each name `key.key` for which JSON writes others.

    The items of lists have numbers as names.
    """
    old, new = (dict(_flatten(json.loads(json.dumps(record)))) for record in (saved, current))
    values = {name: (old.get(name, ABSENT), new.get(name, ABSENT)) for name in {**old, **new}}
    return {
        name: pair for name, pair in values.items() if json.dumps(pair[0]) != json.dumps(pair[1])
    }


def _flatten(value: Any, name: str = "") -> Iterator[tuple[str, Any]]:
    """Yield the name and value of each number, text, truth value and empty container."""
    items = dict(enumerate(value)) if isinstance(value, list) else value
    if not isinstance(items, Mapping) or not items:
        yield name, value
        return
    for key, item in items.items():
        yield from _flatten(item, f"{name}.{key}" if name else str(key))


def check_unchanged(folder: Path, study: str, scenarios: Sequence[Scenario]) -> None:
    """Check that a study in a folder can be continued here with equal results.

    Raises:
        OmniError: Another version, source, processor, robot, model, controller or plant, a line
            each; or provenance.json is missing.
    """
    current = describe_study(study, scenarios, {})
    keys = [key for key in current if key != "git"]  # a commit of the same source is no change
    if changes := list_changes(read_json(folder / PROVENANCE_FILE), current, keys):
        remark = f"{folder} cannot be continued, because its results would be mixed with others"
        raise OmniError("\n".join([f"{remark}; name another folder", *changes]))


def describe_study(
    study: str, scenarios: Sequence[Scenario], files: dict[str, bytes]
) -> dict[str, Any]:
    """Return everything that affects the results of a study; see `describe_scenarios`."""
    return {
        "format": PROVENANCE_FORMAT,
        "study": study,
        "scenarios": describe_scenarios(scenarios, files),
        **describe_environment(),
    }


def describe_environment() -> dict[str, Any]:
    """Return package versions, a hash of the source, the git commit and the machine."""
    # On Linux, Python does not report the processor's name.
    cpu_file = Path("/proc/cpuinfo")
    text = cpu_file.read_text(encoding="utf-8", errors="replace") if cpu_file.exists() else ""
    name = re.search(r"^model name\s*: (.*)$", text, re.MULTILINE)
    return {
        "versions": package_versions(),
        "source": source_digest(),
        "git": _git_commit(),
        "machine": {
            "CPU": name[1] if name else platform.processor(),
            "system": f"{platform.system()} {platform.machine()}",
            **describe_arithmetic(),
        },
    }


def sha256(data: bytes) -> str:
    """Return the SHA-256 of data as hexadecimal digits."""
    return hashlib.sha256(data).hexdigest()


@cache
def source_digest() -> str:
    """Return a hash of the names and contents of the packages' source files and the models."""
    folders = _PACKAGE, Path(omni_control.__file__).parent, robot_files.find_models_folder()
    lines = [
        f"{sha256(path.read_bytes())} {path.relative_to(folder).as_posix()}\n"
        for folder in folders
        for path in sorted(folder.rglob("*"))
        if path.suffix in SOURCE_SUFFIXES
    ]
    return sha256("".join(lines).encode())


def _git_commit() -> str | None:
    """Return the commit of the checkout that contains this package, or None without a checkout.

    "-dirty" follows if files differ from the commit.
    """
    root = _PACKAGE.parent
    if not (root / ".git").exists():
        return None
    command = ("git", "-C", root, "describe", "--always", "--dirty", "--abbrev=40", "--exclude=*")
    try:
        return subprocess.check_output(
            command, stderr=subprocess.DEVNULL, text=True, timeout=GIT_TIMEOUT_S
        ).strip()
    except (OSError, subprocess.SubprocessError):
        return None


def _describe_scenario(scenario: Scenario, files: dict[str, bytes]) -> dict[str, Any]:
    """Return a description of the plant, robot, controllers and model of a scenario.

    Args:
        scenario: The scenario.
        files: Path in the run's folder -> content. Copies of the user's files are added.
    """
    robot, plant = robot_files.find_robot_file(scenario.robot), scenario.plant
    (robot_copy,) = _add_copies(files, {robot.name: robot.read_bytes()})
    entry: dict[str, Any] = {
        "plant": {"name": plant} if plant in plugins.PLANTS else _describe_class(plant, files),
        "robot": {"name": robot.stem} | robot_copy,
        "controllers": [
            _describe_controller(kind, scenario, files) for kind in scenario.controllers
        ],
    }
    drawn = scenario.distributions.get("model.file")
    names = drawn.values if drawn else [scenario.settings.model.file]
    if models := [_describe_model(Path(name), files) for name in names if name]:
        entry["models"] = models
    return entry


def _describe_model(path: Path, files: dict[str, bytes]) -> dict[str, Any]:
    """Return name and files of a user's model, and add them to `files`."""
    contents = robot_files.read_model_files(path)
    model_files = {f"model/{file}": data for file, data in contents.items()}
    model, *included = _add_copies(files, model_files)
    return {"name": path.name} | model | {"included": included}


def _describe_controller(
    kind: plugins.ControllerSpec, scenario: Scenario, files: dict[str, bytes]
) -> dict[str, Any]:
    """Return name, file and parameters of a controller, and add its file to `files`."""
    label, controller_class = plugins.label_controller(kind), plugins.find_controller(kind)
    entry = {"name": label} if kind in CONTROLLERS else _describe_class(kind, files)
    parameters = scenario.settings.controller.get(label, {})
    return entry | {"parameters": get_parameters(controller_class) | dict(parameters)}


def _describe_class(kind: plugins.ControllerSpec, files: dict[str, bytes]) -> dict[str, Any]:
    """Return name and file of a user's class, and add the file to `files`."""
    file, _, name = plugins.format_controller_spec(kind).rpartition(":")
    entry = {"name": plugins.label_controller(kind), "class": name}
    # Started processes import the program as __mp_main__.
    is_main = isinstance(kind, type) and kind.__module__ in ("__main__", "__mp_main__")
    if is_main or "." in name or not Path(file).is_file():
        reason = "is not defined at the top level of a file that can be imported"
        return entry | {"not_copied": reason}
    (copy,) = _add_copies(files, {Path(file).name: Path(file).read_bytes()})
    return entry | copy


def _add_copies(files: dict[str, bytes], copies: Mapping[str, bytes]) -> list[dict[str, str]]:
    """Add files that belong together to `files`.

    Args:
        files: Path in the run's folder -> content.
        copies: Name -> content of the files to add.

    Returns:
        Path in the run's folder and hash of each copy.
    """
    folder = SOURCES_FOLDER
    while any(files.get(f"{folder}/{name}", data) != data for name, data in copies.items()):
        folder += "/other"  # different files of these names are already there
    files |= {f"{folder}/{name}": data for name, data in copies.items()}
    return [{"file": f"{folder}/{name}", "sha256": sha256(data)} for name, data in copies.items()]
