"""A report shows the summaries' numbers, needs no other file, and escapes users' text."""

import json
import re
import shutil
import subprocess
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from benches.figures import NAMES
from commands import invoke
from matplotlib.image import imread

CHROMIUM = next(
    filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None
)
FLAGS = "--headless --no-sandbox --disable-gpu --disable-quic --no-first-run"
FLAGS += " --disable-background-networking --disable-component-update --disable-sync"
FLAGS += " --hide-scrollbars --allow-file-access-from-files"
# The report runs no scripts, so a page around it inspects it.
WRAPPER = """<body><iframe src="report.html" width="{width}" height="900"></iframe><script>
onload = () => {{
  const page = document.querySelector("iframe").contentDocument, root = page.documentElement;
  document.body.dataset.page = JSON.stringify({{
    images: [...page.images].map(
      i => [i.complete, i.naturalWidth, i.getBoundingClientRect().right]),
    overflow: root.scrollWidth - root.clientWidth,
    resources: page.defaultView.performance.getEntriesByType("resource").map(
      r => r.name.slice(0, 10)),
  }});
}}</script>"""
EVIL = "<script>alert('x')</script> & \"quoted\" {{ 7 * 7 }}"


class Page(HTMLParser):
    """Elements, references and text of a page; fails where tags do not match."""

    def __init__(self, html: str) -> None:
        super().__init__()
        self.html, self.text = html, ""
        self.open, self.tags, self.references, self.ids = [list[str]() for _ in range(4)]
        self.cells: list[str] = []
        self.feed(html)
        assert self.open == []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        if tag not in ("meta", "img", "input"):
            self.open.append(tag)
        attributes = dict(attrs)
        self.references += [
            attributes[name] or "" for name in ("src", "href") if name in attributes
        ]
        self.ids += [attributes["id"] or ""] if "id" in attributes else []

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        if self.open and self.open[-1] in ("td", "th"):
            self.cells.append(data.strip())
        self.text += data


def summary_of(folder: Path) -> dict[str, Any]:
    return json.loads((folder / "summary.json").read_text())


def entry_of(folder: Path) -> dict[str, Any]:
    (entry,) = summary_of(folder)["scenarios"].values()
    return entry


def change_summary(folder: Path, to: Path, name: str = "rect", **entry: Any) -> Path:
    """Copy a run's folder and change the scenario's name and entry in its summary."""
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


def test_the_numbers_are_those_of_the_summary(runs: list[Path], out: Path) -> None:
    """Medians of the seeds with their range, rounded, in cm and degrees for errors."""
    report = page(runs[0], out=out)
    for result in entry_of(runs[0])["results"].values():
        for part, factor in (("error_m", 100), ("error_rad", 180 / np.pi)):
            for axis in result[part].values():
                for spread in (axis[statistic] for statistic in ("max", "p99", "mean", "rms")):
                    median, smallest, largest = (
                        f"{factor * spread[key]:.2f}" for key in ("median", "min", "max")
                    )
                    assert f"{median} ({smallest} to {largest})" in report.cells
        assert all(
            "/".join(f"{v:.2f}" for v in axis.values()) in report.cells
            for axis in result["alpha"].values()
        )
        assert f"{result['effort_m_s2']['median']:.2f}" in report.cells


def test_the_papers_errors_follow_the_results(runs: list[Path], tmp_path: Path, out: Path) -> None:
    paper = {"flc": {"x": {"max": 0.04, "mean": 0.01}, "y": {"max": 0.08, "mean": 0.02}}}
    report = page(
        change_summary(runs[0], tmp_path / "printed", paper=paper, paper_table=3), out=out
    )
    assert {"paper's flc", "4.00/1.00", "8.00/2.00"} <= set(report.cells)
    assert (
        "paper's flc"
        not in page(change_summary(runs[0], tmp_path / "without", paper=None), out=out).text
    )


def test_figures_are_reproducible_and_not_cut_off(runs: list[Path], tmp_path: Path) -> None:
    """PNG and SVG of all figures for which the kinematic plant has data; their edges are white."""
    scenario = runs[0] / "scenario.toml"
    assert invoke("run --svg --no-record --quiet --scenario", scenario, "--out", tmp_path) == 0
    written = {path.name: path.read_bytes() for path in (runs[0] / "figures").iterdir()}
    assert set(written) == {f"{name}.{kind}" for name in NAMES for kind in ("png", "svg")}
    assert {path.name: path.read_bytes() for path in (tmp_path / "figures").iterdir()} == written
    assert max(map(len, written.values())) < 1_000_000
    for path in (runs[0] / "figures").glob("*.png"):
        ink = imread(path)[..., :3].min(axis=-1) < 0.9
        assert ink.mean() > 0.01, path
        assert not any(edge.any() for edge in (ink[0], ink[-1], ink[:, 0], ink[:, -1])), path


def test_a_report_contains_all_figures_and_needs_no_other_file(
    runs: list[Path], comparison: Path, out: Path
) -> None:
    figures = len({path.stem for path in (runs[0] / "figures").iterdir()})
    for folders, images in (([runs[0]], figures), ([*runs, comparison], 1)):
        report = page(*folders, out=out)
        assert all(reference.startswith(("#", "data:image/")) for reference in report.references)
        assert not re.search(r"url\(|@import|<script", report.html)
        assert {
            reference[1:] for reference in report.references if reference.startswith("#")
        } <= set(report.ids)
        assert len(set(report.ids)) == len(report.ids)
        assert report.tags.count("img") == images
    assert "Comparison of 4 runs" in report.text
    assert {"rect", "compare: rect", "compare: rect-noise"} <= set(report.cells)
    assert "disturbance.velocity_m_s" in report.cells  # in which they differ


def test_a_comparison_has_verdicts(comparison: Path, out: Path) -> None:
    report, summary = page(comparison, out=out), summary_of(comparison)
    assert "Comparison of 2 scenarios" in report.text
    assert "Verdicts on p" in report.text
    for entry in summary["scenarios"].values():
        error = entry["results"]["p"]["error_m"]["position"]
        assert (
            "/".join(f"{100 * error[key]['median']:.2f}" for key in ("max", "mean")) in report.cells
        )


def test_users_text_is_escaped(runs: list[Path], tmp_path: Path, out: Path) -> None:
    results = {EVIL: entry_of(runs[0])["results"]["flc"]}
    failed = [{"controller": EVIL, "seed": 0, "slot": 0, "time_s": 1.0, "cause": EVIL}]
    folder = change_summary(
        runs[0], tmp_path / "evil", EVIL, description=EVIL, results=results, failures=failed
    )
    (folder / "summary.json").write_text(json.dumps(summary_of(folder) | {"controllers": [EVIL]}))
    report = page(folder, out=out)
    assert "script" not in report.tags
    assert "<script" not in report.html
    assert report.text.count(EVIL) > 3


def test_failed_rows_and_missing_numbers_are_shown(
    runs: list[Path], tmp_path: Path, out: Path
) -> None:
    results = entry_of(runs[0])["results"]
    results["flc"] |= {"n_failed": 1, "alpha": None, "peak_voltage_v": None}
    for spreads in results["flc"]["error_m"].values():
        for spread in spreads.values():
            spread |= {"mean": None, "ci95_half_width": None, "max": None}
    failed = [{"controller": "flc", "seed": 2, "slot": 0, "time_s": 1.25, "cause": "toppled over"}]
    folder = change_summary(runs[0], tmp_path / "failed", results=results, failures=failed)
    for folders in ([folder], [folder, runs[1]]):
        report = page(*folders, out=out)
        assert "toppled over" in report.text
        assert "failed 1 of 3" in report.text
        assert "1.25" in report.cells
        assert "None" not in report.text
        assert "nan" not in report.text.lower().split()


def test_an_incomplete_run_is_marked(runs: list[Path], tmp_path: Path, out: Path) -> None:
    some = change_summary(runs[0], tmp_path / "some", status="stopped", reason="interrupted")
    none = change_summary(
        runs[0], tmp_path / "none", status="failed", reason="no such robot", results={}, frames=0
    )
    waiting = change_summary(runs[0], tmp_path / "waiting", status="not run", results={})
    for folders in ([none], [some], [waiting], [some, none, waiting]):
        text = page(*folders, out=out).text
        assert text.count("is incomplete.") == len(folders)
        assert ("no such robot" in text) == (none in folders)


def test_settings_that_differ_from_their_default_are_shown(runs: list[Path], out: Path) -> None:
    html = page(runs[0], out=out).html
    changed_settings = html[
        html.index("Settings that differ") : html.index("How to repeat it</h2>")
    ]
    assert ">reference.waypoints<" in changed_settings
    assert ">radio.delay_frames<" not in changed_settings


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (None, "holds no run"),
        ("{", "not valid JSON"),
        ('{"format": 2}', "not a run's summary of format 5"),
    ],
)
def test_a_folder_without_a_run_is_rejected_in_one_line(
    tmp_path: Path, out: Path, text: str | None, words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    if text is not None:
        (tmp_path / "summary.json").write_text(text)
    assert invoke("report", tmp_path, "--out", out) == 2
    message = capsys.readouterr().err
    assert words in message
    assert message.count("\n") == 1
    assert not out.exists()


def test_an_incomplete_summary_is_rejected(
    runs: list[Path], tmp_path: Path, out: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    lacking = change_summary(runs[0], tmp_path / "lacking", settings=3)
    empty = change_summary(runs[0], tmp_path / "empty", results={"flc": {}})
    for folder in (lacking, empty):
        assert invoke("report", folder, "--out", out) == 2
        assert "not of this version" in capsys.readouterr().err


def chromium(profile: Path, *args: str) -> str:
    command = [str(CHROMIUM), *FLAGS.split(), f"--user-data-dir={profile}", *args]
    return subprocess.run(command, capture_output=True, text=True, timeout=120, check=True).stdout


@pytest.mark.skipif(CHROMIUM is None, reason="no chromium on the PATH")
@pytest.mark.parametrize("width", [390, 1400])
def test_all_figures_load_and_fit_into_the_window(
    runs: list[Path], tmp_path: Path, width: int
) -> None:
    """In a real browser, in wide and narrow windows."""
    page(runs[0], out=tmp_path / "report.html")
    wrapper = tmp_path / "wrapper.html"
    wrapper.write_text(WRAPPER.format(width=width))
    dom = chromium(
        tmp_path / "profile", "--dump-dom", "--virtual-time-budget=20000", wrapper.as_uri()
    )
    match = re.search(r'data-page="(.*?)"', dom)
    assert match, "the report did not load"
    state: dict[str, Any] = json.loads(match[1].replace("&quot;", '"'))
    assert len(state["images"]) == len(list((runs[0] / "figures").glob("*.svg")))
    assert all(
        complete and image_width > 0 and right <= width
        for complete, image_width, right in state["images"]
    )
    assert state["overflow"] <= 0
    assert set(state["resources"]) <= {"data:image"}
