"""What a user's model lacks is said before anything is built: what, and how to give it."""

import re
import tomllib
from pathlib import Path

import pytest
from commands import invoke
from own_robot import written

import omni_mj as om

TEXT = written((60, 180, 300))


ARM = 'pos="0.08 0 0.0275"'
# What is said, in how many lines; and the edits, plain text or a pattern, that bring it about.
MODEL_ERRORS: list[tuple[str, int, list[tuple[str, str]]]] = [
    ("no wheels; a wheel is a hinge that a <dcmotor> drives, with rollers.*across the axle$", 1,
     [("<actuator>.*</actuator>", "")]),
    ("no wheels.*other actuators do not count: write <dcmotor joint=", 1,
     [("<dcmotor motorconst[^>]*>", ""), ("<dcmotor name", "<motor name")]),
    ("'drive_b' has rollers, but no <dcmotor> drives it: write", 1,
     [('<dcmotor name="m_drive_b"[^>]*>', "")]),
    ("'base', which carries the wheels, has no <freejoint>", 1, [("<freejoint/>", "")]),
    ("'base', which carries the wheels, has no <freejoint>", 1,
     [("<freejoint/>", '<joint type="slide" axis="1 0 0"/><joint axis="0 0 1"/>')]),
    ("no encoder on 'drive_[abc]'; it is a <jointpos> sensor", 3, [("jointpos", "jointvel")]),
    ("no gyro; it is a <gyro> sensor on a site of the body 'base'", 1, [("<gyro [^>]*>", "")]),
    ("z axis of the gyro's site must point up", 1,
     [('<site name="imu"/>', '<site name="imu" euler="90 0 0"/>')]),
    ("no wheels.*across the axle$", 1, [('<joint axis="0 1 0"/>', '<joint axis="1 1 0"/>')]),
    ("2 wheels; at least 3 are needed", 1,
     [('<frame euler="0 0 60">(.*?)<replicate.*?</replicate>', r'<frame euler="0 0 60">\1')]),
    ("two <dcmotor>s drive one hinge; leave one", 1,
     [("<actuator>", '<actuator><dcmotor name="twin" joint="drive_a"/>')]),
    ("the 14 rollers of the wheel 'drive_[abc]' must be evenly spaced", 3,
     [('count="15"', 'count="14"')]),
    ("'drive_b' at .-0.06, 0.01. m must point horizontally at the center", 1,
     [('<frame euler="0 0 180">', '<frame euler="0 0 180" pos="0.02 0.01 0">')]),
    ("wheels must be equal, but their arms are 80.00, 75.00, 80.00 mm", 1,
     [(f"{ARM}(.*){ARM}(.*){ARM}", rf"{ARM}\1{ARM.replace('8', '75')}\2{ARM}")]),
    ("'m_drive_[abc]' has no rotor: give its inertia in kg m.2, armature=", 3,
     [(' armature="1.35e-5"', "")]),
    ("the gear of the <dcmotor> 'm_drive_[abc]' must be above 0, not -3.2", 3,
     [('gear="3.2"', 'gear="-3.2"')]),
    ("'m_drive_[abc]' must be driven by a voltage, with motorconst", 3,
     [("<dcmotor m", '<dcmotor inductance="1e-4" m')]),
    ("'drive_a' has a range or a spring; a wheel must turn freely", 1,
     [('<joint name="drive_a"', r'\g<0> stiffness="1"')]),
    ("'drive_[ab]' must be moved by its <dcmotor> alone: remove", 2,
     [("<actuator>", '<equality><joint joint1="drive_b"/></equality>'
       '<actuator><velocity joint="drive_a" kv="1" armature="0"/>')]),
    ("'m_drive_a' must be driven by a voltage, .* delays belong in the robot's file", 1,
     [('<dcmotor name="m_drive_a"', r'\g<0> delay="0.01" nsample="9"')]),
    ("'unnamed_joint_[0-9]*' has a range or a spring; a wheel must turn freely", 3,
     [('<joint axis="0 1 0"', r'\g<0> stiffness="0.01"')]),
    ("<compiler settotalmass> has no effect in a world", 1,
     [("<compiler ", '<compiler settotalmass="3" ')]),
    ("XML parse error", 1, [("</mujoco>", "")]),
]  # fmt: skip


def test_missing_parts_of_a_model_are_named_with_its_file(tmp_path: Path) -> None:
    file = tmp_path / "mine.xml"
    for message, lines, edits in MODEL_ERRORS:
        text = TEXT
        for pattern, new in edits:
            text, count = re.subn(pattern, new, text, flags=re.DOTALL)
            assert count, pattern
        file.write_text(text)
        with pytest.raises(om.OmniError) as error:
            om.load_scenario("rect", model=str(file))
        reported = str(error.value).splitlines()
        assert len(reported) == lines, reported
        assert all(line.startswith("mine.xml") and re.search(message, line) for line in reported), (
            message,
            reported,
        )


def test_settings_must_not_contradict_the_model(tmp_path: Path) -> None:
    """All errors at once; differences from a robot's file are also reported."""
    file = tmp_path / "mine.xml"
    file.write_text(TEXT)
    with pytest.raises(om.OmniError) as error:
        om.load_scenario(
            "rect",
            model=str(file),
            body={"mass_kg": 3.0},
            wheels={"arm_m": 0.07},
            motor={"gear_ratio": 3.2},
        )
    first_line, second_line = str(error.value).splitlines()
    assert first_line.startswith(
        "body.mass_kg = 3.0 contradicts mine.xml, which has 2.3995; change the model"
    )
    assert second_line.startswith("wheels.arm_m = 0.07 contradicts mine.xml, which has 0.08; ")
    chosen = om.load_scenario("rect", model=str(file), robot="ssl-a-team")
    again = chosen.replace(settings=chosen.settings.replace(body={"mass_kg": 2.0}))
    with pytest.raises(om.OmniError, match=r"body.mass_kg = 2.0 contradicts mine.xml"):
        om.Simulation(again, ["flc"])


def test_the_command_line_accepts_a_model(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("mine.xml").write_text(TEXT)
    assert invoke("run --scenario rect --model none.xml") == 2
    assert (
        capsys.readouterr().err
        == "error: there is no model none.xml; give the path of a robot's MJCF: robot.xml\n"
    )
    assert invoke("run --scenario rect --robot mine.xml") == 2
    assert "unknown robot 'mine.xml'" in capsys.readouterr().err
    assert invoke("run --scenario rect --model mine.xml --set wheels.rollers=16") == 2
    assert "wheels.rollers = 16 contradicts mine.xml, which has 15" in capsys.readouterr().err
    short = "--set reference.waypoints=[[0,0],[0.05,0]] --set reference.settle_s=0"
    words = f"--scenario rect {short} --model mine.xml --controller flc --out out"
    assert invoke("run", words, "--no-record --no-figures") == 0
    text = Path("out/scenario.toml").read_text()
    assert 'file = "mine.xml"' in text
    assert "rollers = 15" in text


def test_a_robot_file_may_name_a_model_and_omit_its_numbers(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The model is relative to the robot's file; `om.load_robot` shows what follows from both."""
    (tmp_path / "mine.xml").write_text(TEXT)
    ours = tomllib.loads((Path(om.__file__).parent / "robots" / "tigers-v2016.toml").read_text())
    lines = ["[model]", 'file = "mine.xml"']
    for section in ("motor", "battery", "sensors", "firmware", "drivetrain", "carpet"):
        lines += [
            f"[{section}]",
            *(
                f"{k} = {v}"
                for k, v in ours[section].items()
                if k not in ("gear_ratio", "rotor_inertia_kg_m2")
            ),
        ]
    (tmp_path / "mine.toml").write_text("\n".join(lines))
    robot = om.load_robot(tmp_path / "mine.toml")
    assert robot.facts["mass_kg"] == pytest.approx(2.2 + 3 * (0.044 + 15 * 0.0015))
    assert om.load_scenario("rect", robot=robot).settings.motor.gear_ratio == 3.2
    assert invoke("show", tmp_path / "mine.toml") == 0
    assert capsys.readouterr().out.startswith("# Derived from the numbers below:\n#   mass_kg")
    (tmp_path / "mine.xml").unlink()
    with pytest.raises(om.OmniError, match=r"there is no model .*mine.xml"):
        om.load_robot(tmp_path / "mine.toml")
