"""`omni-mj loop`: what it prints, and what it leaves."""

from pathlib import Path

import pytest
from commands import invoke, strict

from omni_mj.cli import folders
from omni_mj.studies.loop import study
from omni_mj.studies.loop.motion import CASES


def test_the_loop_study_is_a_command(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """On the quicker plant, in fewer cases than a user gets."""
    for words, says in (
        (("--controller", "pp"), "unknown controller 'pp'"),
        (("--scenario", "rekt"), "unknown scenario 'rekt'"),
        (("--set", "radio.delay=1"), "did you mean 'radio.delay_frames'"),
    ):
        assert invoke("loop", *words, "--out", tmp_path / "bad") == 2
        assert says in capsys.readouterr().err
    monkeypatch.setattr(study, "CASES", {name: CASES[name] for name in ("rest, forward", "driving, across")})
    out = tmp_path / "out"
    words = ("--controller", "p", "--plant", "kinematic", "--set", "radio.delay_frames=3", "--out", out)
    assert invoke("loop", *words) == 0
    printed = capsys.readouterr().out
    assert "on the kinematic plant" in printed
    assert "driving, across" in printed
    assert {p.name for p in out.iterdir()} == {
        "summary.json",
        "scenario.toml",
        "loop.png",
        "loop.svg",
        *folders.PROVENANCE,
    }
    found = strict(out / "summary.json")["loop"]["cases"]["rest, forward"]["p"]["strengths"][1]["margins"]
    assert f"{found['phase']:.0f}" in printed.splitlines()[2].split()
    assert (out / "loop.png").stat().st_size > 10_000


def test_controllers_that_know_the_truth_are_measured_if_asked_for_only() -> None:
    assert "oracle" not in study.usual()
    assert {"flc", "comp-flc", "p"} <= set(study.usual())
