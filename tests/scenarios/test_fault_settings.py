"""Faults as settings: what is read, written, refused, and which plants know which."""

import inspect
import pickle
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given
from hypothesis import settings as hypothesis_settings
from hypothesis import strategies as st
from omni_mj.link.camera_faults import Sight, Timing
from omni_mj.link.radio_faults import Mishaps
from omni_mj.scenarios.nested import plain
from scenario_texts import errors, fits, load, refusal

import omni_mj as om
from omni_control.errors import OmniError
from omni_mj.measure import events, metrics, recovery
from omni_mj.plants.faults import ACTS
from omni_mj.scenarios import faults
from omni_mj.scenarios.checking import Setting
from omni_mj.scenarios.faults import KINDS, ON_WHEELS, Delay, Fault, Push, span
from omni_mj.scenarios.library import builtin
from omni_mj.scenarios.rows import Row
from omni_mj.scenarios.schema import schema
from omni_mj.scenarios.settings import Settings
from omni_mj.show import listing
from omni_mj.simulate.simulation import Simulation
from omni_mj.studies.compare import usual

PUSH: dict[str, Any] = {"kind": "push", "at": 3, "for": 0.2, "force_n": 20.0, "direction_deg": 90}
USUAL = {"kind", "at", "for", "robots"}
FRICTION = "fault 1: friction needs wheels.creep = on"
DOCUMENT = Path(__file__).parents[2] / "docs" / "faults.md"


def value_of(setting: Setting) -> st.SearchStrategy[Any]:
    if setting.choices:
        return st.sampled_from(setting.choices)
    low, high = setting.low, min(setting.high or 0, 4) if setting.name == "wheel" else setting.high
    lasts = st.just(0.0) | st.floats(1 / 60, 100)
    if setting.name == "robots":
        return st.lists(st.integers(0, 15), max_size=12, unique=True)
    return lasts if setting.name == "for" else (st.integers if setting.kind is int else st.floats)(low, high)


tables = st.sampled_from(list(KINDS.values())).flatmap(
    lambda kind: st.fixed_dictionaries({each.name: value_of(each) for each in kind.declared()})
)


@hypothesis_settings(
    deadline=None, max_examples=20, derandomize=True, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(st.lists(tables, max_size=4))
def test_faults_survive_writing_and_reading_and_fit_the_schema(tmp_path: Path, drawn: list[dict[str, Any]]) -> None:
    """Those of the plant that the first asks for, without whom any plant will do."""
    asked = [KINDS[each["kind"]].plants for each in drawn]
    plant = next((plants for plants in asked if plants), ON_WHEELS)[0]
    chosen = [each for each, plants in zip(drawn, asked, strict=True) if plants is None or plant in plants]
    made = om.scenario("rect", plant=plant, fault=chosen)
    assert [plain(fault.values()) for fault in made.settings.fault] == made.settings.plain()["fault"] == chosen
    assert load(tmp_path, made.to_toml()) == made
    again = pickle.loads(pickle.dumps(made.settings))
    assert (again, hash(again)) == (made.settings, hash(made.settings))
    assert fits({"fault": chosen}, schema())


def test_faults_are_tables_in_files_and_dictionaries_in_python(tmp_path: Path) -> None:
    toml = '[[fault]]\nkind = "push"\nat = 3\nfor = 0.2\nforce_n = 20\n\n[[fault]]\nkind = "delay"\nat = 1\nto = 9\n'
    expected = Push(at=3, force_n=20, **{"for": 0.2}), Delay(at=1, to=9)
    assert load(tmp_path, toml).settings.fault == expected
    assert load(tmp_path, toml).settings.replace(carpet={"friction": 0.5}).fault == expected
    assert load(tmp_path, toml).settings.replace(fault=[]).fault == ()
    assert load(tmp_path, "").settings.fault == ()
    assert Settings(fault=expected) == Settings(fault=[each.values() for each in expected])
    assert expected[0].replace(**{"for": 0.5}).for_ == 0.5


def test_a_fault_lasts_for_whole_frames_whenever_it_begins() -> None:
    """So that a push is as strong: to the nearest frames, half of one to the even."""
    for at, lasts, frames in (
        (0.0, 0.2, (0, 12)),
        (1.0, 1 / 60, (60, 61)),
        (0.5 / 60, 0.1, (0, 6)),
        (1.5 / 60, 0.1, (2, 8)),
        (2.0, 0.0, (120, float("inf"))),
    ):
        assert span(Push(at=at, force_n=1, **{"for": lasts})) == frames


# --- what is refused ---


def test_wrong_faults_are_refused_with_their_number_all_at_once() -> None:
    assert errors(fault=[PUSH, {"kind": "psh"}, {**PUSH, "at": -1, "forc_n": 3}, 3, {"kind": "tilt"}, {"at": 1}]) == [
        f"fault 2: kind must be one of those there are, not 'psh'; did you mean 'push'? choose from {', '.join(KINDS)}",
        "fault 3: at must be a number from 0 to 36000 s, not -1",
        "fault 3: unknown setting forc_n; did you mean 'force_n'? "
        "choose from kind, at, for, robots, force_n, direction_deg",
        "fault 4: write [[fault]] and its fields below, not 3",
        "fault 5: at is missing; give a number from 0 to 36000 s",
        "fault 5: angle_deg is missing; give a number from 0 to 30 deg",
        f"fault 6: kind must be one of those there are, not None; choose from {', '.join(KINDS)}",
    ]


@pytest.mark.parametrize("wrong", [3, "push", {"kind": "push"}, None])
def test_what_is_no_list_is_refused(wrong: Any) -> None:
    assert errors(fault=wrong)[0].startswith(
        "fault is a list: write [[fault]] and its fields below, once for each, not"
    )


def test_the_command_line_does_not_reach_into_lists(tmp_path: Path) -> None:
    assert refusal(tmp_path, "", "fault.at=3").startswith("fault is a list: write [[fault]]")
    toml = '[[fault]]\nkind = "vision-out"\nat = 1\n'
    assert refusal(tmp_path, toml, "fault.at=3") == "cannot set fault.at: fault is not a section"


@pytest.mark.parametrize(
    ("fault", "says"),
    [
        ({**PUSH, "for": 0.01}, "fault 1: for must be 0, until the end, or at least a frame, 0.0167 s, not 0.01"),
        ({**PUSH, "kind": ["push"]}, "fault 1: kind must be one of those there are, not ['push']"),
        ({"kind": "delay", "at": 1, "to": 1.5}, "fault 1: to must be a whole number from 0 to 600 frames, not 1.5"),
        (
            {"kind": "motor-weak", "at": 1, "wheel": 5, "to": 0.5},
            "fault 1: motor-weak wheel must be 1 to 4, not 5: the robot has 4",
        ),
        (
            {"kind": "delay", "at": 1, "to": 1},
            "fault 1: delay to must not be below radio.jitter_frames, 2, but is 1",
        ),
        ({**PUSH, "robots": [1, 1]}, "fault 1: robots must be different numbers from 0 to 15, not [1, 1]"),
        ({**PUSH, "robots": 1}, "fault 1: robots must be a list of 0 to 12 whole numbers; 1 is no list"),
        ({**PUSH, "robots": ["a"]}, "fault 1: robots must be a list of 0 to 12 whole numbers; 'a' is none"),
        (Fault(kind="push", at=1), "fault 1: write [[fault]] and its fields below, not Fault("),
    ],
)
def test_what_makes_no_sense_is_refused(fault: Any, says: str) -> None:
    (line,) = errors(fault=[fault], radio={"jitter_frames": 2})
    assert line.startswith(says)


def test_friction_needs_wheels_that_creep() -> None:
    """As patches do."""
    fault = {"kind": "friction", "at": 1, "to": 0.5}
    assert errors(fault=[fault], wheels={"creep": "off"}) == [FRICTION]


# --- plants ---


def test_every_kind_acts_where_it_is_known_and_says_what_it_is() -> None:
    """Of those of plants on wheels there is a function each; every class has a kind of its own."""
    assert {kind for kind in KINDS.values() if kind.plants and set(ON_WHEELS) <= set(kind.plants)} == set(ACTS)
    assert {kind for kind in KINDS.values() if not kind.plants} == {
        Delay,
        *Mishaps.kinds,
        *Sight.kinds,
        *Timing.kinds,
    }
    declared = {kind for _, kind in inspect.getmembers(faults, inspect.isclass) if issubclass(kind, Fault)} - {Fault}
    assert declared == set(KINDS.values())
    for name, kind in KINDS.items():
        values: dict[str, Any] = {each.name: each.low for each in kind.declared() if each.number}
        one = kind(**{**values, "kind": name, "for": 0.5})
        assert "{" not in one.text
        assert one.told == f"{one.text}, from 0 s to 0.5 s"
        assert one.replace(**{"for": 0}).told == f"{one.text}, from 0 s on"


def test_a_plant_is_asked_for_what_it_knows_only() -> None:
    """When the scenario is made, is changed, or rows of one's own are."""
    known = "it has kidnap, delay, radio-loss, .*, vision-delay, alpha"
    refused = rf"^fault 1: the plant kinematic has no push; {known}$"
    on_wheels = om.scenario("rect", fault=[PUSH])
    for make in (
        lambda: om.scenario("rect", plant="kinematic", fault=[PUSH]),
        lambda: on_wheels.replace(plant="kinematic"),
        lambda: Simulation(
            om.scenario("rect", plant="kinematic"), rows=[Row(0, 0, "flc", 0, on_wheels.settings, "tigers-v2016")]
        ),
    ):
        with pytest.raises(OmniError, match=refused):
            make()
    with pytest.raises(OmniError, match=r"^seeds must .*\nfault 2: the plant mujoco has no alpha; it has push, "):
        om.scenario("rect", seeds=0, fault=[PUSH, {"kind": "alpha", "at": 0, "to": 1}])
    om.scenario("rect", plant="kinematic", fault=[{"kind": "alpha", "at": 0, "to": 1}, {"kind": "vision-out", "at": 1}])


def test_a_users_plant_names_the_kinds_that_it_knows(tmp_path: Path) -> None:
    calls = "".join(f"    def {call}(self, *_): ...\n" for call in ("pose", "twist", "advance", "telemetry"))
    (tmp_path / "toy.py").write_text(f"class Toy:\n    faults = 'push',\n{calls}\nclass Bare:\n{calls}")
    om.scenario("rect", plant=f"{tmp_path / 'toy.py'}:Toy", fault=[PUSH])
    with pytest.raises(OmniError, match=r"Bare has no push; it has delay, radio-loss, .*, vision-delay$"):
        om.scenario("rect", plant=f"{tmp_path / 'toy.py'}:Bare", fault=[PUSH])


def test_what_is_compared_happens_on_its_plant() -> None:
    """All scenarios on the one with wheels; on the other those without faults, and the radio's and the camera's."""
    assert {"rect", "fault-push", "fault-delay", "fault-vision"} <= set(usual("mujoco"))
    assert set(usual("mujoco")) - set(usual("kinematic")) == {
        f"fault-{name}"
        for name in ("push", "tilt", "friction", "payload", "motor", "firmware", "sensors", "wheels", "hand")
    }


def test_a_fault_of_some_robots_is_theirs_alone() -> None:
    """Where they are, and in what is told of it; a world must have them, and robots of one world one slope."""
    places, push = {"places": [[0, 0], [0, 1]]}, {**PUSH, "at": 0.0, "robots": [1]}
    hidden = {"kind": "vision-out", "at": 0.0, "robots": [1]}
    short = {"waypoints": [[0, 0], [0.1, 0]], "settle_s": 0}
    chosen = om.scenario("rect", plant="kinematic", controllers=["flc"], fault=[hidden], world=places, reference=short)
    simulation = Simulation(chosen)
    log = simulation.run()
    assert log.channel("vision_valid")[:, 0].any()
    assert not log.channel("vision_valid")[:, 1].any()
    assert {event.place for event in events.find(log) if event.kind == "fault"} == {1}
    measured = metrics.row_metrics(log)
    assert np.isnan(measured["fault_1_excursion_m"][0])
    assert np.isfinite(measured["fault_1_excursion_m"][1])
    assert recovery.results(log, "flc", measured)[0]["fault"].endswith(", of robots 1")
    with pytest.raises(OmniError, match=r"^fault 1: push is of robot 1, and a world has 1, numbered from 0$"):
        Simulation(om.scenario("rect", fault=[push]))
    tilt = {"kind": "tilt", "at": 1, "angle_deg": 3.0, "robots": [1]}
    with pytest.raises(OmniError, match=r"^robots that share a world stand on one carpet: "):
        Simulation(om.scenario("rect", fault=[tilt], world=places))


# --- told ---


def test_every_kind_is_listed_with_its_settings() -> None:
    lines = listing.faults()
    assert [line[0] for line in lines[:3]] == ["at", "for", "robots"]
    kinds = {line[0].removeprefix("kind = ") for line in lines if line[0].startswith("kind")}
    assert kinds == set(KINDS)
    named = [line[0].strip() for line in lines if line[0].startswith("  ")]
    assert named == [each.name for kind in KINDS.values() for each in kind.declared() if each.name not in USUAL]


def test_the_document_tells_every_kind_and_setting_and_its_examples_are_scenarios(tmp_path: Path) -> None:
    text = DOCUMENT.read_text(encoding="utf-8")
    for name, kind in KINDS.items():
        (line,) = (line for line in text.splitlines() if line.startswith(f"| `{name}` |"))
        assert all(f"`{each.name}`" in line for each in kind.declared() if each.name not in USUAL), name
    blocks = re.findall(r"^```toml\n(.*?)^```", text, re.MULTILINE | re.DOTALL)
    assert blocks
    assert all(load(tmp_path, block).settings.fault for block in blocks)
    assert all(name in text for name in builtin() if name.startswith("fault-"))
