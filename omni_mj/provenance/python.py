"""Writes down what a result from Python is made of, as far as that can be known."""

import sys
from pathlib import Path

from omni_control.registry import CONTROLLERS
from omni_mj.measure.result import Result
from omni_mj.provenance import record
from omni_mj.scenarios import controllers


def save(result: Result, folder: Path) -> None:
    """Write provenance.json and the copies in sources/, and in it what is missing to repeat the result from there."""
    scenarios = [outcome.scenario for outcome in result.outcomes]
    kinds = dict.fromkeys(kind for scenario in scenarios for kind in scenario.controllers)
    missing = [line for kind in kinds for line in _missing(kind)]
    study = "compare" if len(scenarios) > 1 else "run"
    if type(result) is not Result:
        study = type(result).__name__.removesuffix("Result").lower()
        missing.append(f"it is of om.{study}, called from Python: what that was given beside scenarios is not known")
    frames = all(outcome.log is not None for outcome in result.outcomes)
    record.save(folder, study, None, scenarios, frames, missing=missing)


def _missing(kind: controllers.Kind) -> list[str]:
    """Why a controller cannot be run again from a copy of its file alone, in lines."""
    if isinstance(kind, str) or kind.__name__ in CONTROLLERS:
        return []
    label, file = controllers.label(kind), getattr(sys.modules.get(kind.__module__), "__file__", None)
    if file is None:
        return [f"the controller {label} was made in Python, and is in no file"]
    why = "is inside of another definition" if "." in kind.__qualname__ else ""
    if kind.__module__ == "__main__":
        why = "is a class of the program that ran, which would run anew"
    kept = f"sources/{Path(file).name} has it"
    return [f"the controller {label} {why}; {kept}; give file.py:{label} of a file that only defines it"] if why else []
