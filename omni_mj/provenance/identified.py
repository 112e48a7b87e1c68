"""Identifies again from the logs that a folder of `omni-mj identify` keeps; what it found is compared."""

import json
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from omni_control.errors import OmniError
from omni_mj.files import text_of
from omni_mj.scenarios.scenario import Scenario

if TYPE_CHECKING:
    from omni_mj.provenance.folder import Folder

STUDY, FILE = "identify", "identify.json"
PARTS = ("estimates", "fits")  # of what was found; the rest are names and notes


def given(logs: Iterable[Path], chosen: Scenario) -> dict[str, Any]:
    """What a record must hold so that a robot can be identified again: which files are a log, in which word.

    Args:
        logs: as `omni_mj.studies.identify.logs.read` takes them.
        chosen: the scenario with the robot that it starts from.
    """
    from omni_mj.studies.identify.logs import files

    words = [{"word": word, "files": len(found)} for word, found in map(files, logs)]
    return {"logs": words, "scenario": chosen.to_toml()}


def read(path: Path) -> dict[str, Any]:
    """What was found, in the folder of an identification.

    Raises:
        OmniError: it cannot be read.
    """
    file = path / FILE
    try:
        found = json.loads(text_of(file))
    except (OSError, ValueError) as error:
        raise OmniError(f"{file} cannot be read: {' '.join(str(error).split())}") from None
    if not isinstance(found, dict) or not all(isinstance(found.get(part), dict) for part in PARTS):
        raise OmniError(f"{file} is not what omni-mj identify writes: {' or '.join(PARTS)} missing")
    return found


def again(folder: "Folder", copies: Path) -> tuple[int, dict[str, Any], dict[str, Any]]:
    """Identify again.

    Args:
        folder: that was left.
        copies: where the user's files are.

    Returns:
        How many logs there are, what was found, and what is now.

    Raises:
        OmniError: the record does not say of which logs, or they cannot be read.
    """
    from omni_mj.studies.identify.logs import read as read_log
    from omni_mj.studies.identify.study import of_logs

    words, text = (folder.record["given"].get(key) for key in ("logs", "scenario"))
    paths = [copies / each["file"] for each in folder.record.get("data", [])]
    if not isinstance(text, str) or not _names(words, paths):
        raise OmniError(f"{folder.path} does not say which logs it is of; repeat it as a whole")
    (name,) = folder.record["scenarios"]
    file = copies / "identify.toml"
    file.write_text(text, encoding="utf-8")
    chosen, logs, at = folder.loaded(file, name, copies), [], 0
    for each in words:
        logs += read_log(Path(each["word"].format(*paths[at : at + each["files"]])))
        at += each["files"]
    now = json.loads(json.dumps(of_logs(logs, chosen).report()))
    before, after = ({part: found[part] for part in PARTS} for found in (folder.summary, now))
    return len(logs), before, after


def _names(words: Any, paths: Sequence[Path]) -> bool:
    """Whether words of logs are there, for as many files."""
    if not isinstance(words, list) or not words:
        return False
    whole = all(isinstance(each, Mapping) and isinstance(each.get("word"), str) for each in words)
    return whole and sum(each.get("files", 0) for each in words) == len(paths)
