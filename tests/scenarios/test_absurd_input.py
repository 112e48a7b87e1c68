"""Whatever a file or the command line holds, it is a scenario, or lines that say why not; soon, and no code runs."""

import tomllib
from pathlib import Path

import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

import omni_mj as om
from omni_control.errors import OmniError
from omni_mj.scenarios import scenario, toml_files
from omni_mj.scenarios.settings import every_setting
from omni_mj.simulate.simulation import Simulation
from omni_mj.studies import cost

LINE = 1500  # characters of an error, at most
SHORT = {"waypoints": [[0, 0], [0.1, 0]], "settle_s": 0}


def refused(text: str, folder: Path, *overrides: str) -> str:
    """The errors of a scenario's file."""
    path = folder / "given.toml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(OmniError) as error:
        scenario.load(str(path), overrides)
    return str(error.value)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("a." * 50_000 + "a = 1", "a key has more than 16 parts"),
        ("[" + "a." * 50_000 + "a]", "a key has more than 16 parts"),
        ('[radio]\n"a" . ' + "'b' ." * 40 + "c = 1", "a key has more than 16 parts"),
        ("a = " + "[" * 50_000 + "]" * 50_000, "nested too deeply"),
        ("a = " + "{a=" * 50_000 + "1" + "}" * 50_000, "nested too deeply"),
        ("seed = " + "9" * 5000, "not valid TOML"),
        ("description = '" + "a" * 3_000_000 + "'", "more than 2 MB"),
        (f"description = '{'a' * 1000}'", "a line of at most 500 letters"),
        ('description = "\\u001b[31mred\\u0007"', "without control characters"),
        ('name = "\\u001b[31mred"', "may hold letters, digits and ._-"),
        ("name = '..'", "the first no dot"),
        (f"name = '{'a' * 101}'", "1 to 100 letters"),
        ('"\\u001b[31m\\n\\u2028" = 1', "unknown name \\x1b[31m;"),
        ('[radio]\n"\\u001b[31m\\nloss" = 1', "unknown setting radio.\\x1b[31m loss;"),
    ],
)
def test_absurd_files_are_lines_that_can_be_printed(tmp_path: Path, text: str, says: str) -> None:
    error = refused(text, tmp_path)
    assert says in error
    assert all(line.isprintable() and len(line) < LINE for line in error.split("\n"))


@pytest.mark.parametrize(
    ("override", "says"),
    [
        ("radio.delay_frames=" + "9" * 5000, "must be a whole number from 0 to 600 frames"),
        ("reference.waypoints=" + "[" * 5000 + "]" * 5000, "must be a list of at least 2 poses"),
        ("x" * 5000, "cannot read --set xxx"),
        ("radio.\x1b[31m=1", "unknown setting radio.\\x1b[31m"),
        ("radio.delay_frames.x.y=1", "unknown setting radio.delay_frames.x.y"),
        ("sensors.encoder_counts=1", "no speed of the motor could be measured; 10 at least"),
        ("motor.magnet_per_k=-0.01", "leaves 0 of the torque constant at 125 deg C"),
        ("motor.copper_per_k=0.1", "leaves -3.5 of the resistance at -20 deg C"),
    ],
)
def test_absurd_settings_are_lines_that_can_be_printed(tmp_path: Path, override: str, says: str) -> None:
    also = ("motor.ambient_c=-20",) if "copper" in override else ()
    error = refused("", tmp_path, override, *also)
    assert says in error
    assert all(line.isprintable() and len(line) < LINE for line in error.split("\n"))


def test_a_reference_without_end_is_refused_before_it_is_planned() -> None:
    """A thousand laps of 100 m at 1 cm/s are 2,778 hours; so are those of 100 rad at 0.01 rad/s."""
    slow = {"max_speed_m_s": 0.01, "max_turn_rate_rad_s": 0.01, "laps": 1000}
    for waypoints in ([[0, 0], [50, 0], [0, 0]], [[0, 0, 0], [0, 0, 50], [0, 0, 0]]):
        chosen = om.scenario("rect", reference=slow | {"waypoints": waypoints})
        with pytest.raises(OmniError, match=r"takes more than 2778 h .*; 24 h at most"):
            Simulation(chosen)
    with pytest.raises(OmniError, match="24 h at most"):
        Simulation(om.scenario("circle", reference={"max_speed_m_s": 0.01, "laps": 1000, "length_m": 10}))


def test_the_least_encoder_tells_rest_from_the_highest_speed() -> None:
    """Of N counts a turn, at w turns a second, N w / 960 come in a cycle: of nine, less than one at 104 a second."""
    motor = om.scenario("rect").settings.motor
    least = next(n for n in range(1, 100) if n * motor.no_load_rpm / 60 / 960 >= 1)
    om.scenario("rect", sensors={"encoder_counts": least})
    with pytest.raises(OmniError, match=f"{least} at least"):
        om.scenario("rect", sensors={"encoder_counts": least - 1})


def test_commands_must_arrive_before_the_end() -> None:
    """The last frame in which one may is the last of the reference."""
    frames = Simulation(om.scenario("rect", plant="kinematic", reference=SHORT)).references[0].frames
    Simulation(om.scenario("rect", plant="kinematic", reference=SHORT, radio={"delay_frames": frames - 1}))
    with pytest.raises(OmniError, match=f"= {frames} is no less than the {frames} frames of the reference"):
        Simulation(om.scenario("rect", plant="kinematic", reference=SHORT, radio={"delay_frames": frames}))


def test_a_scenario_runs_no_code_unasked(tmp_path: Path) -> None:
    """Neither controllers nor plants; named beside the file, or allowed, they run."""
    ran, code = tmp_path / "ran", tmp_path / "mine.py"
    code.write_text(
        f"open({str(ran)!r}, 'w').close()\nimport omni_mj as om\n\n\nclass Mine(om.Controller):\n    pass\n\n\n"
        "class Toy:\n    pose = twist = advance = telemetry = lambda self: None\n"
    )
    mine = f"controllers = ['flc', '{code}:Mine']"
    for line, option in ((mine, "--controller"), (f"plant = '{code}:Toy'", "--plant")):
        error = refused(line, tmp_path)
        assert "is not run unasked" in error
        assert option in error
        with pytest.raises(OmniError, match="is not run unasked"):
            om.scenario(tmp_path / "given.toml")
        assert not ran.exists()
    for chosen in (
        om.scenario(tmp_path / "given.toml", code=True),
        om.scenario(tmp_path / "given.toml", plant=f"{code}:Toy"),
    ):
        assert chosen.has_code
        assert chosen.plant == f"{code}:Toy"
    assert ran.exists()


NAMES = st.sampled_from([setting.full for setting in every_setting()])
VALUES = st.one_of(
    st.floats(),
    st.integers(),
    st.booleans(),
    st.text(max_size=20),
    st.lists(st.lists(st.floats(), max_size=4), max_size=4),
    st.sampled_from([0, 1, -1, 1e-300, 1e300, "on", "inf"]),
)


@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(values=st.dictionaries(NAMES, VALUES, min_size=1, max_size=4))
@example(values={"model.file": "\U00018cd6"})
def test_any_settings_are_a_scenario_or_lines(tmp_path: Path, values: dict[str, object]) -> None:
    """One that is a scenario reads back from its file."""
    sections: dict[str, dict[str, object]] = {}
    for name, value in values.items():
        section, field = name.split(".")
        sections.setdefault(section, {})[field] = value
    made, error = None, ""
    try:
        made = om.scenario("rect", **sections)
    except OmniError as refusal:
        error = str(refusal)
    assert all(line.isprintable() and len(line) < LINE for line in error.split("\n"))
    if made is None:
        assert error
        return
    (tmp_path / "made.toml").write_text(made.to_toml(), encoding="utf-8")
    assert om.scenario(tmp_path / "made.toml") == made


@settings(max_examples=150, deadline=None)
@given(st.text(st.sampled_from("a1.\"'[]{}=, \n#-_\\\t\x00é\u2028"), max_size=80))
def test_texts_are_toml_or_errors_of_value(text: str) -> None:
    """As Python's own reader has it, but for keys of more parts than anybody needs."""
    found, errors = list[str](), list[str]()
    for read in (tomllib.loads, toml_files.parse):
        try:
            found.append(str(read(text)))
        except ValueError as refusal:
            errors.append(str(refusal))
    assert len(set(found)) + len(set(errors)) == 1 or "parts" in errors[0]


def test_memory_is_what_a_run_takes(monkeypatch: pytest.MonkeyPatch) -> None:
    """The log's own arrays, and copies of them; more than there is, is refused before anything is run."""
    chosen = om.scenario("rect", plant="kinematic", controllers=["flc", "p"], seeds=3, reference=SHORT)
    found = cost.estimate(chosen)
    simulation = Simulation(chosen)
    simulation.run()
    log = simulation.log
    assert (found.robots, found.frames) == (6, log.length)
    numbers = sum(log.channel(name).nbytes for name in log.columns)
    assert 1 < found.memory_b / numbers < 3
    monkeypatch.setattr(cost, "free_b", lambda: found.memory_b / 2)
    with pytest.raises(OmniError, match=r"^6 robots of \d+ frames take about .* GB of memory .* run fewer seeds"):
        cost.check([found])
