"""Tables of a comparison: errors, verdicts, and notes about runs without a result."""

from collections.abc import Iterable, Iterator, Mapping
from textwrap import fill
from typing import Any

from omni_mj.results.paired_comparison import SIGNIFICANCE_LEVEL, STATISTIC_LABELS
from omni_mj.results.result_tables import Summary, controller_label, format_mean_cm, results_table
from omni_mj.results.text_table import (
    DASH,
    TERMINAL_WIDTH,
    Table,
    escape_markdown_cell,
    format_markdown,
    format_table,
)

CAPTION = (
    "settled: settling time, s after the end of the reference's last move (number of seeds that "
    "settle, if not all do). compare.md has the effort of the commands and all definitions."
)
WITHIN_CHANCE = "?"  # mark of a difference that chance may explain


def print_comparison(summary: Summary) -> None:
    """Print the errors, the verdicts, and a note for each scenario or row without result."""
    errors, verdicts = results_table(summary, paper=False), verdict_table(summary)
    if errors.rows:
        print(format_table(errors))
        print(fill(CAPTION, TERMINAL_WIDTH), end="\n\n")
    if verdicts.rows:
        print(format_table(verdicts))
        print(fill(_verdict_caption(summary), TERMINAL_WIDTH), end="\n\n")
    for line in _list_missing(summary):
        print(f"note: {line}")


def to_markdown(summary: Summary) -> str:
    """Return the tables, notes and definitions of a comparison as Markdown."""
    errors, verdicts = results_table(summary, effort=True), verdict_table(summary)
    blocks = [
        f"# {errors.title}",
        f"`{summary['repeat_command']}`" if summary["repeat_command"] else "",
        _bullet_list(_list_missing(summary)),
    ]
    if verdicts.rows:
        blocks += [f"## {verdicts.title}", _verdict_caption(summary), format_markdown(verdicts)]
    for statistic, label in STATISTIC_LABELS.items():
        heading = f"## {label.capitalize()} position error in cm"
        blocks += [heading, _error_matrix(summary, statistic)]
    definitions = summary["definitions"].items()
    blocks += [
        "## Errors, effort and settling",
        format_markdown(errors) if errors.rows else "",
        "## Definitions",
        _bullet_list(f"**{name}**: {definition}" for name, definition in definitions),
        ", ".join(f"{name} {version}" for name, version in summary["versions"].items()),
    ]
    return "\n\n".join(block for block in blocks if block) + "\n"


def _error_matrix(summary: Summary, statistic: str) -> str:
    """Return position errors by scenario and controller as Markdown.

    A cell holds the mean over the seeds, half the width of its 95 % interval, and the number of
    failures.
    """
    rows = []
    for scenario, entry in summary["scenarios"].items():
        errors = {}
        for name, result in entry["results"].items():
            failed = f" ({result['n_failed']} failed)" if result["n_failed"] else ""
            errors[name] = format_mean_cm(result["error_m"]["position"][statistic]) + failed
        rows.append([scenario, *(errors.get(name, DASH) for name in summary["controllers"])])
    labels = [controller_label(summary, name) for name in summary["controllers"]]
    return format_markdown(Table("", ["", *labels], rows, 1))


def verdict_table(summary: Summary) -> Table:
    """Return a table of the subject's errors relative to those of each other controller.

    Each scenario has two rows, one for the maximum error and one for the mean error. Privileged
    controllers are left out.
    """
    subject = summary["subject"]
    baselines = [
        name for name in summary["controllers"] if name not in (subject, *summary["privileged"])
    ]
    rows = []
    for scenario, entry in summary["scenarios"].items():
        for statistic, errors in (entry["verdict"] or {"errors": {}})["errors"].items():
            changes = [_format_change(errors["against"].get(name)) for name in baselines]
            beats = f"{len(errors['beats'])} of {len(errors['against'])}"
            best = errors["best_competitor"] or DASH
            rows.append([scenario, STATISTIC_LABELS[statistic], *changes, beats, best])
    baseline_headings = [f"vs {name}" for name in baselines]
    headings = ["scenario", "error", *baseline_headings, "beats", "best of the others"]
    return Table(f"Verdicts on {subject}", headings, rows, 2)


def _verdict_caption(summary: Summary) -> str:
    """Return the sentence that explains the numbers of the verdict table."""
    return (
        f"Position error of {summary['subject']} (mean over the seeds) relative to each other "
        f"controller's, change in %; {WITHIN_CHANCE}: not significant (paired by seed, p above "
        f"{100 * SIGNIFICANCE_LEVEL:g} % after Holm's correction for all verdicts). Privileged "
        "controllers are not compared."
    )


def _format_change(comparison: Mapping[str, Any] | None) -> str:
    """Return the change of an error in %, marked if chance may explain it."""
    if comparison is None or comparison["ratio"] is None:
        return DASH
    mark = "" if comparison["significant"] else f" {WITHIN_CHANCE}"
    return f"{100 * (comparison['ratio'] - 1):+.0f}{mark}"


def _list_missing(summary: Summary) -> Iterator[str]:
    """Yield a line for each scenario that was not finished and each row that failed."""
    for name, entry in summary["scenarios"].items():
        if entry["status"] != "done":
            reason = entry["reason"] or summary["stopped"] or "not yet"
            yield f"{name}: {entry['status']}: {reason}"
        for row in entry["failures"]:
            cause = " ".join(row["cause"].split())
            robot = f"{name}: {row['controller']}, seed {row['seed']}"
            yield f"{robot}: {cause} at {row['time_s']:.3f} s"


def _bullet_list(lines: Iterable[str]) -> str:
    return "\n".join(f"- {escape_markdown_cell(line)}" for line in lines)
