"""What is possible on a scenario at best, as a study of it found: the line that no competitor crosses."""

import json
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

from omni_control.errors import OmniError
from omni_mj.measure import metrics
from omni_mj.scenarios.scenario import Scenario

LIMITS = {
    "limit": "limit",
    "limit_without_noise": "limit without noise",
}  # key in a scenario's entry -> how it is called
AXES = [axis for axis in metrics.AXES if metrics.UNITS[axis] == "m"]
Known = Mapping[str, Any]  # key of LIMITS -> errors, as `error_m` of a controller's results has them
LimitsOf = Callable[[Scenario], Known | None]

DEFINITION = (
    "where it is known: errors of what iterative learning reaches on the same plant and path, with noise and feedback,"
    " when it may repeat the run as often as it likes; limit_without_noise the same without noise, which leaves what"
    " actuators and traction allow"
)


def unknown(scenario: Scenario) -> Known | None:
    """The limits of a scenario of which none are known."""
    return None


def of(entry: Mapping[str, Any]) -> dict[str, Any]:
    """Those limits that a scenario's entry in a summary has: what they are called -> errors."""
    return {label: entry[key] for key, label in LIMITS.items() if entry.get(key)}


def read(path: Path) -> LimitsOf:
    """Limits from a JSON file: scenario -> `limit`, `limit_without_noise` or both, each errors as in `error_m`.

    Raises:
        OmniError: the file cannot be read, or something in it is no such thing; a line for each.
    """
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise OmniError(f"cannot read limits {path}: {error.strerror}") from None
    except ValueError as error:
        raise OmniError(f"limits {path} are not valid JSON: {error}") from None
    if wrong := list(_wrong(found)):
        raise OmniError("\n".join(f"limits {path}: {each}" for each in wrong))
    return lambda scenario: found.get(scenario.name)


def _wrong(found: Any) -> Iterator[str]:
    """What is not as it should be, in words."""
    if not isinstance(found, dict):
        yield "the file must hold scenarios by name"
        return
    for name, limits in found.items():
        if not isinstance(limits, dict) or not limits or not limits.keys() <= LIMITS.keys():
            yield f"{name} must hold {' or '.join(LIMITS)}, and nothing else"
            continue
        for key, errors in limits.items():
            missing = [f"{a}.{s}" for a in AXES for s in metrics.STATISTICS if not _has_spread(errors, a, s)]
            if missing:
                yield f"{name}.{key} must hold {', '.join(missing)}, each with median, mean and plus_minus"


def _has_spread(errors: Any, axis: str, statistic: str) -> bool:
    for key in (axis, statistic):
        errors = errors.get(key) if isinstance(errors, dict) else None
    return isinstance(errors, dict) and all(
        name in errors and isinstance(errors[name], (int, float, type(None)))
        for name in ("median", "mean", "plus_minus")
    )
