"""Reports: one HTML page about a run, or one that compares several.

The page is made from the files in the folders of the runs. It contains its figures and its style
sheet, so a browser loads nothing else.
"""

import base64
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import jinja2

from omni_control.errors import OmniError
from omni_mj.files import write_text
from omni_mj.results.result_tables import (
    describe_plant,
    format_number,
    recovery_table,
    results_table,
)
from omni_mj.results.summary import read_summary
from omni_mj.results.summary_sentence import summary_sentence
from omni_mj.studies.compare.compare_table import verdict_table
from omni_mj.viz import report_tables

# File names of figures in the order of the page; the first one shows the finding.
FIGURES = ("compare", "seeds", "error", "path", "command", "alpha")
Summary = dict[str, Any]
ENVIRONMENT = jinja2.Environment(  # compiles a template once
    loader=jinja2.FileSystemLoader(Path(__file__).parent / "templates"),
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
    names = [Path(os.path.realpath(folder)).name for folder in folders]
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
        "results": results_table(summary, effort=True),
        "recovery": recovery_table(summary),
        "verdicts": verdict_table(summary),
        "settings": report_tables.settings_table(entries),
    }
    if len(entries) == 1:
        page |= _describe_single_run(folders[0], entries)
    else:
        # Imported here because matplotlib takes long to import.
        from omni_mj.studies.compare.compare_figure import save_comparison_figure

        kind = "scenarios" if len(summaries) == 1 else "runs"
        page["title"] = f"Comparison of {len(entries)} {kind}"
        with TemporaryDirectory() as folder:
            save_comparison_figure(summary, Path(folder) / "compare")
            page["figures"] = _encode_images(Path(folder))
    return ENVIRONMENT.get_template("report.html.j2").render(page)


def _describe_single_run(folder: Path, entries: Mapping[str, Summary]) -> dict[str, Any]:
    """Return the parts of a page about a single scenario, whose name is the key of `entries`."""
    ((name, entry),) = entries.items()
    file = folder / "scenario.toml"
    has_file = file.is_file()
    return {
        "title": f"{name}, {describe_plant(entry)}",
        "figures": _encode_images(folder / "figures"),
        "motors": report_tables.motor_table(entry) if entry["results"] else None,
        "scenario": file.read_text("utf-8", errors="replace") if has_file else "",
    }


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
