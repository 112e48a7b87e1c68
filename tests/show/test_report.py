"""The report says what the summaries say, holds all it shows, and cannot be broken by what a user wrote."""

import json
import re
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from commands import invoke

EVIL = "<script>alert('x')</script> & \"quoted\" {{ 7 * 7 }}"
MINUS = "\N{MINUS SIGN}"


class Page(HTMLParser):
    """Elements, references and numbers of a page; fails where tags do not match."""

    def __init__(self, html: str) -> None:
        super().__init__()
        self.html, self.text = html, ""
        self.open, self.tags, self.references, self.ids = [list[str]() for _ in range(4)]
        self.numbers: list[tuple[float, str]] = []  # in full, and as shown
        self.value: str | None = None
        self.feed(html)
        assert self.open == []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        if tag not in ("meta", "img", "input"):
            self.open.append(tag)
        attributes = dict(attrs)
        self.references += [attributes[name] or "" for name in ("src", "href") if name in attributes]
        self.ids += [attributes["id"] or ""] if "id" in attributes else []
        self.value = attributes.get("value") if tag == "data" else None

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


def changed(folder: Path, to: Path, name: str = "rect", **entry: Any) -> Path:
    """Return a copy of a run's folder whose summary says something else of the scenario, here called `name`."""
    to.mkdir()
    summary = summary_of(folder) | {"scenarios": {name: entry_of(folder) | entry}}
    (to / "summary.json").write_text(json.dumps(summary))
    (to / "scenario.toml").write_text((folder / "scenario.toml").read_text())
    return to


def page(*folders: Path, out: Path) -> Page:
    assert invoke("report", *folders, "--out", out) == 0
    return Page(out.read_text())


@pytest.fixture
def out(tmp_path: Path) -> Path:
    return tmp_path / "report.html"


def test_every_number_is_the_summarys(runs: list[Path], out: Path) -> None:
    """Each number stands in full in its element; what a reader sees is it, rounded, in cm and degrees for errors."""
    report = page(runs[0], out=out)
    for result in entry_of(runs[0])["results"].values():
        for part, factor in (("error_m", 100), ("error_rad", 180 / np.pi)):
            for axis in result[part].values():
                for statistic in ("max", "p99", "mean"):
                    for value in (axis[statistic][name] for name in ("median", "min", "max")):
                        assert (value, f"{factor * value:.2f}") in report.numbers
        alphas = [value for axis in ("x", "y") for value in result["alpha"][axis].values()]
        for value in (*alphas, result["effort_m_s2"]["median"], result["excess_effort_m_s2"]["median"]):
            assert (value, f"{value:.2f}") in report.numbers
    known = {float(v) for v in re.findall(r"-?\d+\.?\d*(?:e-?\d+)?", json.dumps(summary_of(runs[0])))}
    assert {value for value, _ in report.numbers} <= known


def test_reductions_stand_beside_the_papers(runs: list[Path], tmp_path: Path, out: Path) -> None:
    """A controller that halves the paper's error reduces it by 50 %."""
    paper = {name: {"x": {"max": error, "mean": error / 4}} for name, error in (("flc", 0.04), ("comp-flc", 0.02))}
    report = page(changed(runs[0], tmp_path / "printed", paper=paper, paper_table=3), out=out)
    ours = round(entry_of(runs[0])["results"]["comp-flc"]["reduction_percent"]["x"]["max"])
    for percent in (ours, 50):
        assert f"{-percent:+d} %".replace("-", MINUS) in report.text
    assert {(0.04, "4.00"), (0.02, "2.00")} <= set(report.numbers)
    assert "paper, cm" in report.text
    assert "paper, cm" not in page(changed(runs[0], tmp_path / "without", paper=None), out=out).text


def test_it_is_complete_in_itself_with_all_figures(runs: list[Path], comparison: Path, out: Path) -> None:
    report = page(*runs, comparison, out=out)
    assert "Comparison of 4 runs" in report.text
    assert all(label in report.text for label in ("rect", "compare: rect", "compare: rect-noise"))
    assert all(reference.startswith(("#", "data:image/")) for reference in report.references)
    assert not re.search(r"url\(|@import|<script", report.html)
    assert {reference[1:] for reference in report.references if reference.startswith("#")} <= set(report.ids)
    assert len(set(report.ids)) == len(report.ids)
    drawn = {path.stem for path in (runs[0] / "figures").iterdir()}
    assert len(drawn) == 7
    assert {f"run1-{name}" for name in drawn} <= set(report.ids)
    assert report.tags.count("img") == len(drawn) + 1  # and the comparison
    assert "disturbance.velocity_m_s" in report.html[: report.html.index("<article")]  # in which they differ


def test_a_comparison_is_a_matrix_with_verdicts(comparison: Path, tmp_path: Path, out: Path) -> None:
    """Means over the seeds with half their intervals; the least of a row, but for the informed, is bold."""
    summary = summary_of(comparison)
    entry = summary["scenarios"]["rect"]
    never = {"seeds": [0.5, None, None], **dict.fromkeys(("median", "mean", "plus_minus"))}
    entry["results"]["flc"] |= {"settled": 1, "settle_s": never}
    (tmp_path / "summary.json").write_text(json.dumps(summary))
    report = page(tmp_path, out=out)
    assert "Comparison of 2 scenarios" in report.text
    assert "Verdicts on p" in report.text
    assert "never<small>settled 1 of 3</small>" in report.html
    for entry in summary["scenarios"].values():
        errors = {name: result["error_m"]["distance"]["max"] for name, result in entry["results"].items()}
        for value in (error[key] for error in errors.values() for key in ("mean", "plus_minus")):
            assert (value, f"{100 * value:.2f}") in report.numbers
        least = min(errors[name]["mean"] for name in ("flc", "p"))
        assert f'<td class="n best"><data value="{least}"' in report.html
    heads = re.findall(r'<table class="matrix">\n<thead>(.*?)</thead>', report.html)
    assert [re.findall(r'class="n">(\w+)', head) for head in heads] == [["flc", "p", "oracle"]] * 3


def test_what_a_user_wrote_is_text(runs: list[Path], tmp_path: Path, out: Path) -> None:
    results = {EVIL: entry_of(runs[0])["results"]["flc"]}
    failed = [{"controller": EVIL, "seed": 0, "place": 0, "time_s": 1.0, "cause": EVIL}]
    folder = changed(runs[0], tmp_path / "evil", EVIL, description=EVIL, results=results, failed=failed)
    (folder / "summary.json").write_text(json.dumps(summary_of(folder) | {"controllers": [EVIL]}))
    report = page(folder, out=out)
    assert "script" not in report.tags
    assert "<script" not in report.html
    assert report.text.count(EVIL) > 3


def test_failed_rows_and_what_is_not_known_are_shown(runs: list[Path], tmp_path: Path, out: Path) -> None:
    results = entry_of(runs[0])["results"]
    results["flc"] |= {"failed": 1, "alpha": None, "peak_voltage_v": None, "peak_current_a": float("nan")}
    for spreads in results["flc"]["error_m"].values():
        for spread in spreads.values():
            spread |= {"mean": None, "plus_minus": None, "max": None}
    failed = [{"controller": "flc", "seed": 2, "place": 0, "time_s": 1.25, "cause": "toppled over"}]
    folder = changed(runs[0], tmp_path / "failed", results=results, failed=failed)
    for folders in ([folder], [folder, runs[1]]):
        report = page(*folders, out=out)
        assert "toppled over" in report.text
        assert "failed 1 of 3" in report.text
        assert (1.25, "1.25") in report.numbers
        assert "None" not in report.text
        assert "nan" not in report.text.lower().split()


def test_an_incomplete_run_is_shown_as_such(runs: list[Path], tmp_path: Path, out: Path) -> None:
    some = changed(runs[0], tmp_path / "some", status="stopped", reason="interrupted")
    none = changed(runs[0], tmp_path / "none", status="failed", reason="no such robot", results={}, frames=0)
    waiting = changed(runs[0], tmp_path / "waiting", status="not run", results={})
    for folders in ([none], [some], [waiting], [some, none, waiting]):
        text = page(*folders, out=out).text
        assert text.count("This run is incomplete.") == len(folders)
        assert ("no such robot" in text) == (none in folders)


def test_settings_off_their_default_stand_out(runs: list[Path], out: Path) -> None:
    html = page(runs[0], out=out).html
    shown = re.findall(
        r'<th scope="row"><code>(.*?)</code>', html[html.index("Settings that differ") : html.index("<details>")]
    )
    assert "reference.waypoints" in shown
    assert not {"radio.delay_frames", "control.max_speed_m_s"} & set(shown)
    assert html.count('<tr class="changed">') == 2 * len(shown)
    for section, fields in entry_of(runs[0])["settings"].items():
        assert all(f"<code>{section}.{name}</code>" in html for name in fields)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (None, "holds no run"),
        ("{", "not valid JSON"),
        ('{"format": 2}', "not a run's summary of format 4"),
    ],
)
def test_a_folder_that_holds_no_run_is_refused_in_one_line(
    tmp_path: Path, out: Path, text: str | None, words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    if text is not None:
        (tmp_path / "summary.json").write_text(text)
    assert invoke("report", tmp_path, "--out", out) == 2
    message = capsys.readouterr().err
    assert words in message
    assert message.count("\n") == 1
    assert not out.exists()


def test_a_summary_that_lacks_something_is_refused(
    runs: list[Path], tmp_path: Path, out: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    lacking = changed(runs[0], tmp_path / "lacking", settings=3)
    empty = changed(runs[0], tmp_path / "empty", results={"flc": {}})
    for folder in (lacking, empty):
        assert invoke("report", folder, "--out", out) == 2
        assert "not of this version" in capsys.readouterr().err
