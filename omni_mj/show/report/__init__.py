"""Reports: one HTML file about one run, a comparison, or several of them, made from what is in their folders.

The file holds its figures and its style; nothing is loaded from anywhere when it is opened.
"""

from collections.abc import Sequence
from functools import cache
from pathlib import Path

import jinja2

from omni_control.errors import OmniError
from omni_mj.files import write as write_file
from omni_mj.measure.table import where
from omni_mj.show.report import cells
from omni_mj.show.report.reading import Run, Source, data_uri, read

TEMPLATES = Path(__file__).parents[1] / "templates"


def write(folders: Sequence[Path], out: Path) -> None:
    """Write the report about what is in `folders` to the file `out`.

    Args:
        folders: of runs, comparisons, or both.
        out: an HTML file.

    Raises:
        OmniError: a folder holds no summary, or one that cannot be read.
    """
    try:
        html = _html(folders)
    except OmniError:
        raise
    except (jinja2.UndefinedError, LookupError, TypeError, AttributeError, ValueError, ArithmeticError):
        named = ", ".join(map(str, folders))
        raise OmniError(f"summary.json in {named} is not of this version, or was changed; make the run again") from None
    write_file(out, html)


def _html(folders: Sequence[Path]) -> str:
    sources = read(folders)
    runs = [run for source in sources for run in source.runs]
    return _template().render(
        title=_title(sources, runs),
        sources=sources,
        runs=runs,
        comparison=_comparison(runs),
        differing=cells.differing(runs),
        cells=cells,
    )


@cache
def _template() -> jinja2.Template:
    """What all reports are made with: reading it takes longer than filling it in."""
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(TEMPLATES), autoescape=True, undefined=jinja2.StrictUndefined,
        trim_blocks=True, lstrip_blocks=True,
    )  # fmt: skip
    environment.filters |= {"number": cells.number, "change": cells.change, "plain": cells.plain}
    return environment.get_template("report.html.j2")


def _title(sources: Sequence[Source], runs: Sequence[Run]) -> str:
    if len(runs) == 1:
        return f"{runs[0].name}, {where(runs[0].entry)}"
    return f"Comparison of {len(runs)} {'scenarios' if len(sources) == 1 else 'runs'}"


def _comparison(runs: Sequence[Run]) -> str | None:
    """The figure that compares runs, as a data URI, if there are several with results."""
    entries = {run.label: run.entry for run in runs if run.entry["results"]}
    if len(entries) < 2:
        return None
    from omni_mj.show import figures  # which loads matplotlib, for reports of several runs alone

    informed = dict.fromkeys(name for run in runs for name in run.informed)
    return data_uri(figures.comparison_svg(entries, tuple(informed)), ".svg")
