"""The table of `omni-mj compare`, for the terminal and as Markdown."""

import sys
from collections.abc import Iterable, Iterator, Sequence
from typing import Any

from rich.box import SIMPLE
from rich.console import Console
from rich.table import Table

from omni_mj.measure.compare_statistics import BASELINES, CONTENDERS, ERRORS, MARGIN, SUBJECT, best
from omni_mj.measure.metrics import AXES
from omni_mj.show.markdown import plain
from omni_mj.show.markdown import table as markdown_table

Result = dict[str, Any]
WITHIN_CHANCE = "?"
VERDICT_HEADINGS = ["scenario", "error", *(f"vs {name}" for name in (*BASELINES, *CONTENDERS))]
VERDICT_HEADINGS += ["beats", f"within {100 * MARGIN:g} %"]
VERDICT_TITLE = f"Verdicts on {SUBJECT}"
VERDICT_CAPTION = (
    f"Its error against each other's, change in %; {WITHIN_CHANCE} within chance (95 %, paired by seed). Beats all of"
    f" {', '.join(BASELINES)}? Within {100 * MARGIN:g} % of the better of {', '.join(CONTENDERS)}?"
)


def show(result: Result) -> None:
    """Print the table, the verdicts, and what was missed or failed."""
    console = Console(width=None if sys.stdout.isatty() else 120)
    table = _terminal_table(("scenario", "controller", "max, cm", "mean, cm", "effort", "settled"), 2)
    for name, entry in _done(result):
        first = {statistic: best(entry["results"], _competitors(result), statistic) for statistic in ERRORS}
        for i, (controller, found) in enumerate(entry["results"].items()):
            cells = [_bold(_cm(found, s), controller == first[s], "[bold]{}[/bold]") for s in ERRORS]
            label = _label(result, controller)
            table.add_row("" if i else name, label, *cells, _plus_minus(found["effort_m_s2"]), _settled(found))
        table.add_section()
    if table.row_count:
        console.print(title(result), style="bold", highlight=False)
        console.print(table)
        console.print("effort in m/s², settled after s; compare.md has the definitions\n", highlight=False)
    if verdicts := list(_verdict_rows(result)):
        table = _terminal_table(VERDICT_HEADINGS, 2)
        for row in verdicts:
            table.add_row(*row)
        console.print(VERDICT_TITLE, style="bold", highlight=False)
        console.print(table)
        console.print(VERDICT_CAPTION, highlight=False)
    for line in _why_not(result):
        print(f"why not: {line}")
    for line in _not_done(result):
        print(f"note: {line}")


def _terminal_table(headings: Sequence[str], left: int) -> Table:
    """An empty table, narrow enough for 80 columns, its first `left` columns aligned to the left and never broken."""
    table = Table(box=SIMPLE, show_edge=False, pad_edge=False, padding=(0, 1, 0, 0))
    for i, heading in enumerate(headings):
        table.add_column(heading, justify="right" if i >= left else "left", no_wrap=i < left)
    return table


def markdown(result: Result) -> str:
    """The whole of it as Markdown."""
    blocks = [f"# {title(result)}", f"`{result['repeat']}`"]
    for statistic, label in ERRORS.items():
        blocks += [f"## {label.capitalize()} position error in cm", _matrix(result, statistic)]
    blocks += [_list(_not_done(result))]
    if verdicts := list(_verdict_rows(result)):
        blocks += [f"## {VERDICT_TITLE}", VERDICT_CAPTION, markdown_table(VERDICT_HEADINGS, verdicts)]
        blocks += ["Where a goal is missed:" if _why_not(result) else "", _list(_why_not(result))]
    blocks += ["## Per axis, effort and settling", _details(result)]
    blocks += [
        "## Scenarios",
        markdown_table(["scenario", "", "simulated, s", "computed in, s"], _scenario_rows(result)),
    ]
    blocks += ["## Definitions", _list(f"**{name}**: {text}" for name, text in result["definitions"].items())]
    blocks += [", ".join(f"{name} {number}" for name, number in result["versions"].items())]
    return "\n\n".join(block for block in blocks if block) + "\n"


def title(result: Result) -> str:
    """Plant, and what the numbers are the mean of."""
    seeds = result["seeds"]
    over = f"seed {seeds[0]}, no intervals" if len(seeds) == 1 else f"mean of {len(seeds)} seeds ± 95 % interval"
    return f"Controllers compared on the {result['plant']} plant: {over}"


def _done(result: Result) -> list[tuple[str, Any]]:
    return [(name, entry) for name, entry in result["scenarios"].items() if entry["status"] == "done"]


def _competitors(result: Result) -> list[str]:
    return [name for name in result["controllers"] if name not in result["limits"]]


def _label(result: Result, controller: str) -> str:
    return f"{controller} (limit)" if controller in result["limits"] else controller


def _bold(text: str, wanted: bool, template: str) -> str:
    return template.format(text) if wanted else text


def _plus_minus(spread: Result, factor: float = 1.0) -> str:
    half = spread["plus_minus"]
    return f"{factor * spread['mean']:.2f}±" + ("\N{EN DASH}" if half is None else f"{factor * half:.2f}")


def _cm(found: Result, statistic: str, axis: str = "position") -> str:
    return _plus_minus(found["error_m"][axis][statistic], 100)


def _settled(found: Result) -> str:
    spread = found["settle_s"]
    if spread["mean"] is None:
        return "not"
    settled, seeds = sum(value is not None for value in spread["seeds"]), len(spread["seeds"])
    return f"{spread['mean']:.2f}" + (f" ({settled}/{seeds})" if settled < seeds else "")


def _matrix(result: Result, statistic: str) -> str:
    """Scenarios x controllers, the best competitor in bold."""
    rows = []
    for name, entry in result["scenarios"].items():
        found = entry["results"]
        first = best(found, _competitors(result), statistic)
        cells = [_bold(_cm(found[c], statistic), c == first, "**{}**") for c in found]
        rows.append([name, *(cells or [entry["status"]] + [""] * (len(result["controllers"]) - 1))])
    return markdown_table(["", *(_label(result, name) for name in result["controllers"])], rows)


def _details(result: Result) -> str:
    headings = [f"{label} in {axis}, cm" for axis in AXES for label in ERRORS.values()]
    rows = [
        [name, _label(result, controller)]
        + [_cm(found, statistic, axis) for axis in AXES for statistic in ERRORS]
        + [_plus_minus(found["effort_m_s2"]), _settled(found)]
        for name, entry in _done(result)
        for controller, found in entry["results"].items()
    ]
    return markdown_table(["scenario", "controller", *headings, "effort, m/s²", "settled after, s"], rows)


def _scenario_rows(result: Result) -> Iterator[list[str]]:
    for name, entry in result["scenarios"].items():
        yield [name, entry["description"], f"{entry['simulated_s']:.1f}", f"{entry['wall_s']:.1f}"]


def _verdict_rows(result: Result) -> Iterator[list[str]]:
    """Two rows a scenario, for maximum and mean error."""
    verdicts = {name: entry["verdict"] for name, entry in _done(result) if entry["verdict"]}
    for name, errors in ((name, verdict["errors"]) for name, verdict in verdicts.items()):
        for i, (statistic, verdict) in enumerate(errors.items()):
            row = ["" if i else name, ERRORS[statistic]]
            row += [_change(verdict["against"].get(other)) for other in (*BASELINES, *CONTENDERS)]
            yield [*row, _yes_no(verdict["beats"]), _yes_no(verdict["within"])]


def _change(pair: Result | None) -> str:
    if pair is None or pair["ratio"] is None:
        return "-"
    return f"{100 * (pair['ratio'] - 1):+.0f}" + ("" if pair["beyond_chance"] else f" {WITHIN_CHANCE}")


def _yes_no(value: bool | None) -> str:
    return "-" if value is None else "yes" if value else "no"


def _why_not(result: Result) -> list[str]:
    verdicts = {name: entry["verdict"] for name, entry in _done(result) if entry["verdict"]}
    return [f"{name}: {text}" for name, verdict in verdicts.items() for text in verdict["why_not"]]


def _not_done(result: Result) -> list[str]:
    waiting = result["stopped"] or "not yet"
    return [
        f"{name}: {entry['status']}: {entry['reason'] or waiting}"
        for name, entry in result["scenarios"].items()
        if entry["status"] != "done"
    ]


def _list(lines: Iterable[str]) -> str:
    return "\n".join(f"- {plain(line)}" for line in lines)
