"""What is possible on a scenario at best, as `omni-mj limit` found it, next to controllers that were compared."""

import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from omni_control.errors import OmniError, choose
from omni_mj.measure import reading
from omni_mj.measure.statistics import Spread, spread
from omni_mj.scenarios.checking import in_one
from omni_mj.scenarios.scenario import Scenario

LIMITS = {
    "limit": "limit",
    "limit_without_noise": "limit without noise",
}  # key in a scenario's entry -> how it is called, there and by the study
Entry = Mapping[str, Any]
Study = Mapping[str, Any]  # summary of a `LimitResult`
FREE = ("controller.", "physics.kernel")  # settings that a limit does not depend on
NAMED = 3  # settings that differ, of which a message tells
STATISTICS = ("max", "mean")  # of the error in the plane, by which controllers are judged

DEFINITIONS = {
    "limit": (
        "where it is known: errors of what iterative learning reaches on the same plant and path, with noise and"
        " feedback, when it may repeat the run as often as it likes; limit_without_noise the same without noise, which"
        " leaves what actuators and traction allow. Over the seeds of the controllers, where the limit has all of them"
    ),
    "over_limit": "where the limit is known: a controller's error in the plane by the limit's, means over the seeds",
}


def of(entry: Entry) -> dict[str, Any]:
    """Those limits that a scenario's entry in a summary has: what they are called -> errors."""
    return {label: entry[key] for key, label in LIMITS.items() if entry.get(key)}


def over(entry: Entry) -> dict[str, dict[str, float | None]] | None:
    """Controller -> how many times the limit its error in the plane is; None where the limit is not known."""
    if not entry.get("limit"):
        return None
    found: dict[str, dict[str, float | None]] = {}
    for name, result in entry["results"].items():
        pairs = {
            s: (result["error_m"]["distance"][s]["mean"], entry["limit"]["distance"][s]["mean"]) for s in STATISTICS
        }
        found[name] = {s: mean / least if mean is not None and least else None for s, (mean, least) in pairs.items()}
    return found


def read(folder: Path) -> Study:
    """Read what `omni-mj limit` left in a folder.

    Raises:
        OmniError: It cannot be read, holds no limit, or one that was not found.
    """
    found = reading.read(folder)
    if not isinstance(found.get("limit"), dict):
        raise OmniError(f"{folder} holds no limit; give the folder that omni-mj limit SCENARIO --out FOLDER leaves")
    if not found["complete"]:
        raise OmniError(f"the limit in {folder} was not found: {found['stopped']}")
    return found


def known(studies: Iterable[Study], scenarios: Sequence[Scenario]) -> list[Entry | None]:
    """Return the entry of each scenario in the study of its limit, None where there is none.

    A limit holds for the robot, the plant, the settings and so the reference that it was found for: for all settings
    but those of controllers.

    Raises:
        OmniError: A study is of a scenario that is not among these, or of another robot, plant or settings; a line
            for each.
    """
    by_name = {scenario.name: scenario for scenario in scenarios}
    found: dict[str, Entry] = {}
    wrong = []
    for name, entry in ((name, entry) for study in studies for name, entry in study["scenarios"].items()):
        if name not in by_name:
            wrong.append(f"a limit is given of {name!r}, which is not compared; {choose(name, by_name)}")
        elif differences := list(_differences(entry, by_name[name])):
            more = len(differences) - NAMED
            words = ", ".join(differences[:NAMED]) + (f" and {more} more settings" if more > 0 else "")
            wrong.append(f"the limit of {name!r} is another's: {words}")
        found[name] = entry
    in_one(wrong)
    return [found.get(scenario.name) for scenario in scenarios]


def beside(study: Entry | None, seeds: Sequence[int]) -> dict[str, Any]:
    """Return the limits of a scenario that was run with some seeds: errors by the keys of `LIMITS`, or None.

    Of the limit's errors, those with the same seeds, where it has all of them: their noise is the same for everybody.
    """
    if study is None:
        return dict.fromkeys(LIMITS)
    theirs = list(study["seeds"])
    chosen = [theirs.index(seed) for seed in seeds] if seeds and set(seeds) <= set(theirs) else range(len(theirs))
    errors = {key: study["results"][label]["error_m"] for key, label in LIMITS.items()}
    return {
        key: {axis: {s: _chosen(each, chosen, len(theirs)) for s, each in axes[axis].items()} for axis in axes}
        for key, axes in errors.items()
    }


def _chosen(errors: Spread, chosen: Sequence[int], count: int) -> Spread:
    """Return the errors of the chosen ones of so many seeds; of one robot for all of them, as they are."""
    if len(errors["seeds"]) != count:
        return errors
    values = [errors["seeds"][i] for i in chosen]
    return spread(np.array([np.inf if value is None else value for value in values]))


def _differences(entry: Entry, scenario: Scenario) -> Iterator[str]:
    """Yield in what a limit's entry is of something else than a scenario, in words."""
    ours, theirs = dict(flat(json.loads(json.dumps(scenario.settings.plain())))), dict(flat(entry["settings"]))
    if entry["plant"] != scenario.plant:
        yield f"found on the {entry['plant']} plant, not {scenario.plant}"
    differ = [key for key in {**ours, **theirs} if ours.get(key) != theirs.get(key) and not key.startswith(FREE)]
    if differ and entry["robot"] != scenario.robot:
        yield f"found for robot {entry['robot']}, not {scenario.robot}"
        return  # which differs in many settings
    for key in differ:
        yield f"found with {key} = {json.dumps(theirs.get(key))}, not {json.dumps(ours.get(key))}"


def flat(settings: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Yield the names `section.field` of nested settings, and their values."""
    for name, value in settings.items():
        if isinstance(value, Mapping):
            yield from flat(value, f"{prefix}{name}.")
        else:
            yield prefix + name, value
