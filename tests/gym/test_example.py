"""What the documents say of learning: their lines run, and so does the example."""

import re
from pathlib import Path

import pytest
from commands import run_python

ROOT = Path(__file__).parents[2]


def test_the_example_trains_and_drives(tmp_path: Path) -> None:
    """One update of the policy; docs/data/learned-policy.csv has the errors of whole trainings."""
    pytest.importorskip("stable_baselines3", reason="the example's own requirement, 5.5 GB")
    tmp_path.joinpath("short.toml").write_text(
        "[reference]\nwaypoints = [[0, 0], [0.2, 0.1]]\nsettle_s = 0.1\n"
    )
    example = ROOT / "examples" / "learn" / "ppo.py"
    options = "--frames 4096 --scenario short.toml"
    done = run_python(example, options, cwd=tmp_path, timeout=120)
    assert (done.returncode, done.stderr) == (0, "")
    assert re.search(r"^Learned +\d", done.stdout, re.MULTILINE)


def test_the_lines_of_the_document_run() -> None:
    for text in re.findall(
        r"^```python\n(.*?)^```",
        (ROOT / "docs" / "how-to" / "train-a-policy.md").read_text(),
        re.MULTILINE | re.DOTALL,
    ):
        exec(text, {"__name__": "printed"})
