"""What `omni-mj compare` says: the table, a matrix of scenarios and controllers, verdicts, what was not done."""

from collections.abc import Callable, Iterable, Iterator
from functools import partial
from typing import Any

from omni_mj.measure import limits
from omni_mj.measure.table import DASH, OVER, Table, label, number, plus_minus, table
from omni_mj.measure.verdict import CHANCE, ERRORS, best
from omni_mj.show import markdown as md
from omni_mj.show import terminal

Summary = dict[str, Any]
WITHIN_CHANCE = "?"
IN_THE_PLANE = {
    "max": "Maximum",
    "p99": "99th percentile of the",
    "mean": "Mean",
}  # statistic -> how its error is called
OF_THE_PATH = ("along", "across")


def show(summary: Summary) -> None:
    """Print the table, the verdicts, and what was missed or not done."""
    found = table(summary)
    if found.rows:
        terminal.show(found)
        print("settled: s after the end of the reference's last move (how many seeds of all do, where not all)")
        if found.headings[-1] == OVER:
            print(f"{OVER}: maximum/mean in the plane, mean over the seeds, over that of the limit")
        print("excess: command effort above what the reference itself needs; compare.md has the definitions\n")
    verdicts = verdict_table(summary)
    if verdicts.rows:
        terminal.show(verdicts)
        print(f"{_caption(summary)}\n")
    for line in _why_not(summary):
        print(f"why not: {line}")
    for line in _not_done(summary):
        print(f"note: {line}")


def markdown(summary: Summary) -> str:
    """The whole of it as Markdown."""
    found, verdicts = table(summary), verdict_table(summary)
    blocks = [f"# {found.title}", f"`{summary['repeat']}`" if summary["repeat"] else ""]
    for statistic, name in IN_THE_PLANE.items():
        text = partial(_mean, statistic)
        blocks += [f"## {name} error in the plane in cm", _matrix(summary, text, statistic)]
    blocks += [_list(_not_done(summary))]
    if verdicts.rows:
        blocks += [f"## {verdicts.title}", _caption(summary), md.table(verdicts.headings, verdicts.rows)]
        blocks += ["What is not beaten:" if _why_not(summary) else "", _list(_why_not(summary))]
    for axis in OF_THE_PATH:
        text = partial(_means, axis)
        blocks += [f"## Error {axis} the path in cm: maximum/mean, means over the seeds", _matrix(summary, text)]
    blocks += ["## Errors, effort and settling", md.table(found.headings, found.rows) if found.rows else ""]
    headings = ["scenario", "", "seeds", "simulated, s", "computed in, s"]
    blocks += ["## Scenarios", md.table(headings, _scenario_rows(summary))]
    blocks += ["## Definitions", _list(f"**{name}**: {text}" for name, text in summary["definitions"].items())]
    blocks += [", ".join(f"{name} {number}" for name, number in summary["versions"].items())]
    return "\n\n".join(block for block in blocks if block) + "\n"


def verdict_table(summary: Summary) -> Table:
    """Two rows a scenario, for maximum and mean error: the subject against every other competitor."""
    subject = summary["subject"]
    rivals = [name for name in _competitors(summary) if name != subject]
    rows = []
    for scenario, verdict in _verdicts(summary).items():
        for i, (statistic, found) in enumerate(verdict["errors"].items()):
            changes = [_change(found["against"].get(name)) for name in rivals]
            beaten = f"{len(found['beats'])} of {len(found['against'])}"
            rows.append(["" if i else scenario, ERRORS[statistic], *changes, beaten, found["best"] or DASH])
    headings = ["scenario", "error", *(f"vs {name}" for name in rivals), "beats", "best of the others"]
    return Table(f"Verdicts on {subject}", headings, rows, 2)


def _caption(summary: Summary) -> str:
    tested = sum(
        pair["p"] is not None
        for verdict in _verdicts(summary).values()
        for errors in verdict["errors"].values()
        for pair in errors["against"].values()
    )
    return (
        f"Error in the plane of {summary['subject']} against each other's, change in %; {WITHIN_CHANCE} within chance:"
        f" paired by seed, p above {100 * CHANCE:g} % after Holm's correction for all {tested} verdicts."
        " Informed controllers are no competitors."
    )


def _verdicts(summary: Summary) -> dict[str, Any]:
    return {name: entry["verdict"] for name, entry in summary["scenarios"].items() if entry["verdict"]}


def _competitors(summary: Summary) -> list[str]:
    return [name for name in summary["controllers"] if name not in summary["informed"]]


def _matrix(summary: Summary, text: Callable[[Summary], str], statistic: str | None = None) -> str:
    """Scenarios x controllers, and beside them the limits that are known.

    Args:
        summary: of the comparison.
        text: what is said of errors.
        statistic: of the error in the plane, by which the best competitor is bold, if it shall be.
    """
    controllers, rows = summary["controllers"], []
    of = {name: limits.of(entry) for name, entry in summary["scenarios"].items()}
    known = [name for name in limits.LIMITS.values() if any(name in each for each in of.values())]
    for scenario, entry in summary["scenarios"].items():
        found = entry["results"]
        first = best(found, _competitors(summary), statistic) if statistic else None
        cells = [_cell(found[name], text, name == first) if name in found else "" for name in controllers]
        cells = cells if found else [entry["status"]] + [""] * (len(controllers) - 1)
        rows.append([scenario, *cells, *(text(of[scenario][name]) if name in of[scenario] else "" for name in known)])
    return md.table(["", *(label(summary, name) for name in controllers), *known], rows)


def _cell(result: Summary, text: Callable[[Summary], str], bold: bool) -> str:
    if result["failed"]:
        return f"failed {result['failed']} of {len(result['effort_m_s2']['seeds'])}"
    return f"**{text(result['error_m'])}**" if bold else text(result["error_m"])


def _mean(statistic: str, errors: Summary) -> str:
    return plus_minus(errors["distance"][statistic], 100)


def _means(axis: str, errors: Summary) -> str:
    return "/".join(number(errors[axis][statistic]["mean"], 100) for statistic in ERRORS)


def _scenario_rows(summary: Summary) -> Iterator[list[str]]:
    for name, entry in summary["scenarios"].items():
        seeds = f"{len(entry['seeds'])}"
        yield [name, entry["description"], seeds, f"{entry['simulated_s']:.1f}", f"{entry['wall_s']:.1f}"]


def _change(pair: Summary | None) -> str:
    if pair is None or pair["ratio"] is None:
        return DASH
    return f"{100 * (pair['ratio'] - 1):+.0f}" + ("" if pair["beyond_chance"] else f" {WITHIN_CHANCE}")


def _why_not(summary: Summary) -> list[str]:
    return [f"{name}: {text}" for name, verdict in _verdicts(summary).items() for text in verdict["why_not"]]


def _not_done(summary: Summary) -> list[str]:
    """Scenarios that were not done, and rows that failed."""
    waiting = summary["stopped"] or "not yet"
    lines = []
    for name, entry in summary["scenarios"].items():
        if entry["status"] != "done":
            lines.append(f"{name}: {entry['status']}: {entry['reason'] or waiting}")
        for row in entry["failed"]:
            cause = " ".join(row["cause"].split())
            lines.append(f"{name}: {row['controller']}, seed {row['seed']}: {cause} at {row['time_s']:.3f} s")
    return lines


def _list(lines: Iterable[str]) -> str:
    return "\n".join(f"- {md.plain(line)}" for line in lines)
