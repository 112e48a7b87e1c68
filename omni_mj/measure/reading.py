"""Reads summaries back, and says what is wrong with those that cannot be read."""

from pathlib import Path
from typing import Any

from omni_control.errors import OmniError
from omni_mj.files import read_json

FORMAT = 4  # of summary.json
# What a summary, and what is said in it of a scenario, must hold, and as what.
NUMBER, NOTHING = (int, float), type(None)
PARTS: dict[str, type | tuple[type, ...]] = {
    **dict.fromkeys(("controllers", "informed", "seeds"), list),
    **dict.fromkeys(("scenarios", "definitions", "versions"), dict),
    "complete": bool,
    "stopped": (str, NOTHING),
    "wall_s": NUMBER,
}
ENTRY_PARTS: dict[str, type | tuple[type, ...]] = {
    **dict.fromkeys(("description", "plant", "robot", "status"), str),
    **dict.fromkeys(("reason",), (str, NOTHING)),
    **dict.fromkeys(("frames", "simulated_s", "wall_s", "paper_table"), NUMBER),
    **dict.fromkeys(("seeds", "events", "failed"), list),
    **dict.fromkeys(("settings", "results"), dict),
    **dict.fromkeys(("paper", "verdict"), (dict, NOTHING)),
}


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
    wrong = _wrong(summary, PARTS)
    if not wrong:
        for name, entry in summary["scenarios"].items():
            wrong += [f"scenarios.{name}.{part}" for part in _wrong(entry, ENTRY_PARTS)]
        wrong += [] if summary["scenarios"] else ["scenarios"]
    if wrong:
        raise OmniError(f"{path} is not a run's summary: {', '.join(wrong)} missing or wrong; make the run again")
    return summary


def _served(folder: Path) -> bool:
    """Whether `serve` recorded it."""
    try:
        return read_json(folder / "provenance.json").get("study") == "serve"
    except OmniError:
        return False


def _wrong(found: Any, parts: dict[str, type | tuple[type, ...]]) -> list[str]:
    """Which parts something lacks, or has as something else."""
    if not isinstance(found, dict):
        return list(parts)
    return [name for name, kind in parts.items() if name not in found or not isinstance(found[name], kind)]
