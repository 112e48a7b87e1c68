"""Every time series of a recording follows from the table beside it."""

import numpy as np
import pytest
from numpy.typing import NDArray
from recorded import Driven, Recorded, rows

from omni_mj.scenarios import scenario
from omni_mj.show import style

CONTROLLERS = ("flc", "comp-flc")
BELOW = "/ratio", "/sigma"  # entities below a controller's


def ratio(position: NDArray, velocity: NDArray) -> NDArray:
    """Displacement achieved over commanded in the 15 frames before each, if more than 0.1 m/s was for 24 frames."""
    result = np.full(len(position), np.nan)
    for k in range(24, len(position)):
        mean = velocity[k - 15 : k].mean()
        if (abs(velocity[k - 24 : k]) > 0.1).all() and abs(mean) > 0.1:
            result[k] = (position[k] - position[k - 15]) / (mean * 15 / 60)
    return result


def why(t: dict[str, NDArray]) -> dict[str, list[NDArray]]:
    """By the limits of commands that are the default, and creep up to the default's friction."""
    command = np.column_stack([t["command_vx_m_s"], t["command_vy_m_s"], t["command_w_rad_s"]])
    step = 60 * np.diff(command, axis=0, prepend=np.zeros((1, 3)))
    settings = scenario.load("rect").settings
    limits = settings.control
    held = np.zeros(len(command))
    for each, speed, acceleration in (
        (slice(2), limits.max_speed_m_s, limits.max_acceleration_m_s2),
        (slice(2, 3), limits.max_turn_rate_rad_s, limits.max_turn_acceleration_rad_s2),
    ):
        at_speed = np.linalg.norm(command[:, each], axis=1) >= speed * (1 - 1e-9)
        held[at_speed | (np.linalg.norm(step[:, each], axis=1) >= acceleration * (1 - 1e-9))] = 1
    before = np.concatenate([np.zeros(14), held])
    vx, vy, turn = (60 * np.diff(t[name], prepend=t[name][0]) for name in ("x_m", "y_m", "heading_rad"))
    fastest = np.zeros(len(command))
    for i, azimuth in enumerate(np.deg2rad([60, 135, 225, 300])):
        at = t["heading_rad"] + azimuth
        centre = np.hypot(vx - 0.083 * turn * np.sin(at), vy + 0.083 * turn * np.cos(at))
        creep = 0.98 * centre * settings.carpet.friction / settings.drive.creep_stiffness
        fastest[1:] = np.maximum(fastest[1:], (t[f"slip_{i + 1}_m_s"] - creep - 0.02)[1:])
    return {
        "why/sliding": [fastest],
        "why/duty": [t["duty_peak"]],
        "why/limited": [np.max([t[f"current_limited_{i}"] for i in range(1, 5)], axis=0)],
        "why/held": [np.array([before[k : k + 15].mean() for k in range(len(held))])],
    }


def expected_series(t: dict[str, NDArray]) -> dict[str, NDArray]:
    """The series of one controller, from its rows of the table alone."""
    wheels = range(1, 5)
    c, s = np.cos(t["heading_rad"]), np.sin(t["heading_rad"])
    forward, left = (
        c * t["applied_vx_m_s"] + s * t["applied_vy_m_s"],
        c * t["applied_vy_m_s"] - s * t["applied_vx_m_s"],
    )
    turn = 0.083 * t["applied_w_rad_s"]  # at the wheels, 83 mm from the centre
    rim = [-np.sin(a) * forward + np.cos(a) * left + turn for a in np.deg2rad([60, 135, 225, 300])]
    series = {
        "wheel/speed": [*(v / 0.0285 for v in rim), *(t[f"wheel_speed_{i}_rad_s"] for i in wheels)],
        "wheel/voltage": [t[f"voltage_{i}_v"] for i in wheels],
        "wheel/current": [t[f"current_{i}_a"] for i in wheels],
        "wheel/slip": [t[f"slip_{i}_m_s"] for i in wheels],
        "winding": [t[f"winding_{i}_c"] for i in wheels],
        "battery": [t["battery_v"]],
        "error/distance": [100 * np.hypot(t["x_m"] - t["ref_x_m"], t["y_m"] - t["ref_y_m"])],
        "ahead": [100 * np.hypot(t["predicted_x_m"] - t["x_m"], t["predicted_y_m"] - t["y_m"])],
    }
    for axis, place, speed, scale in (
        ("x", "x_m", "vx_m_s", 100),
        ("y", "y_m", "vy_m_s", 100),
        ("heading", "heading_rad", "w_rad_s", 180 / np.pi),
    ):
        series[f"error/{axis}"] = [scale * (t[place] - t[f"ref_{place}"])]
        achieved = 60 * np.diff(t[place], prepend=t[place][0])
        series[f"velocity/{'turn' if axis == 'heading' else axis}"] = [
            t[f"command_{speed}"],
            t[f"applied_{speed}"],
            achieved,
        ]
        if axis != "heading":
            series[f"alpha/{axis}"] = [np.where(t[f"alpha_hat_{axis}"] == 1, np.nan, t[f"alpha_hat_{axis}"])]
            series[f"alpha/{axis}/sigma"] = [np.full(len(t["x_m"]), np.nan)] * 2  # which these controllers do not say
            series[f"alpha/{axis}/ratio"] = [ratio(t[place], t[f"applied_{speed}"])]
    return {name: np.column_stack(lines) for name, lines in (series | why(t)).items()}


@pytest.mark.parametrize("controller", CONTROLLERS)
def test_every_time_series_follows_from_the_table(driven: Driven, controller: str) -> None:
    recorded, expected = driven.recorded, expected_series(rows(driven.table, controller))
    found = {
        entity for entity in recorded.entities() if entity.startswith("/plots/") and controller in entity.split("/")
    }
    names = {}
    for name in expected:
        below = next((end for end in BELOW if name.endswith(end)), "")
        names[name] = f"/plots/{name.removesuffix(below)}/{controller}{below}"
    assert found == set(names.values())
    for name, entity in names.items():
        if np.isnan(expected[name]).all():
            assert not recorded.values(entity).size
            continue
        # Scalars are float64; sums in another order differ by rounding, near 1e-12 of what is summed.
        np.testing.assert_allclose(recorded.values(entity), expected[name], rtol=1e-9, atol=1e-9, err_msg=name)


def test_series_say_name_unit_and_rate_in_their_controllers_colour(recorded: Recorded) -> None:
    series = {entity for entity in recorded.entities(static=True) if entity.startswith("/plots/")}
    assert series == {entity for entity in recorded.entities() if entity.startswith("/plots/")}
    for entity in series:
        quantity, controller = entity.split("/")[2], entity.split("/")[-2 if entity.endswith(BELOW) else -1]
        names = recorded.static(entity, "SeriesLines:names")
        assert len(names) == len(set(names)) == (recorded.values(entity).shape[1] or len(names))
        for name in names:
            assert name.endswith("60 Hz)")
            assert ("," in name) == (quantity != "alpha" and entity.split("/")[3] not in ("duty", "limited", "held"))
            assert name.startswith(controller) or quantity in ("wheel", "winding")
        if quantity not in ("wheel", "winding"):
            red, green, blue = style.rgb(style.colour(style.SHIPPED.index(controller)))
            colour = recorded.static(entity, "SeriesLines:colors")[-1]
            assert colour in (
                red << 24 | green << 16 | blue << 8 | 255,
                recorded.static(entity, "SeriesLines:colors")[0],
            )
