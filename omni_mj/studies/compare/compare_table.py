"""Text of `omni-mj compare`: the table, a matrix of scenarios and controllers, verdicts, what was not done."""

from collections.abc import Iterable, Iterator
from typing import Any

from omni_mj.results.result_tables import DASH, Table, label, plus_minus, table, text
from omni_mj.results.statistics import CHANCE, ERRORS
from omni_mj.viz import markdown_tables

Summary = dict[str, Any]
WITHIN_CHANCE = "?"


def print_comparison(summary: Summary) -> None:
    """Print the table, the verdicts, and what was not done."""
    errors, verdicts = table(summary), verdict_table(summary)
    if errors.rows:
        print(text(errors))
        print(
            "settled: s after the end of the reference's last move (how many seeds of all do, where not all)"
        )
        print(
            "excess: command effort above what the reference itself needs; compare.md has the definitions\n"
        )
    if verdicts.rows:
        print(text(verdicts))
        print(f"{_caption(summary)}\n")
    for line in _not_done(summary):
        print(f"note: {line}")


def to_markdown(summary: Summary) -> str:
    """Return all of it as Markdown."""
    errors, verdicts = table(summary), verdict_table(summary)
    blocks = [f"# {errors.title}", f"`{summary['repeat']}`" if summary["repeat"] else ""]
    blocks += [_list(_not_done(summary))]
    if verdicts.rows:
        blocks += [
            f"## {verdicts.title}",
            _caption(summary),
            markdown_tables.markdown(verdicts.headings, verdicts.rows),
        ]
    for statistic, name in {"max": "Maximum", "mean": "Mean"}.items():
        blocks += [f"## {name} error in the plane in cm", _matrix(summary, statistic)]
    blocks += [
        "## Errors, effort and settling",
        markdown_tables.markdown(errors.headings, errors.rows) if errors.rows else "",
    ]
    blocks += [
        "## Definitions",
        _list(f"**{name}**: {what}" for name, what in summary["definitions"].items()),
    ]
    blocks += [", ".join(f"{name} {number}" for name, number in summary["versions"].items())]
    return "\n\n".join(block for block in blocks if block) + "\n"


def _matrix(summary: Summary, statistic: str) -> str:
    """Return the error in the plane by scenario and controller: mean over the seeds, interval, number of failures."""
    rows = []
    for scenario, entry in summary["scenarios"].items():
        cells = {}
        for name, result in entry["results"].items():
            failed = f" ({result['failed']} failed)" if result["failed"] else ""
            cells[name] = plus_minus(result["error_m"]["distance"][statistic], 100) + failed
        rows.append([scenario, *(cells.get(name, DASH) for name in summary["controllers"])])
    return markdown_tables.markdown(
        ["", *(label(summary, name) for name in summary["controllers"])], rows
    )


def verdict_table(summary: Summary) -> Table:
    """Return two rows a scenario, for maximum and mean error: the subject against every other competitor."""
    subject, rows = summary["subject"], []
    rivals = [
        name for name in summary["controllers"] if name not in (subject, *summary["informed"])
    ]
    for scenario, entry in summary["scenarios"].items():
        for statistic, errors in (entry["verdict"] or {"errors": {}})["errors"].items():
            changes = [_change(errors["against"].get(name)) for name in rivals]
            beaten = f"{len(errors['beats'])} of {len(errors['against'])}"
            rows.append([scenario, ERRORS[statistic], *changes, beaten, errors["best"] or DASH])
    headings = [
        "scenario",
        "error",
        *(f"vs {name}" for name in rivals),
        "beats",
        "best of the others",
    ]
    return Table(f"Verdicts on {subject}", headings, rows, 2)


def _caption(summary: Summary) -> str:
    return (
        f"Error in the plane of {summary['subject']} against each other's, change in %; {WITHIN_CHANCE} within chance:"
        f" paired by seed, p above {100 * CHANCE:g} % after Holm's correction for all verdicts."
        " Informed controllers are no competitors."
    )


def _change(pair: Summary | None) -> str:
    if pair is None or pair["ratio"] is None:
        return DASH
    return f"{100 * (pair['ratio'] - 1):+.0f}" + (
        "" if pair["beyond_chance"] else f" {WITHIN_CHANCE}"
    )


def _not_done(summary: Summary) -> Iterator[str]:
    """Yield a line for each scenario that was not done and each row that failed."""
    for name, entry in summary["scenarios"].items():
        if entry["status"] != "done":
            yield f"{name}: {entry['status']}: {entry['reason'] or summary['stopped'] or 'not yet'}"
        for row in entry["failed"]:
            cause = " ".join(row["cause"].split())
            yield f"{name}: {row['controller']}, seed {row['seed']}: {cause} at {row['time_s']:.3f} s"


def _list(lines: Iterable[str]) -> str:
    return "\n".join(f"- {markdown_tables.escape_cell(line)}" for line in lines)
