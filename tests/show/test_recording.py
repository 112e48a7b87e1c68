"""A recording holds what the table beside it holds, and the robots as they are."""

from pathlib import Path

import mujoco
import numpy as np
import pytest
from recorded import Driven, Recorded, driven_by, poses, rows, rrd

from omni_mj.scenarios import models
from omni_mj.worlds import field

CONTROLLERS = ("flc", "comp-flc")
SHORT = "reference.waypoints=[[0, 0], [0.3, 0.2]]"


@pytest.mark.parametrize("controller", CONTROLLERS)
@pytest.mark.parametrize(("entity", "prefix"), [("robot", ""), ("vision", "vision_"), ("predicted", "predicted_")])
def test_poses_are_those_of_the_table(driven: Driven, controller: str, entity: str, prefix: str) -> None:
    recorded, table = driven.recorded, rows(driven.table, controller)
    expected = np.column_stack([table[f"{prefix}{name}"] for name in ("x_m", "y_m", "heading_rad")])
    known = np.flatnonzero(~np.isnan(expected[:, 0]))
    assert sorted(recorded.frames(f"/world/{controller}/{entity}")) == known.tolist()
    # Transforms are float32: 6e-8 of a metre or radian or so.
    np.testing.assert_allclose(poses(recorded, f"/world/{controller}/{entity}"), expected[known], atol=1e-6)


def test_wheels_turn_by_the_angles_of_the_table(driven: Driven) -> None:
    table, azimuths = rows(driven.table, "comp-flc"), np.deg2rad([60, 135, 225, 300])
    for i, azimuth in enumerate(azimuths):
        rows_ = driven.recorded.column(f"/world/comp-flc/robot/wheel_{i + 1}", "Transform3D:quaternion")
        quaternion = np.array([row[0] for row in rows_])
        angle = table[f"wheel_angle_{i + 1}_rad"]
        # Axles point to the robot's centre, so that positive speeds drive it counter-clockwise.
        axis = -np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
        turned = np.column_stack([np.sin(angle / 2)[:, None] * axis, np.cos(angle / 2)])
        np.testing.assert_allclose(quaternion, turned, atol=1e-6)


def test_the_path_leads_from_pose_to_pose(driven: Driven) -> None:
    table = rows(driven.table, "flc")
    position = np.column_stack([table["x_m"], table["y_m"]])
    segments = np.array([row[0] for row in driven.recorded.column("/world/flc/path", "LineStrips3D:strips")])
    np.testing.assert_allclose(segments[:, 1, :2], position, atol=1e-6)
    np.testing.assert_allclose(segments[1:, 0], segments[:-1, 1], atol=0)


def test_the_robot_is_the_compiled_models_own_geometry(recorded: Recorded) -> None:
    model = mujoco.MjModel.from_xml_path(str(models.robot_path()))
    for i in range(1, 5):
        entity = f"/world/flc/robot/wheel_{i}/ellipsoids"
        sizes = np.array(recorded.static(entity, "Ellipsoids3D:half_sizes"))
        ids = [g for g in range(model.ngeom) if model.geom(g).name.startswith(f"roller_{i}_")]
        assert len(sizes) == len(ids) == 16
        np.testing.assert_allclose(sizes, model.geom_size[ids], rtol=1e-6)
        hub = recorded.static(f"/world/flc/robot/wheel_{i}/cylinders", "Cylinders3D:radii")
        assert hub == pytest.approx(model.geom(f"hub_{i}").size[:1])
    hull_group = 3
    own = model.geom_bodyid == model.body("chassis").id
    chassis = np.flatnonzero(own & (model.geom_group < hull_group))
    kinds = [
        ("cylinders", "Cylinders3D:radii", mujoco.mjtGeom.mjGEOM_CYLINDER),
        ("boxs", "Boxes3D:half_sizes", mujoco.mjtGeom.mjGEOM_BOX),
    ]
    for entity, name, kind in kinds:
        shown = recorded.static(f"/world/flc/robot/chassis/{entity}", name)
        assert len(shown) == sum(model.geom_type[g] == kind for g in chassis)


def test_static_geometry_is_logged_once(recorded: Recorded) -> None:
    for entity in recorded.entities(static=True) - {"/summary", "/__properties"}:
        assert len(recorded.batches(entity, static=True)) == 1, entity


def test_the_field_is_that_of_the_rules(recorded: Recorded) -> None:
    """Division B: 9 x 6 m to the outer edges of lines 10 mm wide, a centre circle of 1 m."""
    strips = recorded.static("/world/field/lines", "LineStrips3D:strips")
    points = np.concatenate([np.array(strip) for strip in strips])
    assert recorded.static("/world/field/lines", "LineStrips3D:radii") == pytest.approx([0.005])
    assert np.abs(points).max(0) == pytest.approx([4.495, 2.995, 0.0])  # their middles
    circle = max(strips, key=len)
    assert np.hypot(*np.array(circle).T[:2]) + 0.005 == pytest.approx(np.full(len(circle), 0.5))
    centres, half = field.goal_walls()
    assert np.ptp((centres + half)[:, 0]) > 9  # one goal behind each line
    inside = np.abs(centres) - half
    assert inside[:, 0].min() == pytest.approx(4.5)  # walls touch the line, and leave 1 m between them
    assert inside[np.abs(centres[:, 1]) > 0.1, 1] == pytest.approx(np.full(4, 0.5))


def test_it_opens_paused_at_its_start_with_its_layout(recorded: Recorded) -> None:
    (store,) = recorded.reader.blueprints()
    chunks = recorded.reader.stream(store=store).to_chunks()
    panel = [c.to_record_batch() for c in chunks if c.entity_path == "/time_panel" and c.is_static]
    paused = 1
    assert [b["TimePanelBlueprint:play_state"].to_pylist() for b in panel] == [[[paused]]]
    (names,) = recorded.layouts()
    assert {"plan", "summary", "events", "settings", "tracking error in x, cm", "winding temperature, deg C"} <= names


def test_summary_settings_and_events_are_in_it(recorded: Recorded) -> None:
    *_, last = recorded.batches("/summary", static=True)
    summary = last["TextDocument:text"].to_pylist()[0][0]
    assert "| comp-flc |" in summary
    settings = recorded.static("/settings", "TextDocument:text")[0]
    assert "| delay_frames | 6 | frames |" in settings
    assert "**((0.0, 0.0, 0.0), (0.5" in settings  # the scenario's own way-points
    texts = [row[0] for row in recorded.column("/events/comp-flc", "TextLog:text")]
    assert [text for text in texts if "way-point" in text][-1].endswith("comp-flc: way-point 4 of 4 reached")


def test_it_passes_reruns_verification_and_is_small(recorded: Recorded) -> None:
    done = rrd("verify", recorded.path)
    assert done.returncode == 0, done.stderr
    assert recorded.path.stat().st_size < 4e6


def test_equal_runs_compare_equal_and_different_ones_do_not(tmp_path: Path) -> None:
    for name, seed in (("a", 0), ("b", 0), ("c", 1)):
        driven_by(tmp_path / f"{name}.rrd", ["flc"], SHORT, seed=seed)
    a, b, c = (tmp_path / f"{name}.rrd" for name in "abc")
    assert rrd("compare", a, b).returncode == 0
    assert rrd("compare", a, c).returncode != 0


def test_the_first_seed_is_recorded_and_no_wheels_where_there_are_none(tmp_path: Path) -> None:
    driven = driven_by(tmp_path / "recording.rrd", ["flc"], SHORT, seed=3, seeds=2)
    assert {entity.split("/")[2] for entity in driven.recorded.entities() if "/plots/" in entity} == {
        "error", "velocity", "alpha", "ahead", "why",
    }  # fmt: skip
    shown = poses(driven.recorded, "/world/flc/robot")
    for seed, equal in ((3, True), (4, False)):
        assert np.allclose(shown[:, 0], rows(driven.table, "flc", seed)["x_m"], atol=1e-6) == equal


def test_all_robots_of_a_controllers_first_world_are_drawn(tmp_path: Path) -> None:
    """Each where it is, along its own reference, in a colour of its own."""
    places = "world.places=[[0, 0, 0], [0.2, 1.0, 1.5707963267948966]]"
    driven = driven_by(tmp_path / "recording.rrd", ["flc"], SHORT, places, seeds=2)
    starts = driven.recorded.static("/world/reference/path", "LineStrips3D:strips")
    assert [strip[0][:2] for strip in starts] == [[0, 0], pytest.approx([0.2, 1.0])]
    for place in (0, 1):
        table = rows(driven.table, "flc", 0, place)
        expected = np.column_stack([table[name] for name in ("x_m", "y_m", "heading_rad")])
        np.testing.assert_allclose(poses(driven.recorded, f"/world/flc/{place}/robot"), expected, atol=1e-6)
        assert f"/plots/error/x/flc/{place}" in driven.recorded.entities()
        targets = np.array(driven.recorded.column("/world/reference/target", "Points3D:positions"))[:, place, :2]
        np.testing.assert_allclose(targets, np.column_stack([table["ref_x_m"], table["ref_y_m"]]), atol=1e-6)
    colours = [driven.recorded.static(f"/world/flc/{place}/path", "LineStrips3D:colors") for place in (0, 1)]
    assert colours[0] != colours[1]
