"""A user's own MJCF: it drives as the same robot does that a file of numbers describes."""

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
from numpy.typing import NDArray
from own_robot import ROLLER_KG, written

import omni_mj as om

WAY = {
    "waypoints": [[0, 0, 0], [0.3, 0.1, 0.5]],
    "settle_s": 0.1,
    "max_acceleration_m_s2": 2.0,
}
ROBOT = Path(om.__file__).parents[1] / "models" / "ssl_robot.xml"
FROM_MODEL = {"body": None, "wheels": None, "motor": ("gear_ratio", "rotor_inertia_kg_m2")}
FOUR, THREE = (50, 130, 230, 310), (60, 180, 300)
Write = Callable[[str], str]


@pytest.fixture
def write(tmp_path: Path) -> Write:
    def write(text: str) -> str:
        file = tmp_path / f"mine_{len(list(tmp_path.iterdir()))}.xml"
        file.write_text(text)
        return str(file)

    return write


def numbers_of(file: str) -> dict[str, dict[str, Any]]:
    """Return the settings that a model says, by section and field."""
    plain = om.load_scenario("rect", model=file).settings.to_dict()
    chosen = {
        section: {name: plain[section][name] for name in names or plain[section]}
        for section, names in FROM_MODEL.items()
    }
    del chosen["wheels"]["model"]
    return chosen


def path(**sections: Any) -> NDArray:
    """Return true poses (frames, 3) on a short path, by default with wheels of two rollers."""
    sections["wheels"] = {"model": "two-rollers"} | sections.get("wheels", {})
    chosen = om.load_scenario("rect", controllers=["comp-flc"], reference=WAY, **sections)
    result = om.run(chosen)
    assert not result.failures, result.failures
    frames = result.frames()
    return np.column_stack([frames[name].to_numpy() for name in ("x_m", "y_m", "heading_rad")])


def test_our_model_under_other_names_is_our_robot(write: Write) -> None:
    """The paths are equal but for the digits in the file: nine, or six if MuJoCo saved it.

    Losses under load change when a current changes its sign; without them, digits matter less.
    """
    lossless = {"drivetrain": {"efficiency": 1.0}}
    expected = path(**lossless)
    text = ROBOT.read_text()
    for old, new in (
        ("wheel", "axle"),
        ("motor_", "m"),
        ("encoder", "counter"),
        ("rim", "ring"),
        ("roller", "bead"),
    ):
        text = re.sub(rf'"([a-z_]*){old}', rf'"\g<1>{new}', text)
    text = text.replace('"chassis"', '"robby"').replace('name="gyro"', 'name="rate"')
    saved = mujoco.MjSpec.from_string(text)
    saved.compile()
    for model, tolerance in ((text, 2e-4), (saved.to_xml(), 5e-4)):
        file = write(model)
        expected_settings, settings = numbers_of(file), om.load_scenario("rect").settings.to_dict()
        for section, fields in expected_settings.items():
            for name, value in fields.items():
                np.testing.assert_allclose(
                    value, settings[section][name], rtol=1e-5, atol=1e-6, err_msg=name
                )
        np.testing.assert_allclose(path(model=file, **lossless), expected, atol=tolerance)


# A motor without a wheel, which is ignored
DRIBBLER = (
    '<body name="d" pos="0.07 0 0"><joint name="d" axis="0 1 0"/>'
    '<geom size="0.005" mass="1e-6"/></body>'
)
DRIBBLER_MOTOR = '<dcmotor name="spin" joint="d"/>'
CASES: list[tuple[tuple[float, ...], dict[str, Any]]] = [
    (FOUR, {}),
    (THREE, {"arm": 0.078, "radius": 0.03, "roller": 0.005, "rollers": 17}),
    (FOUR, {"outward": True, "raised": 0.04, "more": DRIBBLER, "extra_motors": DRIBBLER_MOTOR}),
]


@pytest.mark.parametrize(("azimuths", "changes"), CASES)
def test_a_handwritten_model_drives_like_the_robot_with_its_numbers(
    write: Write, azimuths: tuple[float, ...], changes: dict[str, Any]
) -> None:
    """Its numbers are those of the MJCF; a robot file with these numbers gives the same path.

    Within 1 mm and 2 mrad, on 0.6 m at up to 0.8 m/s: rims and rollers weigh other parts of the
    same whole, and a hub that is one with its rim slips on the motor's shaft. With twice the creep
    stiffness, the headings agree within 1.3 mrad.
    """
    file = write(written(azimuths, **changes))
    expected_settings = numbers_of(file)
    arguments = {"arm": 0.08, "radius": 0.0275, "roller": 0.0055, "rollers": 15} | changes
    body, wheels = expected_settings["body"], expected_settings["wheels"]
    assert wheels["azimuths_deg"] == pytest.approx(azimuths)
    settings = [wheels[name] for name in ("arm_m", "radius_m", "roller_radius_m", "rollers")]
    assert settings == pytest.approx(
        [arguments[name] for name in ("arm", "radius", "roller", "rollers")]
    )
    assert body["mass_kg"] == pytest.approx(
        2.2 + len(azimuths) * (0.044 + arguments["rollers"] * ROLLER_KG)
    )
    # A disc of 80 mm about its axis, and wheels as points at their arm, which leave out 1 %.
    yaw = 2.2 * 0.08**2 / 2 + (body["mass_kg"] - 2.2) * arguments["arm"] ** 2
    assert body["yaw_inertia_kg_m2"] == pytest.approx(yaw, rel=0.02)
    assert expected_settings["motor"] == {"gear_ratio": 3.2, "rotor_inertia_kg_m2": 1.35e-5}
    by_model, by_numbers = path(model=file), path(**expected_settings)
    assert np.abs(by_numbers).max(0)[0] > 0.28, "it has driven"
    assert (np.abs(by_model - by_numbers).max(0) < [1e-3, 1e-3, 2e-3]).all()
    assert om.load_scenario("rect", model=file).settings.wheels.azimuths_deg == tuple(
        wheels["azimuths_deg"]
    )


def test_both_wheel_models_accept_a_custom_robot(write: Write) -> None:
    """A wheel turned by a third of a pitch is the same, except when it hops: 2 mm, 2 mrad."""
    text = written(THREE, rollers=15)
    plain = write(text)
    rotated = write(re.sub(r'(<body name="drive_[abc]" pos="[^"]*")', r'\1 euler="8 0 0"', text))
    expected = path(model=plain, wheels={"model": "rollers"})
    for model in ("rollers", "two-rollers"):
        assert np.abs(path(model=rotated, wheels={"model": model}) - expected).max() < 2e-3


def test_custom_robots_share_a_world_and_collide(write: Write) -> None:
    """Each robot has its own parts; hulls must be named."""
    start_poses = {"start_poses": [[0, 0, 0], [0, 1, 0]]}
    with pytest.raises(om.OmniError, match=r"no hull; .* class 'hull'"):
        om.Simulation(
            om.load_scenario("rect", model=write(written(THREE)), world=start_poses), ["flc"]
        )
    low = '<geom name="low" class="hull" size="0.06" pos="0 0 0.05" mass="0"/>'
    with pytest.raises(om.OmniError, match=r"hull 'low' must end above the carpet.* 10 mm below"):
        om.Simulation(
            om.load_scenario("rect", model=write(written(THREE, more=low)), world=start_poses),
            ["p"],
        )
    file = write(written(THREE).replace('name="plate"', 'class="hull"'))
    frames = om.run(
        om.load_scenario("rect", model=file, world=start_poses, reference=WAY), ["comp-flc"]
    ).frames()
    off = [np.subtract(frames[name], frames[f"ref_{name}"]) for name in ("x_m", "y_m")]
    assert np.hypot(*off).max() < 0.05


def test_worn_rollers_must_be_barrels_about_z(write: Write) -> None:
    """Worn rollers change the first two semi-axes; models with other geoms there are rejected."""
    worn: dict[str, Any] = {
        "randomization": {"max_wear_m": 1e-4},
        "reference": WAY,
        "controllers": ["flc"],
    }
    with pytest.raises(om.OmniError, match="ellipsoids about their z axes"):
        om.Simulation(om.load_scenario("rect", model=write(written(FOUR)), **worn))
    om.Simulation(om.load_scenario("rect", model=str(ROBOT), **worn))


@pytest.mark.parametrize("order", [(230, 130, 50, 310)])
def test_wheel_1_is_the_front_left_one_in_any_order(write: Write, order: tuple[int, ...]) -> None:
    """A broken wheel 2 gives the same path and wheel angles whatever order a file has."""
    fault = {"kind": "motor-dead", "start_s": 0.3, "wheel": 2}
    sections = {"wheels": {"model": "two-rollers"}, "reference": WAY, "fault": [fault]}
    frames = []
    for azimuths in (FOUR, order):
        for changes in (
            {"model": write(written(azimuths))},
            {"wheels": sections["wheels"] | {"azimuths_deg": list(azimuths)}},
        ):
            scenario = om.load_scenario("rect", **(sections | changes))
            assert scenario.settings.wheels.azimuths_deg == FOUR
            frames.append(om.run(scenario, ["comp-flc"]).frames())
    names = ["x_m", "y_m", "heading_rad", *(f"wheel_angle_{i}_rad" for i in range(1, 5))]
    for ordered, unordered in zip(frames[:2], frames[2:], strict=True):
        np.testing.assert_allclose(
            *(np.column_stack([rows[name] for name in names]) for rows in (unordered, ordered)),
            atol=1e-6,
        )
