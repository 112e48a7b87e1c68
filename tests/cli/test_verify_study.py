"""Studies repeat as well: what they found is the same, or what differs is named."""

import json
import shutil
from pathlib import Path
from typing import Any

import pytest
from benches.loop import motion, study
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
    """From another folder, without the user's file; a number that was changed is found again by its name.

    In fewer cases than a user gets.
    """
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
    file = Path("elsewhere/summary.json")
    summary = json.loads(file.read_text())
    key = changed(summary["loop"])
    file.write_text(json.dumps(summary))
    assert invoke("verify", "elsewhere") == 1
    assert f"summary.json: loop.{key} is " in capsys.readouterr().err


def changed(found: Any) -> str:
    """Double the first number in what was found; its name."""
    for key, value in found.items() if isinstance(found, dict) else enumerate(found):
        if isinstance(value, float) and value:
            found[key] = 2 * value
            return str(key)
        if isinstance(value, (dict, list)) and (below := changed(value)):
            return f"{key}.{below}"
    return ""
