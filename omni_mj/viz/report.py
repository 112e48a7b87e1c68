"""Reports: one HTML page about a run, or one that compares several, made from what is in their folders.

The file holds its figures and its style; nothing is loaded from anywhere when it is opened.
"""

import base64
import json
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import jinja2

from omni_control.errors import OmniError
from omni_mj.config.settings import every_setting
from omni_mj.files import write_text as write_file
from omni_mj.results import saturation
from omni_mj.results.result_tables import DASH, Table, describe_plant, format_number, results_table
from omni_mj.results.summary import read_summary
from omni_mj.studies.compare import compare_table

# In the order of the page, the one that shows the finding first.
FIGURES = ("compare", "seeds", "error", "path", "command", "alpha")
STATISTICS = {"max": "maximum", "p99": "99th percentile", "mean": "mean", "rms": "root mean square"}
PEAKS = {
    "peak_voltage_v": "peak, V",
    "peak_current_a": "peak, A",
    "peak_winding_temperature_c": "winding, °C",
}
Summary = dict[str, Any]
ENVIRONMENT = jinja2.Environment(  # compiles a template once
    loader=jinja2.FileSystemLoader(Path(__file__).parent / "templates"),
    autoescape=True,
    undefined=jinja2.StrictUndefined,
    trim_blocks=True,
    lstrip_blocks=True,
)
ENVIRONMENT.filters |= {"number": format_number}


def write_report(folders: Sequence[Path], out: Path) -> None:
    """Write the report about what is in `folders` to the file `out`.

    Args:
        folders: Folders of runs, comparisons, or both.
        out: An HTML file.

    Raises:
        OmniError: A folder holds no summary, or one that cannot be read.
    """
    summaries = [read_summary(folder) for folder in folders]
    names = [Path(os.path.realpath(folder)).name for folder in folders]
    labels = names if len(set(names)) == len(names) else list(map(str, folders))
    try:
        html = _page(folders, dict(zip(labels, summaries, strict=True)))
    except (
        jinja2.UndefinedError,
        LookupError,
        TypeError,
        AttributeError,
        ValueError,
        ArithmeticError,
    ):
        named = ", ".join(map(str, folders))
        raise OmniError(
            f"summary.json in {named} is not of this version, or was changed; make the run again"
        ) from None
    write_file(out, html)


def _page(folders: Sequence[Path], summaries: Mapping[str, Summary]) -> str:
    whole = _merged(summaries)
    entries = whole["scenarios"]
    page: dict[str, Any] = {"summary": whole, "sources": summaries, "scenario": ""}
    page |= {"results": results_table(whole), "verdicts": compare_table.verdict_table(whole)}
    page["settings"] = _differences(entries)
    if len(entries) == 1:
        ((name, entry),) = entries.items()
        page["title"] = f"{name}, {describe_plant(entry)}"
        page["figures"] = _images(folders[0] / "figures")
        if (file := folders[0] / "scenario.toml").is_file():
            page["scenario"] = file.read_text(encoding="utf-8", errors="replace")
    else:
        from omni_mj.studies.compare.compare_figure import save_comparison_figure

        page["title"] = (
            f"Comparison of {len(entries)} {'scenarios' if len(summaries) == 1 else 'runs'}"
        )
        with TemporaryDirectory() as folder:
            save_comparison_figure(whole, Path(folder) / "compare")
            page["figures"] = _images(Path(folder))
    page |= {"statistics": STATISTICS, "causes": saturation.METRIC_LABELS, "peaks": PEAKS}
    return ENVIRONMENT.get_template("report.html.j2").render(page)


def _merged(summaries: Mapping[str, Summary]) -> Summary:
    """Return one summary of several, in which scenarios are called by folder and scenario if need be."""
    merged = dict(next(iter(summaries.values())))
    for key in ("controllers", "privileged", "seeds"):
        merged[key] = list(
            dict.fromkeys(name for summary in summaries.values() for name in summary[key])
        )
    merged["scenarios"] = {}
    for folder, summary in summaries.items():
        for name, entry in summary["scenarios"].items():
            is_only = len(summary["scenarios"]) == 1
            merged["scenarios"][
                name if len(summaries) == 1 else folder if is_only else f"{folder}: {name}"
            ] = entry
    return merged


def _values(entry: Summary) -> dict[str, Any]:
    """Return the settings of a scenario by their full names; faults and controllers' parameters as one value each."""
    values: dict[str, Any] = {}
    for section, fields in entry["settings"].items():
        if isinstance(fields, dict):
            values |= {f"{section}.{name}": value for name, value in fields.items()}
        elif fields:
            values[section] = fields
    return values


def _differences(entries: Mapping[str, Summary]) -> Table:
    """Return the settings in which runs differ, with each one's value; of a single run, from the defaults."""
    columns = {name: _values(entry) for name, entry in entries.items()}
    if len(entries) == 1:
        (values,) = columns.values()  # where there is no default, the robot's value counts as one
        defaults = {setting.full: setting.default for setting in every_setting()}
        defaults |= {
            name: values.get(name) for name, default in defaults.items() if default is None
        }
        columns = {"default": defaults} | columns
        title = "Settings that differ from their default"
    else:
        for name, entry in entries.items():
            columns[name] |= {key: entry[key] for key in ("plant", "robot")}
        title = "Settings in which they differ"
    names = dict.fromkeys(name for values in columns.values() for name in values)
    rows = [[name, *(shown(values.get(name)) for values in columns.values())] for name in names]
    return Table(
        title,
        ["setting", *columns],
        [row for row in rows if len(set(row[1:])) > 1],
        1 + len(columns),
    )


def _images(folder: Path) -> dict[str, str]:
    """Return the figures in a folder by name, as data URIs."""
    files = {name: folder / f"{name}.png" for name in FIGURES}
    images = {
        name: base64.b64encode(path.read_bytes()).decode()
        for name, path in files.items()
        if path.is_file()
    }
    return {name: f"data:image/png;base64,{image}" for name, image in images.items()}


def shown(value: Any) -> str:
    """Return a setting's value as in a scenario file, without the quotes of a string; a dash if there is none."""
    return DASH if value is None else value if isinstance(value, str) else json.dumps(value)
