"""The one table of what came out: for the terminal, Markdown, recordings and plain text alike."""

from collections.abc import Iterable, Iterator, Mapping, Sized
from dataclasses import dataclass
from math import degrees
from pathlib import Path
from typing import Any

from omni_mj.measure import limits
from omni_mj.measure.statistics import CONFIDENCE, Spread

DASH = "\N{EN DASH}"
PAPER = "paper's "  # before the names of controllers whose numbers the paper reports
COLUMNS = {"x": ("x, cm", "error_m", 100.0), "y": ("y, cm", "error_m", 100.0)}
COLUMNS |= {"distance": ("plane, cm", "error_m", 100.0), "heading": ("heading, °", "error_rad", degrees(1))}
OVER = "over limit"  # maximum and mean in the plane
EFFORT = "excess, m/s²"  # effort above what the reference needs: one scale for all scenarios
Summary = Mapping[str, Any]


@dataclass(frozen=True)
class Table:
    """Headings and rows of strings; the first `left` columns are aligned to the left."""

    title: str
    headings: list[str]
    rows: list[list[str]]
    left: int


def table(summary: Summary) -> Table:
    """The table of a summary: errors as maximum/mean, effort, time to settle, and the change against the first.

    A number is that of the one seed, or the median over the seeds; but where several scenarios were run with several
    seeds, distance in the plane is the mean and half its interval. Limits that are known, and what the paper has,
    follow the controllers; how many times the limit these are is the last column, of means over the seeds.
    """
    entries = {name: entry for name, entry in summary["scenarios"].items() if entry["results"]}
    several = len(summary["scenarios"]) > 1
    first = next((next(iter(entry["results"])) for entry in entries.values()), "")
    headings = ["scenario", "seeds"] * several + ["controller", *(heading for heading, _, _ in COLUMNS.values())]
    headings += [EFFORT, "settled, s", f"vs {first}, %"]
    limited = any(entry.get("over_limit") for entry in entries.values())
    headings += [OVER] * limited
    rows = []
    for name, entry in entries.items():
        means = several and len(entry["seeds"]) > 1
        lines = [*_lines(summary, entry, means), *_limit_lines(entry, means), *_paper_lines(entry)]
        rows += [
            ["" if i else name, "" if i else f"{len(entry['seeds'])}"] * several + line[: None if limited else -1]
            for i, line in enumerate(lines)
        ]
    return Table(title(summary), headings, rows, 1 + 2 * several)


def title(summary: Summary) -> str:
    """What was run, and what the numbers are."""
    names, entries = list(summary["scenarios"]), list(summary["scenarios"].values())
    what = names[0] if len(names) == 1 else "Controllers compared"
    places = " and ".join(dict.fromkeys(where(entry) for entry in entries))
    seeds = [entry["seeds"] for entry in entries if entry["seeds"]]
    if not seeds:
        over = ""
    elif max(map(len, seeds)) == 1:
        over = f", seed {seeds[0][0]}" + (", no intervals" if len(names) > 1 else "")
    elif len(names) == 1:
        over = f", median of {len(seeds[0])} seeds"
    else:
        over = f"; in the plane mean of {counted(seeds)} seeds ± {100 * CONFIDENCE:g} % interval, otherwise medians"
    return f"{what}, {places}{over}; maximum/mean"


def where(entry: Mapping[str, Any]) -> str:
    """The robot, if the plant has one, and the plant of a scenario's entry in a summary."""
    robot = "" if entry["plant"] == "kinematic" else f"{Path(entry['robot']).name} "
    return f"{robot}on the {entry['plant']} plant"


def counted(seeds: Iterable[Sized]) -> str:
    """How many seeds several scenarios were run with: 20, or 5 to 20."""
    counts = sorted(map(len, seeds))
    return f"{counts[0]}" if counts[0] == counts[-1] else f"{counts[0]} to {counts[-1]}"


def text(given: Table) -> str:
    """The table as lines of plain text."""
    lines = [given.headings, *given.rows]
    widths = [max(len(line[i]) for line in lines) for i in range(len(given.headings))]
    aligned = [
        "  ".join(
            cell.ljust(width) if i < given.left else cell.rjust(width)
            for i, (cell, width) in enumerate(zip(line, widths, strict=True))
        ).rstrip()
        for line in lines
    ]
    return "\n".join([given.title, *aligned])


def label(summary: Summary, controller: str, result: Mapping[str, Any] | None = None) -> str:
    """A controller's name, with what must be known of its numbers: if it knows the truth, how many seeds failed."""
    remarks = ["informed"] if controller in summary["informed"] else []
    if result and result["failed"]:
        remarks.append(f"failed {result['failed']} of {len(result['effort_m_s2']['seeds'])}")
    return f"{controller} ({', '.join(remarks)})" if remarks else controller


def number(value: float | None, factor: float = 1.0, digits: int = 2) -> str:
    """A number, or a dash where there is none."""
    return DASH if value is None else f"{factor * value:.{digits}f}"


def plus_minus(spread: Spread, factor: float = 1.0) -> str:
    """The mean over the seeds and half its interval; a dash for what there is none of."""
    if spread["mean"] is None:
        return DASH
    return f"{factor * spread['mean']:.2f}±{number(spread['plus_minus'], factor)}"


def settled(result: Mapping[str, Any]) -> str:
    """The median time to settle, or "never"; and how many of the seeds do, where not all do."""
    spread, count = result["settle_s"], len(result["settle_s"]["seeds"])
    of = "" if result["settled"] == count else f" ({result['settled']}/{count})"
    return ("never" if spread["median"] is None else number(spread["median"])) + of


def _lines(summary: Summary, entry: Mapping[str, Any], means: bool) -> Iterator[list[str]]:
    for controller, result in entry["results"].items():
        cells = [label(summary, controller, result), *_errors(result, means)]
        cells += [number(result["excess_effort_m_s2"]["median"]), settled(result)]
        yield [*cells, _change(result["reduction_percent"]), _over((entry.get("over_limit") or {}).get(controller))]


def _limit_lines(entry: Mapping[str, Any], means: bool) -> Iterator[list[str]]:
    for name, errors in limits.of(entry).items():
        yield [name, *_errors({"error_m": errors}, means), "", "", "", ""]


def _errors(result: Mapping[str, Any], means: bool) -> Iterator[str]:
    """Maximum and mean of each column, as far as the result has them."""
    for axis, (_, key, factor) in COLUMNS.items():
        error = result.get(key, {}).get(axis)
        if error is None:
            yield ""
        elif means and axis == "distance":
            yield "/".join(plus_minus(error[s], factor) for s in ("max", "mean"))
        else:
            yield "/".join(number(error[s]["median"], factor) for s in ("max", "mean"))


def _change(reduction: Mapping[str, Any] | None) -> str:
    """Of the medians of maximum and mean in the plane, against the first controller's."""
    if reduction is None:
        return ""
    values = (reduction["distance"][s] for s in ("max", "mean"))
    return "/".join(DASH if value is None else f"{-value:+.0f}" for value in values)


def _over(ratios: Mapping[str, float | None] | None) -> str:
    """How many times the limit's maximum and mean a controller's are."""
    return "/".join(number(ratio, digits=1) for ratio in ratios.values()) if ratios else ""


def _paper_lines(entry: Mapping[str, Any]) -> Iterator[list[str]]:
    for controller, error in (entry["paper"] or {}).items():
        cells = [
            "/".join(number(error[axis][s], 100) for s in ("max", "mean")) if axis in error else "" for axis in COLUMNS
        ]
        yield [PAPER + controller, *cells, "", "", "", ""]
