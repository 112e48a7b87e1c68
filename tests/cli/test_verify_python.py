"""What `Result.save` leaves from Python: it repeats where it can, and says what is missing where it cannot."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from commands import strict

import omni_mj as om

SHORT = {"waypoints": [[0, 0], [0.2, 0.1]], "settle_s": 0.1}
MINE = """
import omni_mj as om


class Mine(om.Controller):
    gain: float = 3.0

    def command(self, frame, seen):
        target, speed = self.reference.at(frame, seen.pose)
        return speed + self.gain * (target - seen.pose)
"""
PROGRAM = """
from mine import Mine

import omni_mj as om


class Here(Mine):
    pass


short = om.scenario("rect", plant="kinematic", reference={"waypoints": [[0, 0], [0.2, 0.1]], "settle_s": 0.1})
om.run(short, ["flc", Mine], seeds=range(2)).save("good")
om.run(short, [Here]).save("bad")
"""


def test_controllers_from_modules_repeat_and_those_of_the_program_itself_are_named(tmp_path: Path) -> None:
    """Of Mine the module's file is kept; Here is in a program that would run anew."""
    there = tmp_path / "there"
    there.mkdir()
    (there / "mine.py").write_text(MINE)
    (there / "program.py").write_text(PROGRAM)
    subprocess.run([sys.executable, "program.py"], cwd=there, check=True, timeout=60)
    shutil.move(there / "good", tmp_path / "good")
    shutil.move(there / "bad", tmp_path / "bad")
    shutil.rmtree(there)
    record = strict(tmp_path / "good" / "provenance.json")
    assert record["command"] is None
    assert [each["name"] for each in record["scenarios"]["rect"]["controllers"]] == ["flc", "Mine"]
    found = om.verify(tmp_path / "good")
    assert found.repeats
    assert found.rows == 4
    assert str(found).startswith(f"repeats: 4 rows, {found.frames} frames identical bit for bit")
    assert (tmp_path / "bad/sources/program.py").read_text() == PROGRAM
    with pytest.raises(
        om.OmniError, match=r"^the controller Here is a class of the program that ran.*sources/program.py"
    ):
        om.verify(str(tmp_path / "bad"))


def test_a_comparison_and_what_is_in_no_file(tmp_path: Path) -> None:
    """Frames that were not kept are not missed; a class that was made by exec is."""
    short = om.scenario("rect", plant="kinematic", reference=SHORT)
    om.compare([short, short.replace(name="again")], ["flc", "p"], seeds=2).save(tmp_path / "both")
    assert om.verify(tmp_path / "both").repeats
    names: dict[str, type] = {"__name__": "nowhere"}  # type: ignore[dict-item]
    exec(MINE, names)
    om.run(short, [names["Mine"]]).save(tmp_path / "none")
    with pytest.raises(om.OmniError, match=r"^the controller Mine was made in Python, and is in no file$"):
        om.verify(tmp_path / "none")
    for text in (os.path.expanduser("~"), str(Path.cwd())):
        assert text not in (tmp_path / "both" / "provenance.json").read_text()
