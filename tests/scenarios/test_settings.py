"""Settings made in Python: what every one of them declares, what is refused, all at once, and copies."""

import math
import pickle
import re
from typing import Any

import numpy as np
import pytest
from scenario_texts import NUMBERS, SETTINGS, SHEET, SWITCHES, WHOLE, errors, given, value_of

from omni_control.errors import OmniError, choose
from omni_mj.scenarios import references
from omni_mj.scenarios import settings as module
from omni_mj.scenarios.robot_settings import CarpetSettings
from omni_mj.scenarios.settings import (
    ControlSettings,
    RadioSettings,
    ReferenceSettings,
    Settings,
    column,
    every_setting,
)

UNITS = {
    "_rad_s2": "rad/s^2", "_nm_s": "N m s/rad", "_rad_s": "rad/s", "_m_s2": "m/s^2", "_m_s": "m/s", "_rad": "rad",
    "_nm_a": "N m/A", "_kg_m2": "kg m^2", "_rpm": "rpm", "_a": "A", "_ohm": "ohm",
    "_s2_m": "s^2/m", "_per_k": "1/K", "_j_k": "J/K", "_k_w": "K/W", "_nm": "N m", "_ah": "Ah",
    "_frames": "frames", "_c": "deg C", "_v": "V", "_n": "N", "_m": "m", "_s": "s",
}  # fmt: skip
# What a setting at its bounds needs of another.
COMPANIONS = {
    "kinematic.alpha_low": {"kinematic.alpha_high": 2},
    "kinematic.alpha_high": {"kinematic.alpha_low": 0},
    "radio.jitter_frames": {"radio.delay_frames": 600},
    "battery.cells": {"battery.cut_off_v": 3},
    "motor.magnet_per_k": {"motor.limit_c": 100},
}
NO_NUMBERS = [math.nan, math.inf, -math.inf, True, "1", [1], {}, None, np.array([1, 2]), 10**400, 10**5000]


def test_every_setting_says_what_it_means_in_what_unit_and_its_default_is_allowed() -> None:
    for name, each in SETTINGS.items():
        assert each.doc, name
        # A unit in the field's name and the unit shown must be the same.
        suffix = next((suffix for suffix in UNITS if name.endswith(suffix)), None)
        assert suffix is None or each.unit == UNITS[suffix], name
        assert Settings(**given({name: each.default})) == Settings(), name
        if each.number:
            assert each.low <= each.default <= each.high, name
            assert type(each.default) is each.kind, name
        if each.choices:
            assert each.default in each.choices, name


# Which other numbers bound as well (test_robot_checks.py, test_absurd_input.py).
FITTED = "body.", "wheels.", "battery.cut_off_v", "sensors.encoder_counts"


def test_both_bounds_are_allowed_and_what_is_beyond_is_refused() -> None:
    """One after the other; the message says what is allowed and in what unit."""
    for name, each in NUMBERS.items():
        for bound, beyond in ((each.low, -math.inf), (each.high, math.inf)):
            if name not in SHEET and not name.startswith(FITTED):
                whole = Settings(**given({name: bound, **COMPANIONS.get(name, {})}))
                assert value_of(whole, name) == bound, name
                assert type(value_of(whole, name)) is each.kind, name
            wrong = bound + math.copysign(1, beyond) if name in WHOLE else math.nextafter(bound, beyond)
            kind = "a whole number" if name in WHOLE else "a number"
            unit = f" {each.unit}" if each.unit else ""
            says = f"{name} must be {kind} from {each.allowed}{unit}, not {int(wrong) if name in WHOLE else wrong!r}"
            assert errors(**given({name: int(wrong) if name in WHOLE else wrong})) == [says]


def test_what_is_no_number_is_refused_wherever_one_is_wanted() -> None:
    """All settings at once, with a line for each."""
    for wrong in NO_NUMBERS:
        lines = errors(**given(dict.fromkeys(NUMBERS, wrong)))
        assert [line.split(" must be ")[0] for line in lines] == list(NUMBERS), wrong


def test_whole_numbers_are_whole() -> None:
    for wrong in (2.0, 2.5, np.float64(2)):
        lines = errors(**given(dict.fromkeys(WHOLE, wrong)))
        assert len(lines) == len(WHOLE)
        assert all("a whole number" in line for line in lines)


def test_numpys_numbers_serve_and_become_pythons() -> None:
    """A sweep's values often are."""
    made = Settings(radio={"delay_frames": np.int64(3)}, battery={"cut_off_v": np.float32(13)})
    assert (type(made.radio.delay_frames), type(made.battery.cut_off_v)) == (int, float)
    assert made == Settings(radio={"delay_frames": 3}, battery={"cut_off_v": 13})
    assert Settings(firmware={"derate": np.bool_(True)}).firmware.derate is True


def test_switches_are_true_or_false() -> None:
    assert SWITCHES
    for wrong in ("yes", 3, 0, 1, 1.5, [True], {}):
        assert errors(**given(dict.fromkeys(SWITCHES, wrong))) == [
            f"{name} must be true or false, not {wrong!r}" for name in SWITCHES
        ]


def test_choices_are_those_there_are() -> None:
    choices = {name: each for name, each in SETTINGS.items() if each.choices}
    assert len(choices) >= 4
    for wrong in ("iterate", 3, True, ["timed"], {}):
        assert errors(**given(dict.fromkeys(choices, wrong))) == [
            f"{name} must be {' or '.join(each.choices)}, not {wrong!r}" for name, each in choices.items()
        ]


@pytest.mark.parametrize("name", ["reference.waypoints", "world.places"])
def test_poses_are_lists_of_two_or_three_coordinates(name: str) -> None:
    points = [[0, 1], (2.5, 3, 0.5)]
    expected = ((0.0, 1.0, 0.0), (2.5, 3.0, 0.5))
    assert value_of(Settings(**given({name: points})), name) == expected
    assert value_of(Settings(**given({name: np.array([[0, 1, 0], [2.5, 3, 0.5]])})), name) == expected
    few: list[Any] = [[], [[0, 0]] * 13] if name == "world.places" else [[], [[0, 0]]]
    points = [1, [1], [1, 2, 3, 4], [True, 1], [math.nan, 1], [1, math.inf], [100.1, 0], ["1", 0], [10**400, 0], "ab"]
    for wrong in [3, "here", {"x": 1}, None, *few, *([[0, 0], point] for point in points)]:
        (line,) = errors(**given({name: wrong}))
        assert line.startswith(f"{name} must be a list of ")
        assert "poses [x, y] or [x, y, heading] in m and rad, within 100 m" in line
    (line,) = errors(**given({name: [[0, 0], [1]]}))
    assert line.endswith("; [1] is not one")


def test_patches_are_lists_of_a_centre_a_radius_and_a_friction() -> None:
    made = Settings(carpet={"patches": [[0, 1, 0.5, 0.3], (2, -3, 1, 5)]})
    assert made.carpet.patches == ((0.0, 1.0, 0.5, 0.3), (2.0, -3.0, 1.0, 5.0))
    assert Settings(carpet={"patches": np.array([[0, 1, 0.5, 0.3]])}).carpet.patches == ((0.0, 1.0, 0.5, 0.3),)
    patches = [[0, 0, 1], [0, 0, 1, 1, 1], [0, 0, 0, 1], [0, 0, -1, 1], [0, 0, 1, 0], [0, 0, 1, 5.1], [101, 0, 1, 1]]
    for wrong in [3, [1, 2, 3, 4], [[0, 0, 1, 0.5]] * 51, *([patch] for patch in [*patches, [0, 0, 1, True], "abcd"])]:
        (line,) = errors(carpet={"patches": wrong})
        assert line.startswith(
            "carpet.patches must be a list of 0 to 50 patches [x, y, radius, friction] in m, within 100 m, of friction "
            "0.01 to 5"
        )
    (line,) = errors(carpet={"patches": [[0, 0, 1, 1], [0, 0, 0, 1]]})
    assert line.endswith("; [0, 0, 0, 1] is not one")


def test_all_that_is_wrong_is_said_at_once() -> None:
    """One line each: values, names, sections, and what cannot be together."""
    wrong: dict[str, Any] = {
        "radio": {"delay_frames": -1, "delay": 3},
        "kinematic": {"alpha_low": 0.9, "alpha_high": 0.8},
        "carpet": 3,
        "rado": {"delay_frames": 3},
    }
    names = ", ".join(Settings.model_fields)
    assert errors(**wrong) == [
        "radio.delay_frames must be a whole number from 0 to 600 frames, not -1",
        "unknown setting radio.delay; did you mean 'radio.delay_frames'? "
        "choose from radio.delay_frames, radio.jitter_frames, radio.loss_probability",
        "carpet is a section: write [carpet] and its fields below, not 3",
        "kinematic.alpha_low must not be above kinematic.alpha_high",
        f"unknown section rado; did you mean 'radio'? choose from {names}",
    ]


def test_a_section_by_itself_is_checked_in_the_same_words() -> None:
    with pytest.raises(OmniError) as error:
        RadioSettings(delay_frames=-1, jiter_frames=0)
    assert str(error.value).splitlines() == errors(radio={"delay_frames": -1, "jiter_frames": 0})


def test_values_that_make_no_sense_together_are_refused() -> None:
    (line,) = errors(radio={"jitter_frames": 7})
    assert line.startswith("radio.jitter_frames must not be above radio.delay_frames")
    for shape in ("circle", "eight"):
        (line,) = errors(reference={"shape": shape, "mode": "iterated"})
        assert line.startswith("reference.mode = iterated ")
        assert line.endswith(f"reference.shape = {shape} needs reference.mode = timed")


def test_settings_cannot_be_changed_but_copied_with_changes() -> None:
    one = Settings()
    for model, name in ((one, "radio"), (one.radio, "delay_frames")):
        with pytest.raises(OmniError, match=rf"{name} cannot be changed; replace\(\)"):
            setattr(model, name, 3)
    other = one.replace(radio={"delay_frames": 9}, carpet=CarpetSettings(friction=0.4), controller={"P": {"k": 1}})
    assert (other.radio.delay_frames, other.radio.jitter_frames, other.carpet.friction) == (9, 0, 0.4)
    assert other.replace(radio={"jitter_frames": 2}).radio == RadioSettings(delay_frames=9, jitter_frames=2)
    assert other.replace(controller={"P": {"n": 2}}).controller == {"P": {"k": 1, "n": 2}}
    assert other.vision is one.vision
    assert one == Settings()
    with pytest.raises(OmniError, match=r"^radio.jitter_frames must not be above"):
        one.replace(radio={"jitter_frames": 7})
    with pytest.raises(OmniError, match="unknown section rado"):
        one.replace(rado={"delay_frames": 3})


def test_equal_settings_are_one_key_and_survive_pickling() -> None:
    made = [Settings(radio={"delay_frames": delay}, controller={"P": {"k": 1.5}}) for delay in (3, 3, 4)]
    assert len(set(made)) == 2
    again = pickle.loads(pickle.dumps(made[0]))
    assert (again, hash(again)) == (made[0], hash(made[0]))
    assert {made[0].controller: 3}[made[1].controller] == 3


def test_a_column_has_every_robots_value() -> None:
    same, other = RadioSettings(), RadioSettings(delay_frames=9)
    assert column([same] * 3, "delay_frames").tolist() == [[6.0]] * 3
    assert column([same, other, same], "delay_frames").tolist() == [[6.0], [9.0], [6.0]]


def test_plain_settings_are_what_toml_holds() -> None:
    plain = Settings(reference={"waypoints": [[0, 0], [1, 0]]}, controller={"P": {"k": 1}}).plain()
    assert plain["reference"]["waypoints"] == [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]]
    assert plain["controller"] == {"P": {"k": 1}}
    assert {f"{section}.{name}" for section, values in plain.items() for name in values} == {*SETTINGS, "controller.P"}


def test_the_shapes_are_the_curves_and_two_more() -> None:
    """The declaration takes their names from where the curves are."""
    assert SETTINGS["reference.shape"].choices == ("waypoints", "random", *module.CURVES)
    assert ReferenceSettings(shape="eight").shape == "eight"


def test_limits_of_jerk_are_passed_on_to_references_that_can_keep_them() -> None:
    """Zero is none; what plans anew cannot, and says so, with whatever else is wrong, each in a line."""
    limits = references.motion_limits(ReferenceSettings(max_jerk_m_s3=8.0, max_turn_jerk_rad_s3=90.0))
    assert (limits.jerk, limits.turn_jerk) == (8.0, 90.0)
    none = references.motion_limits(ReferenceSettings())
    assert none.jerk is None
    assert none.turn_jerk is None
    with pytest.raises(OmniError) as error:
        ReferenceSettings(
            mode="iterated", max_jerk_m_s3=8.0, max_turn_jerk_rad_s3=0.05, max_side_acceleration_m_s2=0.005
        )
    lines = str(error.value).splitlines()
    assert len(lines) == 4
    for name in ("max_jerk_m_s3 needs reference.mode = timed", "max_turn_jerk_rad_s3 must be 0", "max_side_accel"):
        assert any(f"reference.{name}" in line for line in lines)


def test_what_wheels_can_do_is_that_of_the_robot_on_the_carpet_believed() -> None:
    """Not on the one it drives on; and none without a belief."""
    settings = Settings(carpet={"friction": 0.4}, body={"mass_kg": 2.0, "yaw_inertia_kg_m2": 0.0098})
    wheels = references.reference_limits(settings).wheels
    assert wheels is not None
    assert wheels.friction == pytest.approx(0.85 * 0.8)
    assert wheels.gyration == pytest.approx(0.07)
    assert wheels.kinematics == settings.wheels.kinematics
    # 14.8 V less 0.464 ohm times 1.7 A, by 0.0251 V s/rad and 3.33 : 1, of which 85 % are asked.
    assert wheels.rim_speed == pytest.approx(0.85 * 0.0285 * (14.8 - 0.464 * 1.70) / (0.0251 * 3.3333), rel=1e-3)
    assert references.reference_limits(settings.replace(reference={"friction": 0.0})).wheels is None
    with pytest.raises(OmniError, match=r"^reference\.friction = 0\.2 .* wheels cannot pull what drags them"):
        references.timed(settings.replace(reference={"friction": 0.2}))


def test_less_acceleration_sideways_is_passed_on_and_commands_know_none() -> None:
    """Zero is the same as ahead; what is too little to arrive is refused."""
    given_limits = {"max_acceleration_m_s2": 3.0, "max_side_acceleration_m_s2": 2.0}
    limits = references.motion_limits(ReferenceSettings(**given_limits))
    assert (limits.acceleration, limits.side_acceleration) == (3.0, 2.0)
    assert references.motion_limits(ReferenceSettings(max_acceleration_m_s2=3.0)).side_acceleration is None
    assert references.motion_limits(ControlSettings()).side_acceleration is None
    with pytest.raises(OmniError, match=r"reference\.max_side_acceleration_m_s2 must be 0, .* at least 0\.01"):
        ReferenceSettings(max_side_acceleration_m_s2=0.005)


def test_of_more_names_than_anybody_reads_only_those_alike_are_told() -> None:
    names = [each.full for each in every_setting()]
    said = choose("vision.position_nose_m", names)
    assert re.fullmatch(r"did you mean 'vision.position_noise_m'(, '[a-z_.]+')? or '[a-z_.]+'\?", said)
    assert choose("qqqqqq", names) == f"choose from {', '.join(names)}"
