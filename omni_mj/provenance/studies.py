"""Runs again studies that drive scenarios of their own making, of which only what they found is compared."""

import json
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

from omni_control.errors import OmniError
from omni_mj.measure.result import Result
from omni_mj.provenance.folder import Folder
from omni_mj.scenarios.scenario import Scenario
from omni_mj.studies import alpha, loop, slip
from omni_mj.studies.outcome import AfterFrame

NAMES = ("alpha", "slip", "loop")
GIVEN = "scenarios"  # in what the record says was given: the scenarios that were asked for, as TOML by name
Begin = Callable[[str, int], AfterFrame]


def given(scenarios: Iterable[tuple[str, Scenario]]) -> dict[str, Any]:
    """What a record must hold so that a study can be run again.

    Args:
        scenarios: that it was asked for, by the names under which the record has them.
    """
    return {GIVEN: {name: scenario.to_toml() for name, scenario in scenarios}}


def again(folder: Folder, copies: Path, begin: Begin) -> tuple[Result, Any, Any]:
    """Run a study again, as a whole.

    Args:
        folder: that it left.
        copies: where the user's files are.
        begin: see `repeat`.

    Returns:
        Its result, what the folder's summary says was found, and what was now.

    Raises:
        OmniError: it was stopped, or an older version wrote its folder.
    """
    study = str(folder.record["study"])
    asked, before = folder.record["given"].get(GIVEN), folder.summary.get(study)
    if not isinstance(asked, dict) or not all(isinstance(text, str) for text in asked.values()):
        command = folder.summary.get("repeat") or folder.record.get("command")
        raise OmniError(
            f"{folder.path} does not say what omni-mj {study} was asked for; repeat it as a whole: {command}"
        )
    if before is None:
        raise OmniError(f"nothing was found in {folder.path}: there is nothing to compare with")
    scenarios = []
    for number, (name, text) in enumerate(asked.items()):
        file = copies / f"{study}-{number}.toml"
        file.write_text(text, encoding="utf-8")
        scenarios.append(folder.loaded(file, name, copies))
    result = RUN[study](scenarios, begin)
    return result, before, json.loads(json.dumps(result.summary()[study]))


def _alpha(scenarios: list[Scenario], begin: Begin) -> Result:
    (chosen,) = scenarios
    return alpha.alpha(chosen, after_frame=begin("alpha", alpha.total_frames(chosen)))


def _loop(scenarios: list[Scenario], begin: Begin) -> Result:
    (chosen,) = scenarios
    return loop.loop(chosen, chosen.controllers, after_frame=begin("loop", loop.drive.FRAMES))


def _slip(scenarios: list[Scenario], begin: Begin) -> Result:
    return slip.slip(scenarios, before_robot=begin)


RUN: dict[str, Callable[[list[Scenario], Begin], Result]] = {"alpha": _alpha, "loop": _loop, "slip": _slip}
