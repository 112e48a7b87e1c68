"""A recording contains the values of the trajectory table and the geometry of the robots."""

from pathlib import Path

import mujoco
import numpy as np
import pytest
from benches.recording import (
    RecordedRun,
    RecordingFile,
    record_run,
    recorded_poses,
    rows,
    run_rrd_command,
)
from numpy.typing import NDArray

from omni_control.controllers.base import Controller, Observation

CONTROLLERS = ("flc", "comp-flc")
COLORS = {"flc": 0xD55E00FF, "comp-flc": 0x0072B2FF}
SHORT = "reference.waypoints=[[0, 0], [0.3, 0.2]]"
MODEL = Path(__file__).parents[2] / "models" / "ssl_robot.xml"


@pytest.mark.parametrize("controller", CONTROLLERS)
@pytest.mark.parametrize(
    ("entity", "prefix"), [("robot", ""), ("vision", "vision_"), ("predicted", "predicted_")]
)
def test_poses_are_those_of_the_table(
    driven: RecordedRun, controller: str, entity: str, prefix: str
) -> None:
    recorded, table = driven.recorded, rows(driven.table, controller)
    expected = np.column_stack([table[f"{prefix}{name}"] for name in ("x_m", "y_m", "heading_rad")])
    known = np.flatnonzero(~np.isnan(expected[:, 0]))
    assert sorted(recorded.frames(f"/world/{controller}/{entity}")) == known.tolist()
    # Transforms are float32, with an error of about 6e-8 m or rad.
    np.testing.assert_allclose(
        recorded_poses(recorded, f"/world/{controller}/{entity}"), expected[known], atol=1e-6
    )


def test_flags_are_position_errors_enlarged_ten_times(driven: RecordedRun) -> None:
    table, entity = rows(driven.table, "flc"), "/world/flc/error"
    position, reference = (
        np.column_stack([table[f"{prefix}{axis}_m"] for axis in "xy"]) for prefix in ("", "ref_")
    )
    strips = np.array(driven.recorded.column(entity, "LineStrips3D:strips"))[:, 0, :, :2]
    np.testing.assert_allclose(strips[:, 0], reference, atol=1e-6)
    np.testing.assert_allclose(strips[:, 2] - reference, 10 * (position - reference), atol=1e-6)
    labels = driven.recorded.column(f"{entity}/label", "Points3D:labels")
    distance_cm = 100 * np.hypot(*(position - reference).T)
    assert labels == [[f"flc  {cm:.1f} cm"] for cm in distance_cm]


def test_wheels_turn_by_the_angles_of_the_table(driven: RecordedRun) -> None:
    """Axles point to the robot's center, so positive speeds turn the robot counter-clockwise."""
    table = rows(driven.table, "comp-flc")
    for i, azimuth in enumerate(np.deg2rad([60, 135, 225, 300]), start=1):
        turns = driven.recorded.column(f"/world/comp-flc/robot/wheel_{i}", "Transform3D:quaternion")
        half = table[f"wheel_angle_{i}_rad"][:, None] / 2
        axis = -np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
        expected = np.concatenate([np.sin(half) * axis, np.cos(half)], axis=1)
        np.testing.assert_allclose([turn[0] for turn in turns], expected, atol=1e-6)


def test_the_robot_has_the_geometry_of_the_compiled_model(recorded: RecordingFile) -> None:
    model = mujoco.MjModel.from_xml_path(str(MODEL))
    for i in range(1, 5):
        sizes = recorded.static(f"/world/flc/robot/wheel_{i}/ellipsoids", "Ellipsoids3D:half_sizes")
        rollers = [g for g in range(model.ngeom) if model.geom(g).name.startswith(f"roller_{i}_")]
        assert len(sizes) == 16
        np.testing.assert_allclose(sizes, model.geom_size[rollers], rtol=1e-6)
    chassis = (model.geom_bodyid == model.body("chassis").id) & (
        model.geom_group < 3
    )  # without hulls
    for entity, name, kind in (
        ("cylinders", "Cylinders3D:radii", mujoco.mjtGeom.mjGEOM_CYLINDER),
        ("boxs", "Boxes3D:half_sizes", mujoco.mjtGeom.mjGEOM_BOX),
    ):
        shown = recorded.static(f"/world/flc/robot/chassis/{entity}", name)
        assert len(shown) == (chassis & (model.geom_type == kind)).sum()


def test_a_recording_is_valid_and_small_and_logs_static_data_once(
    recorded: RecordingFile,
) -> None:
    done = run_rrd_command("verify", recorded.path)
    assert done.returncode == 0, done.stderr
    assert recorded.path.stat().st_size < 4e6
    for entity in recorded.entities(static=True) - {"/__properties"}:
        assert len(recorded.batches(entity, static=True)) == 1, entity


class Stands(Controller):
    """Controller whose position errors are those of the reference."""

    def command(self, frame: int, observation: Observation) -> NDArray:
        return np.zeros((len(observation.pose), 3))


def test_plots_of_errors_show_two_labels_of_their_axes(tmp_path: Path) -> None:
    """The viewer labels powers of ten that are 20 pixels apart: a ninth of these plots' height."""
    route = "reference.waypoints=[[0, 0], [0.097, -0.098, 0.17]]"
    recorded = record_run(tmp_path / "recording.rrd", [Stands], route).recorded
    axis_ranges = recorded.axis_ranges()
    for plot in ("distance", "x", "y", "heading"):
        values = recorded.values(f"/plots/error/{plot}/Stands")
        limits = np.nanmin(values), np.nanmax(values)
        low, high = axis_ranges.get(f"plots/error/{plot}", limits)
        assert low <= np.nanmin(values) < np.nanmax(values) <= high
        step = 10 ** np.ceil(np.log10((high - low) / 9))
        assert np.floor(high / step) - np.ceil(low / step) >= 1, plot


def test_equal_runs_are_recorded_equally_and_different_ones_are_not(tmp_path: Path) -> None:
    a, b, c = (
        record_run(tmp_path / f"{i}.rrd", ["flc"], SHORT, seed=i // 2).recorded for i in range(3)
    )
    for entity in (entity for entity in a.entities() if entity.startswith("/plots/")):
        np.testing.assert_array_equal(a.values(entity), b.values(entity), entity)
    for entity in ("/world/flc/robot", "/world/flc/vision"):
        assert np.array_equal(recorded_poses(a, entity), recorded_poses(b, entity))
        assert not np.array_equal(recorded_poses(a, entity), recorded_poses(c, entity))


def test_the_first_seed_is_recorded_without_wheels_if_the_plant_has_none(tmp_path: Path) -> None:
    driven = record_run(tmp_path / "recording.rrd", ["flc"], SHORT, seed=3, seeds=2)
    plots = {entity.split("/")[2] for entity in driven.recorded.entities() if "/plots/" in entity}
    assert plots == {"error", "velocity", "alpha", "saturation"}
    shown = recorded_poses(driven.recorded, "/world/flc/robot")
    for seed, equal in ((3, True), (4, False)):
        assert np.allclose(shown[:, 0], rows(driven.table, "flc", seed)["x_m"], atol=1e-6) == equal


def test_the_field_is_drawn_in_its_size(tmp_path: Path) -> None:
    """The halfway line, the goals at their line and the carpet with margins, for division A."""
    size = "world.field_length_m=12", "world.field_width_m=9", "world.field_margin_m=0.3"
    recorded = record_run(tmp_path / "recording.rrd", ["flc"], SHORT, *size).recorded
    (half_size,) = recorded.static("/world/field/carpet", "Boxes3D:half_sizes")
    np.testing.assert_allclose(half_size[:2], [6.3, 4.8], rtol=1e-6)
    lines = recorded.static("/world/field/lines", "LineStrips3D:strips")
    ends = np.array([line for line in lines if len(line) == 2])[..., :2]
    assert [[0.0, -4.5], [0.0, 4.5]] in ends.tolist()
    np.testing.assert_array_equal(np.abs(ends).max((0, 1)), [6.0, 4.5])
    goals = recorded.static("/world/field/goals", "Boxes3D:centers")
    assert np.abs(goals).min(0)[0] == pytest.approx(6.09)  # goals are 0.18 m deep


def test_all_robots_of_a_controllers_first_world_are_drawn(tmp_path: Path) -> None:
    """Each robot has its own pose, reference and color."""
    start_poses = "world.start_poses=[[0, 0, 0], [0.2, 1.0, 1.5707963267948966]]"
    driven = record_run(tmp_path / "recording.rrd", ["flc"], SHORT, start_poses, seeds=2)
    recorded = driven.recorded
    starts = recorded.static("/world/reference", "LineStrips3D:strips")
    assert [strip[0][:2] for strip in starts] == [[0, 0], pytest.approx([0.2, 1.0])]
    for slot in (0, 1):
        table = rows(driven.table, "flc", 0, slot)
        expected = np.column_stack([table[name] for name in ("x_m", "y_m", "heading_rad")])
        np.testing.assert_allclose(
            recorded_poses(recorded, f"/world/flc/{slot}/robot"), expected, atol=1e-6
        )
        assert f"/plots/error/x/flc/{slot}" in recorded.entities()
        expected = np.column_stack([table["ref_x_m"], table["ref_y_m"]])
        targets = np.array(recorded.column(f"/world/flc/{slot}/target", "Points3D:positions"))
        np.testing.assert_allclose(targets[:, 0, :2], expected, atol=1e-6)
    colors = [recorded.static(f"/world/flc/{slot}/path", "LineStrips3D:colors") for slot in (0, 1)]
    assert colors[0] != colors[1]


@pytest.mark.parametrize("controller", CONTROLLERS)
def test_series_have_names_in_their_controllers_color(
    recorded: RecordingFile, controller: str
) -> None:
    series = {
        e for e in recorded.entities() if e.startswith("/plots/") and controller in e.split("/")
    }
    assert series <= recorded.entities(static=True)
    for entity in series:
        names, by_wheel = (
            recorded.static(entity, "SeriesLines:names"),
            entity.split("/")[2] == "wheel",
        )
        assert len(names) == len(set(names)) == recorded.values(entity).shape[1]
        if not by_wheel:
            assert all(name.startswith(controller) for name in names)
            assert recorded.static(entity, "SeriesLines:colors")[-1] == COLORS[controller]


def measured_alpha(position: np.ndarray, velocity: np.ndarray) -> np.ndarray:
    """Return achieved / commanded displacement of 15 frames, if above 0.1 m/s for 24 frames."""
    result = np.full(len(position), np.nan)
    for k in range(24, len(position)):
        mean = velocity[k - 15 : k].mean()
        if (abs(velocity[k - 24 : k]) > 0.1).all() and abs(mean) > 0.1:
            result[k] = (position[k] - position[k - 15]) / (mean * 15 / 60)
    return result


def expected_series(t: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Return the series of one controller, from its rows of the table alone."""
    wheels, angle = range(1, 5), t["heading_rad"]
    forward = np.cos(angle) * t["applied_vx_m_s"] + np.sin(angle) * t["applied_vy_m_s"]
    left = np.cos(angle) * t["applied_vy_m_s"] - np.sin(angle) * t["applied_vx_m_s"]
    turn = 0.083 * t["applied_w_rad_s"]  # at the wheels, 83 mm from the centre
    rim = [-np.sin(a) * forward + np.cos(a) * left + turn for a in np.deg2rad([60, 135, 225, 300])]
    series = {
        "wheel/wheel_speed": [
            *(v / 0.0285 for v in rim),
            *(t[f"wheel_speed_{i}_rad_s"] for i in wheels),
        ],
        "wheel/voltage": [t[f"voltage_{i}_v"] for i in wheels],
        "wheel/current": [t[f"current_{i}_a"] for i in wheels],
        "wheel/slip": [t[f"slip_{i}_m_s"] for i in wheels],
        "wheel/winding": [t[f"winding_temperature_{i}_c"] for i in wheels],
        "battery": [t["battery_voltage_v"]],
        "error/distance": [100 * np.hypot(t["x_m"] - t["ref_x_m"], t["y_m"] - t["ref_y_m"])],
        "saturation/duty": [t["peak_duty"]],
        "saturation/current": [
            np.max([t[f"current_limited_fraction_{i}"] for i in wheels], axis=0)
        ],
    }
    for axis, column, speed, scale in (
        ("x", "x_m", "vx_m_s", 100),
        ("y", "y_m", "vy_m_s", 100),
        ("heading", "heading_rad", "w_rad_s", 180 / np.pi),
    ):
        series[f"error/{axis}"] = [scale * (t[column] - t[f"ref_{column}"])]
        achieved = 60 * np.diff(t[column], prepend=t[column][0])
        name = f"velocity/{'turn' if axis == 'heading' else axis}"
        series[name] = [t[f"command_{speed}"], t[f"applied_{speed}"], achieved]
        if axis != "heading":
            estimate = np.where(t[f"alpha_hat_{axis}"] == 1, np.nan, t[f"alpha_hat_{axis}"])
            no_sigma = np.full((2, len(estimate)), np.nan)
            series[f"alpha/{axis}"] = [
                measured_alpha(t[column], t[f"applied_{speed}"]),
                *no_sigma,
                estimate,
            ]
    return {name: np.column_stack(lines) for name, lines in series.items()}


@pytest.mark.parametrize("controller", CONTROLLERS)
def test_every_time_series_follows_from_the_table(driven: RecordedRun, controller: str) -> None:
    """Series without any number are left out."""
    recorded, expected = driven.recorded, expected_series(rows(driven.table, controller))
    known = {
        f"/plots/{name}/{controller}": v for name, v in expected.items() if not np.isnan(v).all()
    }
    measured = {
        f"/plots/saturation/{name}/{controller}" for name in ("sliding", "command")
    }  # tested with the metrics
    assert {
        e for e in recorded.entities() if e.startswith("/plots/") and controller in e.split("/")
    } == {
        *known,
        *measured,
    }
    for entity, values in known.items():
        # Scalars are float64. Sums in another order differ by about 1e-12 of the summands.
        begin = recorded.frames(entity)[0]
        assert np.isnan(values[:begin]).all()
        np.testing.assert_allclose(
            recorded.values(entity), values[begin:], rtol=1e-9, atol=1e-9, err_msg=entity
        )
