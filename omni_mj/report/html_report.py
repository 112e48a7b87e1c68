"""Reports: one HTML page about a run, or one that compares several.

The page is made from the files in the folders of the runs. It contains its figures and its style
sheet, so a browser loads nothing else.
"""

import base64
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import jinja2

from omni_control.errors import OmniError
from omni_mj.config.faults import WHEELED_PLANTS
from omni_mj.config.settings import list_settings
from omni_mj.io.atomic_files import write_text
from omni_mj.results import result_tables
from omni_mj.results.result_tables import Summary
from omni_mj.results.saturation import METRIC_LABELS
from omni_mj.results.summary import Entry, flatten, read_summary
from omni_mj.results.summary_sentence import summary_sentence
from omni_mj.results.text_table import DASH, Table, drop_equal_columns, format_number
from omni_mj.studies.compare_table import verdict_table

# File names of figures in the order of the page; the first one shows the finding.
FIGURES = ("compare", "seeds", "error", "path", "command", "alpha")
PEAKS = {  # largest value of all motors -> heading
    "peak_voltage_v": "peak, V",
    "peak_current_a": "peak, A",
    "peak_winding_temperature_c": "winding, °C",
}
DISPLACEMENT_RATIOS = ("displacement ratio x", "displacement ratio y")
ENVIRONMENT = jinja2.Environment(  # compiles a template once
    loader=jinja2.PackageLoader("omni_mj.report"),
    autoescape=True,
    undefined=jinja2.StrictUndefined,
    trim_blocks=True,
    lstrip_blocks=True,
)
ENVIRONMENT.filters["number"] = format_number
# Exceptions caused by a summary with missing or changed content.
SUMMARY_ERRORS = (
    jinja2.UndefinedError,
    LookupError,
    TypeError,
    AttributeError,
    ValueError,
    ArithmeticError,
)


def write_report(folders: Sequence[Path], out: Path) -> None:
    """Write a report about the runs in `folders` to the file `out`.

    Args:
        folders: Folders of runs, comparisons, or both.
        out: HTML file.

    Raises:
        OmniError: A folder has no summary, or one that cannot be read.
    """
    summaries = [read_summary(folder) for folder in folders]
    names = [folder.resolve().name for folder in folders]
    labels = names if len(set(names)) == len(names) else list(map(str, folders))
    try:
        html = _render_page(folders, dict(zip(labels, summaries, strict=True)))
    except SUMMARY_ERRORS:
        folder_list = ", ".join(map(str, folders))
        raise OmniError(
            f"summary.json in {folder_list} is not of this version, or was changed;"
            " make the run again"
        ) from None
    write_text(out, html)


def _render_page(folders: Sequence[Path], summaries: Mapping[str, Summary]) -> str:
    """Return the HTML of a report.

    Args:
        folders: Folders of runs or comparisons.
        summaries: Label of each folder and its summary, in the order of the folders.
    """
    summary = _merge_summaries(summaries)
    entries = summary["scenarios"]
    page: dict[str, Any] = {
        "summary": summary,
        "sources": summaries,
        "sentence": summary_sentence(summary),
        "results": result_tables.results_table(summary, effort=True),
        "recovery": result_tables.recovery_table(summary),
        "verdicts": verdict_table(summary),
        "settings": _settings_table(entries),
    }
    if len(entries) == 1:
        ((name, entry),) = entries.items()
        file = folders[0] / "scenario.toml"
        page |= {
            "title": f"{name}, {result_tables.describe_plant(entry)}",
            "figures": _encode_images(folders[0] / "figures"),
            "motors": _motor_table(entry) if entry["results"] else None,
            "scenario": file.read_text("utf-8", errors="replace") if file.is_file() else "",
        }
    else:
        # Imported here because matplotlib takes long to import.
        from omni_mj.studies.compare_figure import save_comparison_figure

        kind = "scenarios" if len(summaries) == 1 else "runs"
        page["title"] = f"Comparison of {len(entries)} {kind}"
        with TemporaryDirectory() as folder:
            save_comparison_figure(summary, Path(folder) / "compare")
            page["figures"] = _encode_images(Path(folder))
    return ENVIRONMENT.get_template("report.html.j2").render(page)


def _merge_summaries(summaries: Mapping[str, Summary]) -> Summary:
    """Return one summary with the scenarios of all, by label.

    If there are several summaries, the name of a scenario begins with the label of its summary.
    """
    merged = dict(next(iter(summaries.values())))
    for key in ("controllers", "privileged", "seeds"):
        values = [value for summary in summaries.values() for value in summary[key]]
        merged[key] = list(dict.fromkeys(values))
    merged["scenarios"] = {}
    for label, summary in summaries.items():
        for name, entry in summary["scenarios"].items():
            if len(summaries) > 1:
                name = label if len(summary["scenarios"]) == 1 else f"{label}: {name}"
            merged["scenarios"][name] = entry
    return merged


def _encode_images(folder: Path) -> dict[str, str]:
    """Return the figures in a folder by name, as data URIs."""
    images = {}
    for name in FIGURES:
        file = folder / f"{name}.png"
        if file.is_file():
            data = base64.b64encode(file.read_bytes()).decode()
            images[name] = f"data:image/png;base64,{data}"
    return images


def _motor_table(entry: Entry) -> Table:
    """Return effort, limits reached, peaks of the motors and displacement ratios."""
    limits = [f"{label}, %" for label in METRIC_LABELS.values()]
    headings = ["controller", "effort, m/s²", *limits, *PEAKS.values(), *DISPLACEMENT_RATIOS]
    rows = []
    for controller, result in entry["results"].items():
        fractions = [result["saturation"][name]["median"] for name in METRIC_LABELS]
        alphas = [(result["alpha"] or {}).get(axis, {}).values() for axis in "xy"]
        rows.append(
            [
                controller,
                format_number(result["effort_m_s2"]["median"]),
                *(format_number(fraction, 100, 1) for fraction in fractions),
                *(format_number(result[name]) for name in PEAKS),
                *("/".join(map(format_number, percentiles)) for percentiles in alphas),
            ]
        )
    title = (
        "Effort; percentage of the frames in which a limit is reached, and mean duty cycle; peaks "
        "of all motors and seeds; 5th/50th/95th percentile of the displacement ratio in windows of "
        "0.25 s (the paper's alpha: 0.7 to 1)"
    )
    return drop_equal_columns(Table(title, headings, rows, 1), kept_headings=DISPLACEMENT_RATIOS)


def _settings_table(entries: Mapping[str, Entry]) -> Table:
    """Return the settings in which scenarios differ, or those of one that are not the default."""
    columns = {name: dict(flatten(entry["settings"])) for name, entry in entries.items()}
    if len(entries) == 1:
        title = "Settings that differ from their default"
        (settings,) = columns.values()
        defaults: dict[str, Any] = {"fault": []}
        for setting in list_settings():
            name, default = setting.full_name, setting.default
            # A setting without a default depends on the robot, whose value counts as the default.
            defaults[name] = settings.get(name) if default is None else default
        # Types of JSON, as in the summary.
        columns = {"default": json.loads(json.dumps(defaults))} | columns
    else:
        title = "Settings in which they differ"
        for name, entry in entries.items():
            columns[name] |= {"plant": entry["plant"], "robot": entry["robot"]}
    names = list(dict.fromkeys(name for values in columns.values() for name in values))
    if all(entry["plant"] in WHEELED_PLANTS for entry in entries.values()):
        names = [name for name in names if not name.startswith("kinematic.")]
    rows = []
    for name in names:
        values = [column.get(name) for column in columns.values()]
        if any(value != values[0] for value in values):
            rows.append([name, *map(_format_setting, values)])
    return Table(title, ["setting", *columns], rows, 1 + len(columns))


def _format_setting(value: Any) -> str:
    """Return a setting's value as in a scenario file but without quotes, or a dash if None."""
    if value is None:
        return DASH
    return value if isinstance(value, str) else json.dumps(value)
