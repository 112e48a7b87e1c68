"""Faults as settings: reading, writing, validation, and the plants that support them."""

from pathlib import Path
from typing import Any

import pytest

import omni_mj as om
from omni_mj.config.faults import FAULT_KINDS

PUSH: dict[str, Any] = {
    "kind": "push",
    "start_s": 3,
    "duration_s": 0.2,
    "force_n": 20.0,
    "direction_deg": 90.0,
}


def error_lines(faults: Any, **more: Any) -> list[str]:
    with pytest.raises(om.OmniError) as error:
        om.load_scenario("rect", fault=faults, **more)
    return str(error.value).splitlines()


def test_faults_are_tables_in_toml_and_dicts_in_python(tmp_path: Path) -> None:
    file = tmp_path / "faults.toml"
    file.write_text(
        '[[fault]]\nkind = "push"\nstart_s = 3\nduration_s = 0.2\n'
        "force_n = 20\ndirection_deg = 90\n"
    )
    read, scenario = om.load_scenario(file), om.load_scenario("rect", fault=[PUSH])
    assert read.settings.fault == scenario.settings.fault
    assert scenario.settings.to_dict()["fault"] == [{"robots": [], **PUSH}]
    file.write_text(scenario.to_toml())
    assert om.load_scenario(file) == scenario
    assert scenario.settings.replace(carpet={"friction": 0.5}).fault == scenario.settings.fault
    assert scenario.settings.replace(fault=[]).fault == ()


def test_fault_all_has_every_kind_of_plants_on_wheels() -> None:
    present = {fault.kind for fault in om.load_scenario("fault-all").settings.fault}
    assert present == FAULT_KINDS.keys() - {"alpha"}


def test_all_errors_name_the_number_of_their_fault() -> None:
    messages = error_lines(
        [
            PUSH,
            {"kind": "psh"},
            {**PUSH, "start_s": -1, "forc_n": 3},
            3,
            {"kind": "tilt"},
            {"start_s": 1},
        ]
    )
    expected = [
        ("fault 2: ", "'psh'", "did you mean 'push'"),
        ("fault 3: ", "start_s ", "0 to 36000 s", "-1"),
        ("fault 3: ", "forc_n", "did you mean 'force_n'"),
        ("fault 4: ", "3"),
        ("fault 5: ", "start_s is missing"),
        ("fault 5: ", "angle_deg is missing"),
        ("fault 6: ", "None"),
    ]
    assert len(messages) == len(expected)
    for line, words in zip(messages, expected, strict=True):
        assert all(word in line for word in words), line


@pytest.mark.parametrize(
    ("fault", "more", "words"),
    [
        ({**PUSH, "duration_s": 0.01}, {}, "at least a frame"),
        ({**PUSH, "robots": [16]}, {}, "15"),
        (
            {"kind": "radio-delay", "start_s": 1, "delay_frames": 600.5},
            {},
            "less than or equal to 600 (0 to 600 frames)",
        ),
        (
            {"kind": "radio-delay", "start_s": 1, "delay_frames": 1},
            {"radio": {"jitter_frames": 2}},
            "radio.jitter_frames",
        ),
        (
            {"kind": "motor-demagnetized", "start_s": 1, "wheel": 5, "factor": 0.5},
            {},
            "the robot has 4",
        ),
        (
            {"kind": "push", "start_s": 1, "force_n": 1},
            {"plant": "kinematic"},
            "the plant kinematic has no push",
        ),
        ({"kind": "alpha", "start_s": 1, "alpha": 1}, {}, "the plant mujoco has no alpha"),
    ],
)
def test_contradictory_faults_are_rejected(fault: Any, more: dict[str, Any], words: str) -> None:
    (line,) = error_lines([fault], **more)
    assert line.startswith("fault 1: ")
    assert words in line


def test_fault_must_be_a_list() -> None:
    for wrong in (3, "push", {"kind": "push"}, None):
        assert error_lines(wrong)[0].startswith("fault is a list: write [[fault]]")


def test_faults_of_missing_robots_are_rejected_by_the_simulation() -> None:
    scenario = om.load_scenario("rect", fault=[{**PUSH, "robots": [1]}])
    with pytest.raises(om.OmniError, match="fault 1: push names robot 1; a world has 1"):
        om.Simulation(scenario)
