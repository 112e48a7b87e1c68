"""Studies repeat as well."""

import shutil
from pathlib import Path

import pytest
from benches.studies import motion, study
from commands import invoke

MINE = """
import omni_mj as om


class Mine(om.Controller):
    gain: float = 3.0

    def command(self, frame, seen):
        target, speed = self.reference.at(frame, seen.pose)
        return speed + self.gain * (target - seen.pose)
"""


def test_margins_of_a_users_controller_repeat(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """From another folder, without the user's file; in fewer cases than a user gets."""
    monkeypatch.setattr(study, "CASES", {name: motion.CASES[name] for name in ("rest, forward", "driving, across")})
    monkeypatch.chdir(tmp_path)
    Path("mine.py").write_text(MINE)
    words = ("--plant", "kinematic", "--controller", "mine.py:Mine", "--set", "controller.Mine.gain=4.0")
    assert invoke("loop", *words, "--out", "out", "--quiet") == 0
    Path("mine.py").unlink()
    shutil.move("out", "elsewhere")
    capsys.readouterr()
    assert invoke("verify", "elsewhere") == 0
    assert capsys.readouterr().out.startswith("repeats: ")
