"""The report says what the summaries say, holds all it shows, and cannot be broken by what a user wrote."""

import json
import re
import subprocess
import sys
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import pytest

from omni_control.errors import OmniError
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


@pytest.fixture(scope="module")
def folders(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """Runs of the experiments of tables 3 and 4, shortened; the first has figures."""
    base = tmp_path_factory.mktemp("runs")
    for name, extra in {"rect": ("--seeds", "3"), "rect-noise": ("--no-figures",)}.items():
        command = [sys.executable, "-m", "omni_mj.run", "--scenario", name, "--plant", "kinematic", "--no-record"]
        command += ["--set", "reference.waypoints=[[0, 0], [0.4, 0.2], [0, 0.4]]", "--quiet", *extra]
        subprocess.run([*command, "--out", str(base / name)], check=True, timeout=120)
    return [base / "rect", base / "rect-noise"]


def summary_of(folder: Path) -> dict[str, Any]:
    return json.loads((folder / "summary.json").read_text())


def copy(folder: Path, to: Path, **changed: Any) -> Path:
    to.mkdir()
    (to / "summary.json").write_text(json.dumps(summary_of(folder) | changed))
    (to / "scenario.toml").write_text((folder / "scenario.toml").read_text())
    return to


def page(folders: list[Path], out: Path) -> tuple[str, Page]:
    report.write(folders, out)
    html = out.read_text()
    return html, Page(html)


def test_every_number_is_the_summarys(folders: list[Path], tmp_path: Path) -> None:
    """Each number stands in full in its element; what a reader sees is it, rounded to two places, in cm for errors."""
    summary = summary_of(folders[0])
    _, seen = page(folders[:1], tmp_path / "report.html")
    for result in summary["results"].values():
        for axis in ("x", "y"):
            for statistic in ("max", "mean"):
                for value in result["error_m"][axis][statistic].values():
                    assert (value, f"{100 * value:.2f}") in seen.numbers
            for value in result["alpha"][axis].values():
                assert (value, f"{value:.2f}") in seen.numbers
    for axes in summary["paper"].values():
        for statistics in axes.values():
            for value in statistics.values():
                assert (value, f"{100 * value:.2f}") in seen.numbers
    known = {float(v) for v in re.findall(r"-?\d+\.?\d*(?:e-?\d+)?", json.dumps(summary))}
    assert {value for value, _ in seen.numbers} <= known


def test_reductions_are_the_summarys_and_the_papers(folders: list[Path], tmp_path: Path) -> None:
    """The paper states 35 % and 49 % (table 3), 34 % and 60 % (table 4) of the maximum error."""
    for folder, stated in zip(folders, ((35, 49), (34, 60)), strict=True):
        _, seen = page([folder], tmp_path / "report.html")
        for axis, of_paper in zip("xy", stated, strict=True):
            ours = summary_of(folder)["results"]["comp-flc"]["reduction_percent"][axis]["max"]
            for percent in (round(ours), of_paper):
                assert f"{-percent:+d} %".replace("-", "\N{MINUS SIGN}") in seen.text


def test_nothing_is_loaded_from_outside(folders: list[Path], tmp_path: Path) -> None:
    html, seen = page(folders, tmp_path / "report.html")
    assert seen.references
    assert all(reference.startswith(("#", "data:image/")) for reference in seen.references)
    assert not re.search(r"url\(|@import|<script", html)
    assert all(reference[1:] in seen.ids for reference in seen.references if reference.startswith("#"))
    assert len(set(seen.ids)) == len(seen.ids)


def test_all_figures_of_a_run_are_in_it(folders: list[Path], tmp_path: Path) -> None:
    drawn = {path.stem for path in (folders[0] / "figures").iterdir()}
    _, seen = page(folders[:1], tmp_path / "report.html")
    assert {f"run1-{name}" for name in drawn} <= set(seen.ids)
    assert seen.tags.count("img") == len(drawn) == 7  # all but temperatures, which this plant has not


def test_a_comparison_names_all_runs_and_what_differs(folders: list[Path], tmp_path: Path) -> None:
    html, _ = page(folders, tmp_path / "report.html")
    comparison = html[html.index('id="comparison"') : html.index("<article")]
    assert all(f">{folder.name}</a>" in comparison for folder in folders)
    assert "disturbance.velocity_m_s" in comparison
    assert "radio.delay_frames" not in comparison


def test_what_a_user_wrote_is_text(folders: list[Path], tmp_path: Path) -> None:
    results = {EVIL: summary_of(folders[0])["results"]["flc"]}
    changed = {"description": EVIL, "scenario": EVIL, "controllers": [EVIL], "results": results}
    html, seen = page([copy(folders[0], tmp_path / "evil", **changed)], tmp_path / "report.html")
    assert "script" not in seen.tags
    assert "<script" not in html
    assert seen.text.count(EVIL) > 3


def test_an_incomplete_run_is_shown_as_such(folders: list[Path], tmp_path: Path) -> None:
    nothing = {"complete": False, "stopped": "robot 1 became unstable", "results": {}, "frames": 0, "simulated_s": 0.0}
    some = copy(folders[0], tmp_path / "some", complete=False, stopped="interrupted")
    none = copy(folders[0], tmp_path / "none", **nothing)
    for runs in ([none], [some], [some, none]):
        _, seen = page(runs, tmp_path / "report.html")
        assert seen.text.count("This run is incomplete.") == len(runs)
        assert ("robot 1 became unstable" in seen.text) == (none in runs)


def test_what_is_not_known_is_a_dash(folders: list[Path], tmp_path: Path) -> None:
    results = summary_of(folders[0])["results"]
    results["flc"] |= {"alpha": None, "peak_voltage_v": None, "peak_current_a": float("nan")}
    _, seen = page([copy(folders[0], tmp_path / "unknown", results=results)], tmp_path / "report.html")
    assert "nan" not in seen.text.lower().split()
    assert "None" not in seen.text
    assert seen.text.count("\N{EN DASH}") > 8


def test_settings_off_their_default_stand_out(folders: list[Path], tmp_path: Path) -> None:
    html, _ = page(folders[:1], tmp_path / "report.html")
    settings, defaults = summary_of(folders[0])["settings"], Settings().plain()
    names = [(section, name) for section in settings for name in settings[section]]
    off = [f"{s}.{n}" for s, n in names if settings[s][n] != defaults[s][n]]
    shown = html[html.index("Settings that differ") : html.index("<details>")]
    assert "reference.waypoints" in off
    assert re.findall(r'<th scope="row"><code>(.*?)</code>', shown) == off
    assert html.count('<tr class="changed">') == 2 * len(off)
    assert all(f"<code>{section}.{name}</code>" in html for section, name in names)


@pytest.mark.parametrize("text", [None, "", "{", "[]", "{}", '{"scenario": 3}', '{"results": []}'])
def test_a_folder_that_holds_no_run_is_refused_in_one_line(tmp_path: Path, text: str | None) -> None:
    if text is not None:
        (tmp_path / "summary.json").write_text(text)
    with pytest.raises(OmniError, match="run"):
        report.write([tmp_path], tmp_path / "report.html")
    assert not (tmp_path / "report.html").exists()


def test_the_command_writes_into_the_runs_folder_or_where_it_is_told(folders: list[Path], tmp_path: Path) -> None:
    report.command.main([str(folders[0])], standalone_mode=False)
    assert (folders[0] / "report.html").is_file()
    report.command.main([*map(str, folders), "--out", str(tmp_path / "both.html")], standalone_mode=False)
    assert (tmp_path / "both.html").is_file()
    before = (folders[0] / "summary.json").read_bytes()
    for wrong in ([], [str(tmp_path)], [str(folders[0]), "--out", str(folders[0] / "summary.json")]):
        with pytest.raises(OmniError):
            report.command.main(wrong, standalone_mode=False)
    assert (folders[0] / "summary.json").read_bytes() == before


def test_a_users_mistake_is_one_line(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "omni_mj.report", str(tmp_path)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 2
    assert done.stderr.startswith("error: ")
    assert done.stderr.count("\n") == 1
