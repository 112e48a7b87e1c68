"""What is possible on a scenario at best, as `omni-mj limit` found it: the line that no competitor crosses."""

import json
import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from omni_control.errors import OmniError, choose
from omni_mj.files import text_of
from omni_mj.measure.statistics import Spread, spread
from omni_mj.scenarios.scenario import Scenario

LIMITS = {
    "limit": "limit",
    "limit_without_noise": "limit without noise",
}  # key in a scenario's entry -> how it is called, there and by the study
Entry = Mapping[str, Any]
Study = Mapping[str, Any]  # summary of a `LimitResult`
FREE = ("controller",)  # sections of settings that a limit does not depend on
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
    least = {statistic: entry["limit"]["distance"][statistic]["mean"] for statistic in STATISTICS}
    return {
        name: {
            statistic: mean / least[statistic] if mean is not None and least[statistic] else None
            for statistic in STATISTICS
            for mean in [result["error_m"]["distance"][statistic]["mean"]]
        }
        for name, result in entry["results"].items()
    }


def read(path: Path) -> Study:
    """What `omni-mj limit` left in a folder, or in the summary.json of it.

    Raises:
        OmniError: it cannot be read, or is no such thing.
    """
    file = path / "summary.json" if os.path.isdir(path) else path
    try:
        found = json.loads(text_of(file))
    except OSError as error:
        raise OmniError(f"cannot read the limit in {file}: {error.strerror}") from None
    except (ValueError, RecursionError) as error:
        raise OmniError(f"the limit in {file} is not valid JSON: {error}") from None
    if not isinstance(found, dict) or not isinstance(found.get("limit"), dict) or not found.get("scenarios"):
        raise OmniError(f"{file} holds no limit; give the folder that omni-mj limit SCENARIO --out FOLDER leaves")
    if not found.get("complete"):
        raise OmniError(f"the limit in {file} was not found: {found.get('stopped') or 'the study was not finished'}")
    return found


def known(studies: Iterable[Study], scenarios: Sequence[Scenario]) -> list[Entry | None]:
    """The entry of each scenario in the study of its limit, None where there is none.

    A limit holds for the robot, the plant, the settings and so the reference that it was found for: for all settings
    but those of controllers. Of several studies of a scenario, that counts which was made for what is compared.

    Raises:
        OmniError: a study is of a scenario that is not among these, or of another robot, plant or settings; a line
            for each.
    """
    names = [each.name for each in scenarios]
    found: dict[str, Entry] = {}
    wrong: dict[str, str] = {}
    for study in studies:
        for name, entry in study["scenarios"].items():
            if name not in names:
                wrong.setdefault(name, f"a limit is given of {name!r}, which is not compared; {choose(name, names)}")
            elif differs := list(_differences(entry, scenarios[names.index(name)])):
                told, more = differs[:NAMED], len(differs) - NAMED
                words = ", ".join(told) + (f" and {more} more settings" if more > 0 else "")
                wrong.setdefault(name, f"the limit of {name!r} is another's: {words}")
            else:
                found[name] = entry
    if lines := [line for name, line in wrong.items() if name not in found]:
        raise OmniError("\n".join(lines))
    return [found.get(name) for name in names]


def beside(study: Entry | None, seeds: Sequence[int]) -> dict[str, Any]:
    """What stands in the entry of a scenario that was run with some seeds: errors by the keys of `LIMITS`, or None.

    Of the limit's errors, those with the same seeds, where it has all of them: what they have in store is the same for
    everybody. The study's controllers, which came near the limit, may be better on these.
    """
    if study is None:
        return dict.fromkeys(LIMITS)
    results, theirs = study["results"], list(study["seeds"])
    shared = seeds and set(seeds) <= set(theirs)
    same = [theirs.index(seed) for seed in seeds] if shared else list(range(len(theirs)))
    errors = {name: _over(result["error_m"], same, len(theirs)) for name, result in results.items()}
    still = errors.pop(LIMITS["limit_without_noise"])
    worst, usual = (min(errors.values(), key=lambda each: _mean(each, statistic)) for statistic in STATISTICS)
    least = {axis: usual[axis] | {"max": worst[axis]["max"]} for axis in usual}
    return {"limit": least, "limit_without_noise": still}


def _mean(errors: Mapping[str, Any], statistic: str) -> float:
    """Mean over the seeds of the error in the plane, m; infinite where one of them failed."""
    value = errors["distance"][statistic]["mean"]
    return np.inf if value is None else float(value)


def _over(errors: Mapping[str, Any], chosen: Sequence[int], count: int) -> dict[str, dict[str, Spread]]:
    """Errors over the chosen ones of so many seeds; of one robot for all of them, as they are."""
    return {
        axis: {name: _chosen(each, chosen) if len(each["seeds"]) == count else each for name, each in of_axis.items()}
        for axis, of_axis in errors.items()
    }


def _chosen(given: Spread, chosen: Sequence[int]) -> Spread:
    values = [np.inf if (value := given["seeds"][i]) is None else value for i in chosen]
    return spread(np.array(values))


def _differences(entry: Entry, scenario: Scenario) -> Iterator[str]:
    """In what a limit's entry is of something else than a scenario, in words."""
    ours, theirs = (
        {key: value for key, value in _flat(settings) if key.split(".")[0] not in FREE}
        for settings in (json.loads(json.dumps(scenario.settings.plain())), entry["settings"])
    )
    if entry["plant"] != scenario.plant:
        yield f"found on the {entry['plant']} plant, not {scenario.plant}"
    differ = [key for key in dict.fromkeys([*ours, *theirs]) if ours.get(key) != theirs.get(key)]
    if differ and entry["robot"] != scenario.robot:
        yield f"found for robot {entry['robot']}, not {scenario.robot}"
        return  # which differs in many settings
    for key in differ:
        yield f"found with {key} = {json.dumps(theirs.get(key))}, not {json.dumps(ours.get(key))}"


def _flat(settings: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    for name, value in settings.items():
        if isinstance(value, Mapping):
            yield from _flat(value, f"{prefix}{name}.")
        else:
            yield prefix + name, value
