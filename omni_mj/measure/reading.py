"""Reads summaries back, and says what is wrong with those that cannot be read."""

from pathlib import Path
from typing import Any

from pydantic import BaseModel, Field, ValidationError

from omni_control.errors import OmniError
from omni_mj.files import read_json

FORMAT = 4  # of summary.json


class _Entry(BaseModel, strict=True):
    """What the readers of a summary rely on in the entry of a scenario."""

    description: str
    plant: str
    robot: str
    status: str
    reason: str | None
    frames: int
    simulated_s: float
    wall_s: float
    paper_table: int
    seeds: list[int]
    events: list[Any]
    failed: list[Any]
    settings: dict[str, Any]
    results: dict[str, Any]
    paper: dict[str, Any] | None
    verdict: dict[str, Any] | None


class _Summary(BaseModel, strict=True):
    """What the readers of a summary rely on."""

    controllers: list[str]
    informed: list[str]
    seeds: list[int]
    scenarios: dict[str, _Entry] = Field(min_length=1)
    definitions: dict[str, str]
    versions: dict[str, str]
    complete: bool
    stopped: str | None
    wall_s: float


def read(folder: Path) -> dict[str, Any]:
    """The summary in the folder of a run or comparison, checked as far as its readers rely on it.

    Raises:
        OmniError: there is none, or one that cannot be read.
    """
    path = folder / "summary.json"
    if not path.exists():
        if _served(folder):
            raise OmniError(
                f"{folder} is of omni-mj serve, which knows of no reference and so of no error: there is nothing to"
                " report; where robots were is in trajectory.parquet and recording.rrd"
            )
        raise OmniError(f"{folder} holds no run: it has no {path.name}; give the folder of a run")
    summary = read_json(path)
    if summary.get("format") != FORMAT:
        raise OmniError(f"{path} is of format {summary.get('format')!r}; this version of omni-mj reads format {FORMAT}")
    try:
        _Summary.model_validate(summary)
    except ValidationError as error:
        wrong = ", ".join(".".join(map(str, line["loc"])) for line in error.errors())
        raise OmniError(f"{path} is not a run's summary: {wrong} missing or wrong; make the run again") from None
    return summary


def _served(folder: Path) -> bool:
    """Whether `serve` recorded it."""
    try:
        return read_json(folder / "provenance.json").get("study") == "serve"
    except OmniError:
        return False
