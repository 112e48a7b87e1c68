"""The report in a real browser: everything in it loads, and it fits wide and narrow windows."""

import json
import re
import shutil
import subprocess
from pathlib import Path
from typing import Any

import pytest
from commands import invoke

CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
FLAGS = "--headless --no-sandbox --disable-gpu --disable-quic --no-first-run --disable-background-networking"
FLAGS += " --disable-component-update --disable-sync --hide-scrollbars --allow-file-access-from-files"
# Looks into the report from outside, since the report itself runs no scripts.
WRAPPER = """<body><iframe src="report.html" width="{width}" height="900"></iframe><script>
onload = () => {{
  const page = document.querySelector("iframe").contentDocument, root = page.documentElement;
  document.body.dataset.seen = JSON.stringify({{
    images: [...page.images].map(i => [i.complete, i.naturalWidth, i.getBoundingClientRect().right]),
    overflow: root.scrollWidth - root.clientWidth,
    inside: page.defaultView.performance.getEntriesByType("resource").map(r => r.name.slice(0, 10)),
  }});
}}</script>"""

pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="no chromium on the PATH")


def chromium(profile: Path, *args: str) -> str:
    command = [str(CHROMIUM), *FLAGS.split(), f"--user-data-dir={profile}", *args]
    return subprocess.run(command, capture_output=True, text=True, timeout=120, check=True).stdout


@pytest.fixture(scope="module")
def folder(runs: list[Path], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A report about a run."""
    base = tmp_path_factory.mktemp("browser")
    assert invoke("report", runs[0], "--out", base / "report.html") == 0
    return base


@pytest.mark.parametrize("width", [390, 1400])
def test_all_figures_load_and_nothing_is_wider_than_the_window(folder: Path, runs: list[Path], width: int) -> None:
    wrapper = folder / f"wrapper{width}.html"
    wrapper.write_text(WRAPPER.format(width=width))
    dom = chromium(folder / f"profile{width}", "--dump-dom", "--virtual-time-budget=20000", wrapper.as_uri())
    found = re.search(r'data-seen="(.*?)"', dom)
    assert found, "the report did not load"
    seen: dict[str, Any] = json.loads(found[1].replace("&quot;", '"'))
    assert len(seen["images"]) == len(list((runs[0] / "figures").glob("*.svg")))
    assert all(complete and wide > 0 and right <= width for complete, wide, right in seen["images"])
    assert seen["overflow"] <= 0
    assert set(seen["inside"]) <= {"data:image"}
