"""Wheels that are no circle: their ripple is measured, reported, and what the robot does."""

import re
from collections.abc import Callable
from math import pi, sqrt
from pathlib import Path

import mujoco
import numpy as np
import pytest
from commands import invoke
from numpy.typing import NDArray
from own_robot import written

import omni_mj as om
from omni_mj.mjcf import world_builder

AZIMUTHS = (50, 130, 230, 310)
RADIUS, ROLLER, HALF = 0.0275, 0.008, 0.0075
LONG = sqrt(RADIUS * ROLLER)
# Geom of a roller, and how far it reaches along a direction at an angle to the spoke, from its
# center
GEOMS: dict[str, tuple[str, Callable[[NDArray], NDArray]]] = {
    "sphere": (f'type="sphere" size="{ROLLER}"', lambda angle: ROLLER + 0 * angle),
    "capsule": (
        f'type="capsule" size="{ROLLER} {HALF}" euler="90 0 0"',
        lambda angle: ROLLER + HALF * np.sin(angle),
    ),
    "ellipsoid": (
        f'type="ellipsoid" size="{ROLLER} {LONG} {ROLLER}"',
        lambda angle: np.hypot(ROLLER * np.cos(angle), LONG * np.sin(angle)),
    ),
}


def write_robot(folder: Path, geom: str, rollers: int = 8) -> Path:
    """Write a robot whose rollers have another geom."""
    text = written(AZIMUTHS, radius=RADIUS, roller=ROLLER, rollers=rollers)
    file = folder / "mine.xml"
    file.write_text(re.sub('type="ellipsoid" size="[^"]*"', geom, text))
    return file


@pytest.mark.parametrize("kind", GEOMS)
def test_the_reported_ripple_is_that_of_the_chassis(tmp_path: Path, kind: str) -> None:
    """A robot that turns slowly rises and falls by it; the carpet yields by 0.03 mm.

    It turns as if its wheels had the mean of the axle's height as radius.
    """
    geom, reach = GEOMS[kind]
    file = write_robot(tmp_path, geom)
    angle = np.linspace(0, pi / 8, 1000)
    heights = (RADIUS - ROLLER) * np.cos(angle) + reach(angle)
    ripple_mm, radius_mm = 1e3 * np.ptp(heights), 1e3 * heights.mean()
    with pytest.warns(UserWarning, match="mine.xml: the wheels are not round") as warnings:
        scenario = om.load_scenario("rect", model=str(file))
    message = str(warnings[0].message)
    reported = [float(number) for number in re.findall(r"([0-9.]+) (?:mm|%)", message)]
    expected = [ripple_mm, 100 * ripple_mm / 27.5, radius_mm, 27.5]
    np.testing.assert_allclose(reported, expected, rtol=0.05, atol=0.005)

    world = world_builder.build_world(scenario.settings)
    model, (robot,) = world.model, world.robots
    model.dof_frictionloss[robot.slip_dofs] = 1.0  # no creep
    model.dof_damping[:] = model.dof_frictionloss[robot.wheel_dofs] = 0.0
    model.dof_armature[robot.wheel_dofs] = 100.0  # which keeps the speed of the wheels
    data = mujoco.MjData(model)
    data.qpos[:] = world.rest_qpos
    data.qvel[robot.wheel_dofs] = 3.0
    states = []
    while data.qpos[robot.wheel_qpos[0]] < 2.5 * pi / 4:
        mujoco.mj_step(model, data)
        states.append([data.qpos[robot.wheel_qpos[0]], data.qpos[2], *data.qpos[[3, 6]]])
    wheel_angle, height, cosine, sine = np.array(states).T
    assert 1e3 * np.ptp(height[100:]) == pytest.approx(ripple_mm, abs=0.03)
    headings = np.interp([pi / 4, pi / 2], wheel_angle, 2 * np.arctan2(sine, cosine))
    assert 80 * np.diff(headings)[0] / (pi / 4) == pytest.approx(radius_mm, abs=0.06)


def test_round_wheels_are_not_reported(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A command prints one line about wheels that are not round, and none about others."""
    for rollers, n_lines in ((8, 1), (15, 0)):
        file = write_robot(tmp_path, GEOMS["ellipsoid"][0], rollers)
        assert invoke("show rect --set", f"model.file={str(file)!r}") == 0
        lines = capsys.readouterr().err.splitlines()
        assert len(lines) == n_lines
        assert all(line.startswith("warning: mine.xml: the wheels are not") for line in lines)
    assert om.load_robot("tigers-v2016").facts["axle_ripple_m"] == pytest.approx(1.8e-5, abs=1e-6)


def test_a_hub_below_the_gap_between_rollers_is_refused(tmp_path: Path) -> None:
    """At half a pitch, spheres reach down to 26.02 mm."""
    file = write_robot(tmp_path, GEOMS["sphere"][0])
    hub = 'size="0.018 0.004" euler="0 90 0"'
    for size, message in (
        ("0.0262", "geom 'unnamed_geom_.' of its hub is 0.18 mm lower"),
        (0.0260, None),
    ):
        text = file.read_text().replace(hub, hub.replace("0.018", str(size)))
        (tmp_path / "hub.xml").write_text(text)
        if message:
            with pytest.raises(om.OmniError, match=message):
                om.load_scenario("rect", model=str(tmp_path / "hub.xml"))
        else:
            with pytest.warns(UserWarning, match="not round"):
                om.load_scenario("rect", model=str(tmp_path / "hub.xml"))
