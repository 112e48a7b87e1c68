"""Reports: one HTML file about a run, a comparison, or several of them, made from what is in their folders.

The file holds its figures and its style; nothing is loaded from anywhere when it is opened.
"""

import base64
import json
import math
import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, cached_property
from pathlib import Path
from typing import Any

import jinja2

from omni_control.errors import OmniError
from omni_mj.files import write as write_file
from omni_mj.measure import causes
from omni_mj.measure.statistics import best
from omni_mj.measure.summary import read as read_summary
from omni_mj.measure.table import DASH, where
from omni_mj.scenarios.settings import every_setting
from omni_mj.show.style import ERROR_AXES, FIGURES

TEMPLATES = Path(__file__).parent / "templates"
TYPES = {".svg": "image/svg+xml", ".png": "image/png"}
STATISTICS = {"max": "Maximum error", "p99": "99th percentile of the error", "mean": "Mean error"}
MAIN = ("max", "mean")  # statistics that the paper reports and that verdicts judge
MINUS = "\N{MINUS SIGN}"
PEAKS = {
    "peak_voltage_v": "Peak voltage in V",
    "peak_current_a": "Peak current in A",
    "peak_winding_c": "Peak winding in °C",
}
Results = Mapping[str, Any]  # of a scenario's entry in a summary, by controller


@dataclass(frozen=True)
class Run:
    """A scenario that was run, or should have been.

    Args:
        label: Name in comparisons, unlike any other's.
        name: Name of the scenario.
        summary: Summary that it is in.
        folder: Folder of the summary.
        figures: Data URIs of its figures, by name.
    """

    label: str
    name: str
    summary: dict[str, Any]
    folder: Path
    figures: dict[str, str]

    @property
    def entry(self) -> dict[str, Any]:
        """What the summary says of it."""
        return self.summary["scenarios"][self.name]

    @property
    def file(self) -> str:
        """Path of its scenario's file in the folder."""
        return f"scenarios/{self.name}.toml" if len(self.summary["scenarios"]) > 1 else "scenario.toml"

    @property
    def scenario(self) -> str:
        """Text of that file, if there is one."""
        path = self.folder / self.file
        return path.read_text(encoding="utf-8", errors="replace") if path.is_file() else ""

    @property
    def seeds(self) -> list[int]:
        """Seeds that it was run with, or might have been."""
        return self.entry["seeds"] or self.summary["seeds"]

    @property
    def complete(self) -> bool:
        """Whether it was run to its end, perhaps not in all rows."""
        return self.entry["status"] == "done"

    @property
    def reason(self) -> str:
        """Why it is not complete."""
        return self.entry["reason"] or self.summary["stopped"] or "no reason is known"

    @cached_property
    def settings(self) -> list[dict[str, Any]]:
        """Its settings, and what this version knows of them."""
        declared = {setting.full: setting for setting in every_setting()}
        rows = []
        for section, fields in self.entry["settings"].items():
            is_list = isinstance(fields, list)  # of faults
            for name, value in {section: fields}.items() if is_list else fields.items():
                setting = declared.get(f"{section}.{name}")
                row = {"name": name if is_list else f"{section}.{name}", "value": value, "default": None}
                if setting is None:  # faults, or parameters of a controller
                    rows.append(row | {"unit": "", "doc": "", "changed": bool(value)})
                else:
                    default = json.loads(json.dumps(setting.default))  # tuples are lists in a summary
                    row |= {"default": default, "unit": setting.unit, "doc": setting.doc}
                    rows.append(row | {"changed": default not in (None, value)})
        return rows

    def best(self, statistic: str) -> str | None:
        """Return the controller with the least mean error in the plane, of those that do not know the truth."""
        competitors = [name for name in self.summary["controllers"] if name not in self.summary["informed"]]
        return best(self.entry["results"], competitors, statistic)

    def errors(self) -> dict[str, dict[str, dict[str, dict[str, Any]]]]:
        """Return cells by axis, controller and statistic."""
        results = self.entry["results"]
        axes = ERROR_AXES if results else {}
        return {axis: {name: {s: self._cell(axis, name, s) for s in STATISTICS} for name in results} for axis in axes}

    def _cell(self, axis: str, controller: str, statistic: str) -> dict[str, Any]:
        """Return the spread of an error, its share of the largest median, its reduction, and the paper's."""
        results, paper = self.entry["results"], self.entry["paper"] or {}
        spreads = {name: result[ERROR_AXES[axis].part][axis][statistic] for name, result in results.items()}
        largest = max((spread["median"] for spread in spreads.values() if spread["median"] is not None), default=0.0)
        printed = {name: axes[axis].get(statistic) for name, axes in paper.items() if axis in axes}
        base, of_paper = next(iter(printed.values()), None), printed.get(controller)
        is_first = next(iter(printed), None) == controller
        reductions = results[controller]["reduction_percent"] or {}
        return {
            "axis": ERROR_AXES[axis],
            "statistic": statistic,
            "error": spreads[controller],
            "share": (spreads[controller]["median"] or 0.0) / largest if largest else 0.0,
            "reduction": reductions.get(axis, {}).get(statistic),
            "paper": of_paper,
            "paper_reduction": 100 * (1 - of_paper / base) if of_paper and base and not is_first else None,
        }


@dataclass(frozen=True)
class Source:
    """A folder: its label, its summary, and what was run."""

    label: str
    summary: dict[str, Any]
    runs: list[Run]


def write(folders: Sequence[Path], out: Path) -> None:
    """Write the report about what is in `folders` to the file `out`.

    Args:
        folders: Folders of runs, comparisons, or both.
        out: An HTML file.

    Raises:
        OmniError: A folder holds no summary, or one that cannot be read.
    """
    names = [Path(os.path.realpath(folder)).name for folder in folders]
    labels = names if len(set(names)) == len(names) else list(map(str, folders))
    try:
        sources = [_source(folder, label, len(folders) == 1) for folder, label in zip(folders, labels, strict=True)]
        html = _render(sources)
    except OmniError:
        raise
    except (jinja2.UndefinedError, LookupError, TypeError, AttributeError, ValueError, ArithmeticError):
        named = ", ".join(map(str, folders))
        raise OmniError(f"summary.json in {named} is not of this version, or was changed; make the run again") from None
    write_file(out, html)


def _source(folder: Path, label: str, alone: bool) -> Source:
    summary = read_summary(folder)
    several = len(summary["scenarios"]) > 1
    figures = {}
    for path in (folder / "figures" / f"{name}{kind}" for name in FIGURES for kind in TYPES):
        if not several and path.is_file() and path.stem not in figures:
            figures[path.stem] = _data_uri(path.read_bytes(), path.suffix)
    labels = {name: label if not several else name if alone else f"{label}: {name}" for name in summary["scenarios"]}
    return Source(label, summary, [Run(labels[name], name, summary, folder, figures) for name in labels])


def _render(sources: Sequence[Source]) -> str:
    runs = [run for source in sources for run in source.runs]
    title = f"Comparison of {len(runs)} {'scenarios' if len(sources) == 1 else 'runs'}"
    if len(runs) == 1:
        title = f"{runs[0].name}, {where(runs[0].entry)}"
    entries = {run.label: run.entry for run in runs if run.entry["results"]}
    comparison = None
    if len(entries) > 1:
        from omni_mj.show import figures  # which loads matplotlib

        informed = tuple(dict.fromkeys(name for run in runs for name in run.summary["informed"]))
        comparison = _data_uri(figures.comparison_svg(entries, informed), ".svg")
    return _template().render(title=title, sources=sources, runs=runs, comparison=comparison)


@cache
def _template() -> jinja2.Template:
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(TEMPLATES), autoescape=True, undefined=jinja2.StrictUndefined,
        trim_blocks=True, lstrip_blocks=True,
    )  # fmt: skip
    environment.filters |= {"number": number, "change": change, "plain": plain}
    environment.globals |= {"STATISTICS": STATISTICS, "MAIN": MAIN, "AXES": ERROR_AXES, "matrix": matrix}
    environment.globals |= {"peaks": peaks, "reasons": reasons, "differing": differing}
    return environment.get_template("report.html.j2")


def _data_uri(image: bytes, suffix: str) -> str:
    return f"data:{TYPES[suffix]};base64,{base64.b64encode(image).decode()}"


def matrix(runs: Sequence[Run], statistic: str) -> tuple[list[str], list[tuple[Run, list[dict[str, Any] | None]]]]:
    """Return the controllers, and for each run the spreads of their errors in the plane."""
    columns = dict.fromkeys(name for run in runs for name in run.entry["results"] or run.summary["controllers"])
    rows = []
    for run in runs:
        errors = {name: result["error_m"] for name, result in run.entry["results"].items()}
        rows.append((run, [errors[name]["distance"][statistic] if name in errors else None for name in columns]))
    return list(columns), rows


def peaks(results: Results) -> dict[str, dict[str, float | None]]:
    """Return controllers' extremes by their labels, as far as they are known."""
    return _known(results, PEAKS, lambda result, key: result.get(key))


def reasons(results: Results) -> dict[str, dict[str, float | None]]:
    """Return medians of why controllers stray by their labels, as far as they are known."""
    return _known(results, causes.NAMES, lambda result, key: result["why"][key]["median"])


def _known(
    results: Results, labels: Mapping[str, str], value: Callable[[Any, str], float | None]
) -> dict[str, dict[str, float | None]]:
    rows = {label: {name: value(result, key) for name, result in results.items()} for key, label in labels.items()}
    return {label: row for label, row in rows.items() if any(value is not None for value in row.values())}


def differing(runs: Sequence[Run]) -> list[tuple[str, list[Any]]]:
    """Return the settings, robot and plant in which runs differ, with each one's value."""
    values = [
        {"plant": run.entry["plant"], "robot": run.entry["robot"]} | {s["name"]: s["value"] for s in run.settings}
        for run in runs
    ]
    names: Iterable[str] = dict.fromkeys(name for settings in values for name in settings)
    rows = [(name, [settings.get(name) for settings in values]) for name in names]
    return [(name, row) for name, row in rows if any(value != row[0] for value in row)]


def number(value: float | None, digits: int = 2, factor: float = 1.0) -> str:
    """Return a number as text; a dash if there is none."""
    if value is None or math.isnan(value):
        return DASH
    return f"{factor * value:.{digits}f}".replace("-", MINUS)


def change(reduction_percent: float | None) -> str:
    """Return a reduction as the change it is, such as −35 %."""
    if reduction_percent is None or math.isnan(reduction_percent):
        return DASH
    return f"{-round(reduction_percent):+d} %".replace("-", MINUS).replace("+0", "0")


def plain(value: Any) -> str:
    """Return a setting's value as in a scenario file, without the quotes of a string; a dash if there is none."""
    return DASH if value is None else value if isinstance(value, str) else json.dumps(value)
