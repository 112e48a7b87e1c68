"""`omni-mj report DIR...`: one HTML file about one run or several, made from what is in their folders.

The file holds its figures and its style; nothing is loaded from anywhere when it is opened.
"""

import base64
import json
import math
import tomllib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import click
import jinja2

from omni_control.errors import OmniError
from omni_mj.cli import console
from omni_mj.measure.metrics import AXES
from omni_mj.scenarios.nested import plain
from omni_mj.scenarios.settings import every_setting
from omni_mj.show import figures, listing

TEMPLATES = Path(__file__).with_name("templates")
STATISTICS = {"max": "Maximum error", "mean": "Mean error"}
UNKNOWN = "unknown to this version"
TYPES = {".svg": "image/svg+xml", ".png": "image/png"}
# What a summary must hold, and as what.
PARTS: dict[str, type | tuple[type, ...]] = {
    **dict.fromkeys(("scenario", "description", "plant"), str),
    **dict.fromkeys(("controllers", "seeds", "events"), list),
    **dict.fromkeys(("results", "definitions", "settings", "versions"), dict),
    **dict.fromkeys(("frames", "simulated_s", "wall_s"), (int, float)),
    "complete": bool,
}
DASH, MINUS = "\N{EN DASH}", "\N{MINUS SIGN}"
UNITS = {"_v": "V", "_a": "A", "_c": "°C", "_w": "W", "_j": "J", "_s": "s", "_m": "m", "_m_s": "m/s", "_percent": "%"}


@dataclass(frozen=True)
class Cell:
    """One statistic of one controller along one axis.

    Attributes:
        statistic: its key in the summary.
        error: median, least and greatest over the seeds, m.
        share: the median as a share of the greatest that any controller has.
        reduction: in per cent, of this median against the first controller's; None for the first.
        paper, paper_reduction: the same in the paper, or None.
    """

    statistic: str
    error: dict[str, float]
    share: float
    reduction: float | None
    paper: float | None
    paper_reduction: float | None


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
    """What the report says of one run.

    Attributes:
        folder: where it is.
        label: what it is called in comparisons, unlike any other run's.
        summary: its summary.json.
        scenario: its scenario.toml, or nothing.
        paper_table: the table of the paper that reports the same experiment, or 0.
    """

    folder: Path
    label: str
    summary: dict[str, Any]
    scenario: str
    paper_table: int
    figures: list[Figure]
    settings: list[Setting]

    @property
    def errors(self) -> dict[str, dict[str, list[Cell]]]:
        """Axis -> controller -> one cell per statistic."""
        results, paper = self.summary["results"], self.summary.get("paper") or {}
        axes = AXES if results else ()
        return {axis: {c: [_cell(results, paper, c, axis, s) for s in STATISTICS] for c in results} for axis in axes}

    @property
    def peaks(self) -> dict[str, dict[str, float | None]]:
        """What a summary says of a controller in a single number, labelled with its unit -> controller -> value."""
        results = self.summary["results"]
        keys = [k for k, v in next(iter(results.values()), {}).items() if k.startswith("peak_")]
        return {_with_unit(key): {c: results[c].get(key) for c in results} for key in keys}


def write(folders: Sequence[Path], out: Path) -> None:
    """Write the report about the runs in `folders` to the file `out`.

    Raises:
        OmniError: a folder holds no run, or one that cannot be read.
    """
    names = [folder.resolve().name for folder in folders]
    unique = len(set(names)) == len(names)
    runs = [_read(folder, name if unique else str(folder)) for folder, name in zip(folders, names, strict=True)]
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(TEMPLATES), autoescape=True, undefined=jinja2.StrictUndefined,
        trim_blocks=True, lstrip_blocks=True,
    )  # fmt: skip
    environment.filters |= {"number": _number, "change": _change, "plain": _plain}
    comparison = None
    if sum(bool(run.summary["results"]) for run in runs) > 1:
        comparison = _data_uri(figures.comparison_svg({run.label: run.summary for run in runs}), ".svg")
    try:
        html = environment.get_template("report.html.j2").render(
            runs=runs, comparison=comparison, differing=_differing(runs), statistics=STATISTICS
        )
    except jinja2.UndefinedError as error:
        raise OmniError(f"a summary.json is not of this version: {error}; make the run again") from None
    out.write_text(html, encoding="utf-8")


def _read(folder: Path, label: str) -> Run:
    path = folder / "summary.json"
    try:
        summary = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise OmniError(f"{folder} holds no run: {path.name}: {error.strerror}; give the folder of a run") from None
    except ValueError as error:
        raise OmniError(f"{path} is not a run's summary: {error}") from None
    wrong = [k for k, kind in PARTS.items() if not isinstance(summary, dict) or not isinstance(summary.get(k), kind)]
    if wrong:
        raise OmniError(f"{path} is not a run's summary: {', '.join(wrong)} missing or wrong; make the run again")
    toml = folder / "scenario.toml"
    scenario = toml.read_text(encoding="utf-8", errors="replace") if toml.is_file() else ""
    return Run(folder, label, summary, scenario, _paper_table(scenario), _figures(folder), _settings(summary))


def _paper_table(scenario: str) -> int:
    try:
        table = tomllib.loads(scenario).get("paper_table", 0)
    except tomllib.TOMLDecodeError:
        return 0
    return table if table in (3, 4) else 0


def _figures(folder: Path) -> list[Figure]:
    paths = [(name, folder / "figures" / f"{name}{kind}", kind) for name in figures.NAMES for kind in TYPES]
    found = {name: (path, kind) for name, path, kind in reversed(paths) if path.is_file()}
    return [
        Figure(name, _data_uri(found[name][0].read_bytes(), found[name][1])) for name in figures.NAMES if name in found
    ]


def _data_uri(image: bytes, kind: str) -> str:
    return f"data:{TYPES[kind]};base64,{base64.b64encode(image).decode()}"


def _settings(summary: dict[str, Any]) -> list[Setting]:
    """The run's settings in its order, with what this version knows of them."""
    known = {each.full: each for each in every_setting()}
    rows = []
    for section, fields in summary["settings"].items():
        for field, value in fields.items():
            name = f"{section}.{field}"
            if name in known:
                default = plain(known[name].default)
                rows.append(Setting(name, value, default, known[name].unit, known[name].doc, True))
            else:
                rows.append(Setting(name, value, None, "", UNKNOWN, False))
    return rows


def _differing(runs: list[Run]) -> list[tuple[str, list[Any]]]:
    """The settings, and the plant, in which the runs differ, with each run's value."""
    values = [{"plant": run.summary["plant"]} | {s.name: s.value for s in run.settings} for run in runs]
    names = dict.fromkeys(name for each in values for name in each)
    rows = [(name, [each.get(name) for each in values]) for name in names]
    return [(name, row) for name, row in rows if any(value != row[0] for value in row)]


def _cell(results: dict[str, Any], paper: dict[str, Any], controller: str, axis: str, statistic: str) -> Cell:
    error = results[controller]["error_m"][axis][statistic]
    greatest = max(result["error_m"][axis][statistic]["median"] for result in results.values())
    reductions = results[controller]["reduction_percent"]
    printed = {name: axes[axis][statistic] for name, axes in paper.items() if axis in axes}
    base = next(iter(printed.values()), None)
    of_paper = printed.get(controller)
    first = next(iter(printed), None) == controller
    return Cell(
        statistic,
        error,
        error["median"] / greatest if greatest else 0.0,
        reductions[axis][statistic] if reductions else None,
        of_paper,
        100 * (1 - of_paper / base) if of_paper is not None and base and not first else None,
    )


def _with_unit(key: str) -> str:
    suffix = max((s for s in UNITS if key.endswith(s)), key=len, default="")
    words = key.removesuffix(suffix).replace("_", " ")
    return f"{words.capitalize()} in {UNITS[suffix]}" if suffix else words.capitalize()


def _number(value: float | None, digits: int = 2, factor: float = 1.0) -> str:
    """A number as text; a dash where there is none."""
    if value is None or math.isnan(value):
        return DASH
    return f"{factor * value:.{digits}f}".replace("-", MINUS)


def _change(reduction_percent: float | None) -> str:
    """A reduction as the change it is: −35 %."""
    if reduction_percent is None or math.isnan(reduction_percent):
        return DASH
    return f"{-round(reduction_percent):+d} %".replace("-", MINUS).replace("+0", "0")


def _plain(value: Any) -> str:
    """A setting's value; a dash where a run has no such setting."""
    return DASH if value is None else listing.short(value)


@click.command("report")
@click.argument("folders", metavar="DIR...", nargs=-1, type=click.Path(path_type=Path))
@click.option(
    "--out", type=click.Path(path_type=Path), metavar="FILE.html", help="[DIR/report.html or comparison.html]"
)
def command(folders: tuple[Path, ...], out: Path | None) -> None:
    """Write a report about a run, or one that compares several."""
    if not folders:
        raise OmniError("report needs the folder of a run, or several: omni-mj report runs/NAME...")
    if out is None:
        out = folders[0] / "report.html" if len(folders) == 1 else Path("comparison.html")
    if out.suffix.lower() not in (".html", ".htm"):
        raise OmniError(f"--out {out} must be a file whose name ends in .html")
    write(folders, out)
    print(f"report in {out}")


if __name__ == "__main__":
    console.invoke(command)
