"""What must hold of a program that ended, however it ended, and of the folder that it left."""

import json
import re
import signal
import tomllib
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq
from PIL import Image

SIGNALS = {number: 128 + number for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)}
NO_REASON = "gave no reason"
RAW = re.compile(r"Traceback|Exception ignored|Fatal Python error|Segmentation|core dumped|^\w*Error: ", re.MULTILINE)


def of_program(code: int, err: str, *allowed: int) -> list[str]:
    """What is wrong with how a program ended: by one of these codes, and if by another than 0 or a signal, with a line.

    A negative code is a signal that ended it at once, before or after the time in which it answers signals.
    """
    wrong = [f"ended with {code}, not {allowed}"] * (code not in allowed)
    wrong += [f"said: {err[found.start() :].strip()[-200:]}" for found in list(RAW.finditer(err))[:1]]
    lines = [line for line in err.splitlines() if line.strip()]
    if code > 0 and not any(line.startswith("error: ") for line in lines):
        wrong.append(NO_REASON)
    return wrong


def of_folder(folder: Path, whole: Path) -> list[str]:
    """What is wrong with a folder: files that are not whole, or that say that they are and are not.

    Args:
        folder: that was left.
        whole: that the same command leaves when nothing disturbs it.
    """
    wrong = of_files(folder)
    summary = _json(folder / "summary.json")
    if not wrong and summary is not None:
        wrong += _numbers(folder, whole, summary)
    return wrong


def of_files(folder: Path) -> list[str]:
    """Which files of a folder are not whole."""
    wrong = []
    for path in sorted(path for path in folder.rglob("*") if path.is_file()):
        try:
            _READERS.get(path.suffix, _nothing)(path)
        except Exception as error:
            wrong.append(f"{path.relative_to(folder)} is not whole: {type(error).__name__}: {error}"[:200])
    return wrong


def _numbers(folder: Path, whole: Path, summary: dict[str, Any]) -> list[str]:
    """A summary that says that all is there, where it is not; frames that are not those of an undisturbed run."""
    wrong, keys = [], ("controller", "seed", "place", "frame")
    for path in folder.rglob("traject*.parquet"):
        known = {tuple(row[key] for key in keys): repr(row) for row in _rows(whole / path.relative_to(folder))}
        ours = {tuple(row[key] for key in keys): repr(row) for row in _rows(path)}  # in texts NaN is NaN
        other = sum(known.get(key) != row for key, row in ours.items())
        wrong += [f"{path.name}: {other} frames are not the undisturbed run's"] if other else []
        if summary["complete"] and len(ours) < len(known):
            wrong.append(f"{path.name}: {len(known) - len(ours)} frames are missing of a run that says it is complete")
    missing = {
        path.relative_to(whole) for path in whole.rglob("*.parquet") if not (folder / path.relative_to(whole)).exists()
    }
    if summary["complete"] and missing:
        wrong.append(f"complete, without {', '.join(map(str, missing))}")
    return wrong


def _json(path: Path) -> Any:
    return json.loads(path.read_text()) if path.is_file() else None


def _rows(path: Path) -> list[dict[str, Any]]:
    with path.open("rb") as file:
        return pq.read_table(file).to_pylist()


def _picture(path: Path) -> None:
    with Image.open(path) as picture:
        picture.load()


def _page(path: Path) -> None:
    if not path.read_text().rstrip().endswith("</html>"):
        raise ValueError("a page that does not end")


def _nothing(path: Path) -> None:
    pass


_READERS = {
    ".json": _json, ".parquet": _rows, ".png": _picture, ".gif": _picture, ".webp": _picture, ".html": _page,
    ".toml": lambda path: tomllib.loads(path.read_text()),
}  # fmt: skip
