"""What `omni-mj identify` leaves can be identified again from the folder alone, and names a user's model by a copy."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from commands import invoke
from synthetic import Truth, logs

import omni_mj as om

HEAD = ["time_s", "x_m", "y_m", "heading_rad", "vx_cmd_world_m_s", "vy_cmd_world_m_s", "w_cmd_rad_s"]


@pytest.fixture(scope="module")
def table() -> np.ndarray:
    """Six seconds of a robot."""
    of = logs(om.scenario("rect").settings, [Truth()], 6.0, seed=1, speed=1.5)
    return np.column_stack([of.time, of.pose[:, 0], of.command[:, 0]])


@pytest.fixture
def log(table: np.ndarray, tmp_path: Path) -> Path:
    np.savetxt(path := tmp_path / "log.csv", table, delimiter=",", header=",".join(HEAD), comments="")
    return path


def test_it_repeats_elsewhere_or_says_what_differs(
    log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out, moved = tmp_path / "out", tmp_path / "moved"
    assert invoke("identify", log, "--out", out, "--quiet") == 0
    log.unlink()
    shutil.move(out, moved)
    assert invoke("verify", moved) == 0
    assert capsys.readouterr().out.startswith("repeats: 1 log, ")
    file = moved / "identify.json"
    found = json.loads(file.read_text())
    found["estimates"]["commands.latency_s"]["value"] *= 2
    file.write_text(json.dumps(found))
    assert invoke("verify", moved) == 1
    assert "identify.json: estimates.commands.latency_s.value is " in capsys.readouterr().err
    (moved / "sources" / "data" / "log.csv").write_text("")
    assert invoke("verify", moved) == 2
    assert "is not what was run" in capsys.readouterr().err


def test_a_model_of_the_users_goes_with_it(log: Path, tmp_path: Path) -> None:
    """Found by the robot's file that is written, wherever the folder is then; and the same robot."""
    (tmp_path / "mine").mkdir()
    model = tmp_path / "mine" / "robot.xml"
    model.write_text((Path(om.__file__).parents[1] / "models" / "ssl_robot.xml").read_text())
    out, moved = tmp_path / "out", tmp_path / "moved"
    assert invoke("identify", log, "--model", model, "--out", out, "--quiet") == 0
    shutil.rmtree(model.parent)
    shutil.move(out, moved)
    robot = om.robot(str(moved / "robot.toml"))
    assert Path(robot.settings.model.file).parent == moved / "sources" / "model"
    assert invoke("verify", moved, "--quiet") == 0
