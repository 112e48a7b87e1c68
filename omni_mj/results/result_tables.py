"""Tables of what came out: for the terminal, Markdown, recordings and plain text alike."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from math import degrees
from pathlib import Path
from typing import Any

from omni_mj.results.metrics import EXCURSION, RECOVERED_M, RECOVERY, RECOVERY_WINDOW_S
from omni_mj.results.saturation import DUTY, METRIC_LABELS
from omni_mj.results.statistics import SeedStatistics

DASH = "\N{EN DASH}"
PAPER = "paper's "  # before the names of controllers whose numbers the paper reports
COLUMNS = {"x": ("x, cm", "error_m", 100.0), "y": ("y, cm", "error_m", 100.0)}
COLUMNS |= {
    "position": ("plane, cm", "error_m", 100.0),
    "heading": ("heading, °", "error_rad", degrees(1)),
}
EFFORT = "excess, m/s²"  # effort above what the reference needs: one scale for all scenarios
WORTH = 0.05  # share from which on a table on the terminal tells of causes
Summary = Mapping[str, Any]


@dataclass(frozen=True)
class Table:
    """Headings and rows of strings; the first `left` columns are aligned to the left."""

    title: str
    headings: list[str]
    rows: list[list[str]]
    left: int


def results_table(summary: Summary) -> Table:
    """The table of a summary: errors as maximum/mean, effort, time to settle, and the change against the first.

    A number is that of the one seed, or the median over the seeds. What the paper has follows the
    controllers.
    """
    entries = {name: entry for name, entry in summary["scenarios"].items() if entry["results"]}
    several = len(summary["scenarios"]) > 1
    first = next((next(iter(entry["results"])) for entry in entries.values()), "")
    headings = ["scenario"] * several + [
        "controller",
        *(heading for heading, _, _ in COLUMNS.values()),
    ]
    headings += [EFFORT, "settled, s", f"vs {first}, %"]
    rows = []
    for name, entry in entries.items():
        for i, line in enumerate([*_lines(summary, entry), *_paper_lines(entry)]):
            rows.append(["" if i else name] * several + line)
    name = "Controllers compared" if several else next(iter(summary["scenarios"]))
    places = " and ".join(
        dict.fromkeys(describe_plant(entry) for entry in summary["scenarios"].values())
    )
    return Table(
        f"{name}, {places}{describe_seeds(summary)}; maximum/mean", headings, rows, 1 + several
    )


def saturation_table(summary: Summary) -> Table | None:
    """Each controller's shares in per cent, beside its error; None where all are small, or for several scenarios."""
    entries = [entry for entry in summary["scenarios"].values() if entry["results"]]
    if len(entries) != 1:
        return None
    results = entries[0]["results"]
    met = {
        name: max(result["saturation"][name]["median"] or 0.0 for result in results.values())
        for name in METRIC_LABELS
    }
    if max(met[name] for name in METRIC_LABELS if name != DUTY) < WORTH:
        return None
    shown = [name for name in METRIC_LABELS if met[name] > 0]
    rows = [
        [
            controller_label(summary, controller, result),
            _both(result["error_m"]["position"], 100),
            *(format_number(result["saturation"][name]["median"], 100, 1) for name in shown),
        ]
        for controller, result in results.items()
    ]
    title = f"why{describe_seeds(summary)}: shares of the frames, and mean duty"
    return Table(
        title,
        ["controller", "plane, cm", *(f"{METRIC_LABELS[name]}, %" for name in shown)],
        rows,
        1,
    )


def recovery_table(summary: Summary) -> Table | None:
    """Return how controllers came back from each fault of a summary's scenarios; None if there were none."""
    rows = []
    for entry in summary["scenarios"].values():
        for faults in zip(
            *(result["recovery"] for result in entry["results"].values()), strict=False
        ):
            for i, (controller, fault) in enumerate(zip(entry["results"], faults, strict=True)):
                time, worst = (
                    fault[RECOVERY]["median"],
                    format_number(fault[EXCURSION]["median"], 100),
                )
                came_back = "never" if time is None else format_number(time)
                rows.append(["" if i else fault["fault"], controller, worst, came_back])
    title = f"recovery{describe_seeds(summary)}: worst excursion until {RECOVERY_WINDOW_S:g} s after a fault, time from its start until"
    headings = ["fault", "controller", "worst, cm", "recovered, s"]
    return (
        Table(f"{title} below {100 * RECOVERED_M:g} cm for good", headings, rows, 2)
        if rows
        else None
    )


def describe_seeds(summary: Summary) -> str:
    """What seeds a table is over, as an end of its title."""
    seeds = summary["seeds"]
    return (
        f", median of {len(seeds)} seeds"
        if len(seeds) > 1
        else f", seed {seeds[0]}"
        if seeds
        else ""
    )


def describe_plant(entry: Mapping[str, Any]) -> str:
    """The robot, if the plant has one, and the plant of a scenario's entry in a summary."""
    robot = "" if entry["plant"] == "kinematic" else f"{Path(entry['robot']).name} "
    return f"{robot}on the {entry['plant']} plant"


def format_table(given: Table) -> str:
    """The table as lines of plain text."""
    lines = [given.headings, *given.rows]
    widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
    aligned = [
        "  ".join(
            cell.ljust(width) if i < given.left else cell.rjust(width)
            for i, (cell, width) in enumerate(zip(line, widths, strict=True))
        ).rstrip()
        for line in lines
    ]
    return "\n".join([given.title, *aligned])


def controller_label(
    summary: Summary, controller: str, result: Mapping[str, Any] | None = None
) -> str:
    """A controller's name, with what must be known of its numbers: if it knows the truth, how many seeds failed."""
    remarks = ["privileged"] if controller in summary["privileged"] else []
    if result and result["n_failed"]:
        remarks.append(f"failed {result['n_failed']} of {len(result['effort_m_s2']['per_seed'])}")
    return f"{controller} ({', '.join(remarks)})" if remarks else controller


def format_number(value: float | None, factor: float = 1.0, digits: int = 2) -> str:
    """A number, never -0, or a dash where there is none."""
    return DASH if value is None else f"{factor * value:z.{digits}f}"


def format_mean(spread: SeedStatistics, factor: float = 1.0) -> str:
    """The mean over the seeds and half its interval; a dash for what there is none of."""
    if spread["mean"] is None:
        return DASH
    return f"{factor * spread['mean']:.2f}±{format_number(spread['ci95_half_width'], factor)}"


def _both(error: Mapping[str, Any], factor: float) -> str:
    """Maximum and mean of an error: medians over the seeds."""
    return "/".join(
        format_number(error[statistic]["median"], factor) for statistic in ("max", "mean")
    )


def _lines(summary: Summary, entry: Mapping[str, Any]) -> Iterator[list[str]]:
    base = next(iter(entry["results"].values()))["error_m"]["position"]
    for controller, result in entry["results"].items():
        settle, count = result["settle_s"], len(result["settle_s"]["per_seed"])
        settled = "never" if settle["median"] is None else format_number(settle["median"])
        error = result["error_m"]["position"]
        medians = [(error[name]["median"], base[name]["median"]) for name in ("max", "mean")]
        changes = [
            DASH if new is None or not old else f"{100 * (new / old - 1):+.0f}"
            for new, old in medians
        ]
        yield [
            controller_label(summary, controller, result),
            *(_both(result[key][axis], factor) for axis, (_, key, factor) in COLUMNS.items()),
            format_number(result["excess_effort_m_s2"]["median"]),
            settled + ("" if result["n_settled"] == count else f" ({result['n_settled']}/{count})"),
            "" if error is base else "/".join(changes),
        ]


def _paper_lines(entry: Mapping[str, Any]) -> Iterator[list[str]]:
    for controller, error in (entry["paper"] or {}).items():
        cells = [
            "/".join(format_number(error[axis][s], 100) for s in ("max", "mean"))
            if axis in error
            else ""
            for axis in COLUMNS
        ]
        yield [PAPER + controller, *cells, "", "", ""]
