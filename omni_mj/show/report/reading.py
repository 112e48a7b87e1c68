"""What a report is made of: summaries, figures and scenario files, read from folders and checked."""

import base64
import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from omni_mj.measure import reading
from omni_mj.scenarios.checking import plain
from omni_mj.scenarios.settings import every_setting
from omni_mj.show import style

TYPES = {".svg": "image/svg+xml", ".png": "image/png"}


@dataclass(frozen=True)
class Setting:
    """A setting of a run; `known` says whether this version still has it, `changed` whether it is off its default."""

    name: str
    value: Any
    default: Any
    unit: str
    doc: str
    known: bool

    @property
    def changed(self) -> bool:
        """Whether the value differs from the default."""
        return self.known and self.value != self.default


@dataclass(frozen=True)
class Figure:
    """A drawn figure: its name, its image as a data URI."""

    name: str
    source: str


@dataclass(frozen=True)
class Run:
    """A scenario that was run, or should have been.

    Attributes:
        label: what it is called in comparisons, unlike any other's.
        name: of the scenario.
        entry: what the summary says of it.
        summary: the whole of that.
        scenario: its TOML file, or nothing.
        file: where that is in the folder.
    """

    label: str
    name: str
    entry: dict[str, Any]
    summary: dict[str, Any]
    scenario: str
    file: str
    figures: list[Figure]
    settings: list[Setting]

    @property
    def seeds(self) -> list[int]:
        """That it was run with; where it was not run, those that it might have been."""
        return self.entry["seeds"] or self.summary["seeds"]

    @property
    def controllers(self) -> list[str]:
        """That it was run with."""
        return self.summary["controllers"]

    @property
    def informed(self) -> list[str]:
        """The controllers that know the truth: no competitors."""
        return self.summary["informed"]

    @property
    def complete(self) -> bool:
        """Whether it was run to its end, some rows perhaps not."""
        return self.entry["status"] == "done"

    @property
    def reason(self) -> str:
        """Why it is not complete."""
        return self.entry["reason"] or self.summary["stopped"] or "no reason is known"


@dataclass(frozen=True)
class Source:
    """A folder: its label, its summary, and what was run."""

    label: str
    summary: dict[str, Any]
    runs: list[Run]


def read(folders: Sequence[Path]) -> list[Source]:
    """Read what is in the folders of runs and comparisons.

    Raises:
        OmniError: one of them holds no summary, or one that cannot be read.
    """
    names = [Path(os.path.realpath(folder)).name for folder in folders]
    unique = len(set(names)) == len(names)
    labels = [name if unique else str(folder) for folder, name in zip(folders, names, strict=True)]
    return [_source(folder, label, alone=len(folders) == 1) for folder, label in zip(folders, labels, strict=True)]


def data_uri(image: bytes, kind: str) -> str:
    """An image as an address that holds it; `kind` is the suffix of its file's name."""
    return f"data:{TYPES[kind]};base64,{base64.b64encode(image).decode()}"


def _source(folder: Path, label: str, alone: bool) -> Source:
    summary = reading.read(folder)
    entries = summary["scenarios"]
    several = len(entries) > 1
    runs = []
    for name, entry in entries.items():
        called = label if not several else name if alone else f"{label}: {name}"
        file = f"scenarios/{name}.toml" if several else "scenario.toml"
        toml = folder / file
        text = toml.read_text(encoding="utf-8", errors="replace") if toml.is_file() else ""
        drawn = [] if several else _figures(folder)
        runs.append(Run(called, name, entry, summary, text, file, drawn, _settings(entry)))
    return Source(label, summary, runs)


def _figures(folder: Path) -> list[Figure]:
    found = []
    for name in style.FIGURES:
        paths = [folder / "figures" / f"{name}{kind}" for kind in TYPES]
        found += [Figure(name, data_uri(path.read_bytes(), path.suffix)) for path in paths if path.is_file()][:1]
    return found


def _settings(entry: dict[str, Any]) -> list[Setting]:
    """The settings in the entry's order, with what this version knows of them."""
    known = {setting.full: setting for setting in every_setting()}
    rows = []
    for section, fields in entry["settings"].items():
        if isinstance(fields, list):  # the faults
            rows.append(Setting(section, fields, [], "", "what happens while a run goes on", known=True))
            continue
        for field, value in fields.items():
            name = f"{section}.{field}"
            if setting := known.get(name):
                default = plain(setting.default)  # tuples are lists in a summary
                rows.append(Setting(name, value, default, setting.unit, setting.doc, known=True))
            else:
                rows.append(Setting(name, value, None, "", "unknown to this version", known=False))
    return rows
