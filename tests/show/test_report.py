"""The report says what the summaries say, holds all it shows, and cannot be broken by what a user wrote."""

import json
import re
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from omni_control.errors import OmniError
from omni_mj.measure.paper import TABLES
from omni_mj.scenarios.settings import Settings
from omni_mj.show import report

EVIL = "<script>alert('x')</script> & \"quoted\" {{ 7 * 7 }}"
VOID = {"meta", "img", "input", "br", "link"}


class Page(HTMLParser):
    """The elements, the references and the table cells of a page; fails where tags do not match."""

    def __init__(self, html: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.tags: list[str] = []
        self.references: list[str] = []
        self.ids: list[str] = []
        self.numbers: list[tuple[float, str]] = []
        self.text = ""
        self.value: str | None = None
        self.feed(html)
        assert self.open == []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        if tag not in VOID:
            self.open.append(tag)
        found = dict(attrs)
        self.references += [found[name] or "" for name in ("src", "href", "srcset", "data", "action") if name in found]
        self.ids += [found["id"] or ""] if "id" in found else []
        self.value = found.get("value") if tag == "data" else None

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        if self.value is not None:
            self.numbers.append((float(self.value), data))
            self.value = None
        self.text += data


def summary_of(folder: Path) -> dict[str, Any]:
    return json.loads((folder / "summary.json").read_text())


def entry_of(folder: Path) -> dict[str, Any]:
    (entry,) = summary_of(folder)["scenarios"].values()
    return entry


def copy(folder: Path, to: Path, name: str = "rect", **changed: Any) -> Path:
    """A run's folder with another summary: `changed` is what is said of its scenario, here called `name`."""
    to.mkdir()
    scenarios = {name: entry_of(folder) | changed}
    (to / "summary.json").write_text(json.dumps(summary_of(folder) | {"scenarios": scenarios}))
    (to / "scenario.toml").write_text((folder / "scenario.toml").read_text())
    return to


def page(folders: list[Path], out: Path) -> tuple[str, Page]:
    report.write(folders, out)
    html = out.read_text()
    return html, Page(html)


def test_every_number_is_the_summarys(runs: list[Path], tmp_path: Path) -> None:
    """Each number stands in full in its element; what a reader sees is it, rounded, in cm and degrees for errors."""
    summary, entry = summary_of(runs[0]), entry_of(runs[0])
    _, seen = page(runs[:1], tmp_path / "report.html")
    for result in entry["results"].values():
        for part, factor in (("error_m", 100), ("error_rad", 180 / np.pi)):
            for axis in result[part]:
                for statistic in ("max", "p99", "mean"):
                    for name in ("median", "min", "max"):
                        value = result[part][axis][statistic][name]
                        assert (value, f"{factor * value:.2f}") in seen.numbers
        for axis in ("x", "y"):
            for value in result["alpha"][axis].values():
                assert (value, f"{value:.2f}") in seen.numbers
        for effort in (result["effort_m_s2"]["median"], result["excess_effort_m_s2"]["median"]):
            assert (effort, f"{effort:.2f}") in seen.numbers
    known = {float(v) for v in re.findall(r"-?\d+\.?\d*(?:e-?\d+)?", json.dumps(summary))}
    assert {value for value, _ in seen.numbers} <= known


def test_reductions_are_the_summarys_and_the_papers(runs: list[Path], tmp_path: Path) -> None:
    """The paper states 35 % and 49 % (table 3), 34 % and 60 % (table 4) of the maximum error.

    Its numbers stand there only where the summary has them.
    """
    for folder, number, stated in zip(runs, (3, 4), ((35, 49), (34, 60)), strict=True):
        printed = copy(folder, tmp_path / f"{number}", paper=TABLES[number], paper_table=number)
        _, seen = page([printed], tmp_path / "report.html")
        _, without = page([copy(folder, tmp_path / f"{number}-without", paper=None)], tmp_path / "report.html")
        assert "paper, cm" in seen.text
        assert "paper, cm" not in without.text
        for axis, of_paper in zip("xy", stated, strict=True):
            ours = entry_of(folder)["results"]["comp-flc"]["reduction_percent"][axis]["max"]
            for percent in (round(ours), of_paper):
                assert f"{-percent:+d} %".replace("-", "\N{MINUS SIGN}") in seen.text
            for controller in ("flc", "comp-flc"):
                value = TABLES[number][controller][axis]["max"]
                assert (value, f"{100 * value:.2f}") in seen.numbers


def test_nothing_is_loaded_from_outside(runs: list[Path], tmp_path: Path) -> None:
    html, seen = page(runs, tmp_path / "report.html")
    assert seen.references
    assert all(reference.startswith(("#", "data:image/")) for reference in seen.references)
    assert not re.search(r"url\(|@import|<script", html)
    assert all(reference[1:] in seen.ids for reference in seen.references if reference.startswith("#"))
    assert len(set(seen.ids)) == len(seen.ids)


def test_all_figures_of_a_run_are_in_it(runs: list[Path], tmp_path: Path) -> None:
    drawn = {path.stem for path in (runs[0] / "figures").iterdir()}
    _, seen = page(runs[:1], tmp_path / "report.html")
    assert {f"run1-{name}" for name in drawn} <= set(seen.ids)
    assert seen.tags.count("img") == len(drawn) == 7  # all but temperatures, which this plant has not


def test_a_comparison_names_all_runs_and_what_differs(runs: list[Path], tmp_path: Path) -> None:
    html, _ = page(runs, tmp_path / "report.html")
    comparison = html[html.index('id="comparison"') : html.index("<article")]
    assert all(f">{folder.name}</a>" in comparison for folder in runs)
    assert "disturbance.velocity_m_s" in comparison
    assert "radio.delay_frames" not in comparison


def test_a_comparison_is_a_matrix_with_its_figure_and_verdicts(comparison: Path, tmp_path: Path) -> None:
    """Means over the seeds with half their intervals; the least of a row, but for the informed, is bold."""
    html, seen = page([comparison], tmp_path / "report.html")
    summary = summary_of(comparison)
    assert "Comparison of 2 scenarios" in seen.text
    for name, entry in summary["scenarios"].items():
        assert f">{name}</a>" in html
        for result in entry["results"].values():
            for statistic in ("max", "p99", "mean"):
                spread = result["error_m"]["distance"][statistic]
                for value in (spread["mean"], spread["plus_minus"]):
                    assert (value, f"{100 * value:.2f}") in seen.numbers
    bold = re.findall(r'<td class="n best"><data value="(.*?)"', html)
    means = [
        {name: result["error_m"]["distance"][statistic]["mean"] for name, result in entry["results"].items()}
        for statistic in ("max", "p99", "mean")
        for entry in summary["scenarios"].values()
    ]
    assert [float(value) for value in bold] == [min(row["flc"], row["p"]) for row in means]
    assert seen.tags.count("img") == 1
    assert "Verdicts on p" in seen.text
    why_not = [text for entry in summary["scenarios"].values() for text in entry["verdict"]["why_not"]]
    assert why_not
    assert all(text in seen.text for text in why_not)


def test_known_limits_and_who_never_settles_are_shown(comparison: Path, tmp_path: Path) -> None:
    """A limit is a column of the matrices; one scenario of two has one."""
    summary = summary_of(comparison)
    entry = summary["scenarios"]["rect"]
    entry["limit"] = entry["results"]["oracle"]["error_m"]
    never = {"seeds": [0.5, None, None], **dict.fromkeys(("median", "mean", "plus_minus"))}
    entry["results"]["flc"] |= {"settled": 1, "settle_s": never}
    (tmp_path / "limited").mkdir()
    (tmp_path / "limited" / "summary.json").write_text(json.dumps(summary))
    html, _ = page([tmp_path / "limited"], tmp_path / "report.html")
    matrices = [rest.split("</table>")[0] for rest in html.split('<table class="matrix">')[1:]]
    for matrix, statistic in zip(matrices, ("max", "p99", "mean"), strict=True):
        assert re.findall(r'<th scope="col" class="n">(\w+)', matrix) == ["flc", "p", "oracle", "limit"]
        values = [re.findall(r'<td class="n[^"]*">(?:<data value="(.*?)")?', line) for line in matrix.split("<tr>")[2:]]
        known = entry["limit"]["distance"][statistic]["mean"]
        assert [row[3] for row in values] == [f"{known}", ""]
    assert "never<small>settled 1 of 3</small>" in html


def test_runs_and_comparisons_stand_side_by_side(runs: list[Path], comparison: Path, tmp_path: Path) -> None:
    _, seen = page([*runs, comparison], tmp_path / "report.html")
    assert "Comparison of 4 runs" in seen.text
    assert {f"run{k}-results" for k in range(1, 5)} | {"source3-repeat"} <= set(seen.ids)
    for label in ("rect", "compare: rect", "compare: rect-noise"):
        assert label in seen.text


def test_what_a_user_wrote_is_text(runs: list[Path], tmp_path: Path) -> None:
    results = {EVIL: entry_of(runs[0])["results"]["flc"]}
    failed = [{"controller": EVIL, "seed": 0, "place": 0, "time_s": 1.0, "cause": EVIL}]
    folder = copy(runs[0], tmp_path / "evil", EVIL, description=EVIL, results=results, failed=failed)
    (folder / "summary.json").write_text(json.dumps(summary_of(folder) | {"controllers": [EVIL]}))
    html, seen = page([folder], tmp_path / "report.html")
    assert "script" not in seen.tags
    assert "<script" not in html
    assert seen.text.count(EVIL) > 3


def test_rows_that_failed_are_listed_with_their_cause(runs: list[Path], tmp_path: Path) -> None:
    """Nobody's mean is told of whom a seed failed."""
    results = entry_of(runs[0])["results"]
    unknown = {"mean": None, "plus_minus": None, "max": None}
    results["flc"]["failed"] = 1
    for axis in ("x", "y", "distance"):
        for statistic in results["flc"]["error_m"][axis]:
            results["flc"]["error_m"][axis][statistic] |= unknown
    failed = [{"controller": "flc", "seed": 2, "place": 0, "time_s": 1.25, "cause": "toppled over"}]
    folder = copy(runs[0], tmp_path / "failed", results=results, failed=failed)
    for folders in ([folder], [folder, runs[1]]):
        _, seen = page(folders, tmp_path / "report.html")
        assert "toppled over" in seen.text
        assert (1.25, "1.25") in seen.numbers
        assert "failed 1 of 3" in seen.text


def test_an_incomplete_run_is_shown_as_such(runs: list[Path], tmp_path: Path) -> None:
    some = copy(runs[0], tmp_path / "some", status="stopped", reason="interrupted")
    none = copy(runs[0], tmp_path / "none", status="failed", reason="no such robot", results={}, frames=0)
    waiting = copy(runs[0], tmp_path / "waiting", status="not run", results={})
    for folders in ([none], [some], [waiting], [some, none, waiting]):
        _, seen = page(folders, tmp_path / "report.html")
        assert seen.text.count("This run is incomplete.") == len(folders)
        assert ("no such robot" in seen.text) == (none in folders)


def test_what_is_not_known_is_a_dash(runs: list[Path], tmp_path: Path) -> None:
    results = entry_of(runs[0])["results"]
    results["flc"] |= {"alpha": None, "peak_voltage_v": None, "peak_current_a": float("nan")}
    _, seen = page([copy(runs[0], tmp_path / "unknown", results=results)], tmp_path / "report.html")
    assert "nan" not in seen.text.lower().split()
    assert "None" not in seen.text
    assert seen.text.count("\N{EN DASH}") > 8


def test_settings_off_their_default_stand_out(runs: list[Path], tmp_path: Path) -> None:
    html, _ = page(runs[:1], tmp_path / "report.html")
    settings, defaults = entry_of(runs[0])["settings"], json.loads(json.dumps(Settings().plain()))
    names = [(section, name) for section in settings for name in settings[section]]
    # What control knows of the robot has no default of its own.
    off = [f"{s}.{n}" for s, n in names if settings[s][n] != defaults[s][n] and s != "control"]
    shown = html[html.index("Settings that differ") : html.index("<details>")]
    assert "reference.waypoints" in off
    assert re.findall(r'<th scope="row"><code>(.*?)</code>', shown) == off
    assert html.count('<tr class="changed">') == 2 * len(off)
    assert all(f"<code>{section}.{name}</code>" in html for section, name in names)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (None, "holds no run"),
        ("", "not a run's summary"),
        ("{", "not a run's summary"),
        ("[]", "controllers, informed"),
        ('{"format": 4}', "controllers, informed"),
        ('{"format": 2}', "of format 2; this version of omni-mj reads format 4"),
    ],
)
def test_a_folder_that_holds_no_run_is_refused_in_one_line(tmp_path: Path, text: str | None, said: str) -> None:
    if text is not None:
        (tmp_path / "summary.json").write_text(text)
    with pytest.raises(OmniError, match=re.escape(said)) as error:
        report.write([tmp_path], tmp_path / "report.html")
    assert "\n" not in str(error.value)
    assert not (tmp_path / "report.html").exists()


def test_a_summary_that_lacks_something_is_refused(runs: list[Path], tmp_path: Path) -> None:
    lacking = copy(runs[0], tmp_path / "lacking", settings=3)
    empty = copy(runs[0], tmp_path / "empty", results={"flc": {}})
    for folder, said in ((lacking, "scenarios.rect.settings"), (empty, "not of this version")):
        with pytest.raises(OmniError, match=said):
            report.write([folder], tmp_path / "report.html")
