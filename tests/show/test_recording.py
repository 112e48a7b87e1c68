"""A recording holds what the table beside it holds, named and laid out, whatever ended the run."""

import os
import signal
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np
import pyarrow as pa
import pytest
from numpy.typing import NDArray
from recorded import Recorded, record, rows, rrd

from omni_control.controllers.base import Controller, Seen
from omni_mj.measure.metrics import ALPHA_START_FRAMES, ALPHA_WINDOW_FRAMES
from omni_mj.scenarios import models, scenario
from omni_mj.show import style
from omni_mj.show.recording import FileRecording
from omni_mj.simulate.simulation import Simulation
from omni_mj.worlds import field

CONTROLLERS = ("flc", "comp-flc")
WAY = "reference.waypoints=[[0, 0], [0.5, 0], [0.5, 0.3, 0.4], [0, 0.3], [0, 0]]"
BELOW = "/ratio", "/sigma"  # entities below a controller's
SHORT = "reference.waypoints=[[0, 0], [0.3, 0.2]]"


@dataclass(frozen=True)
class Driven:
    """A run: its log as a table, and its recording read back."""

    table: pa.Table
    recorded: Recorded


class Own(Controller):
    """Records what it does to the error, from frame 50 on how often it was asked; and says that it believes in 0.9."""

    def command(self, frame: int, seen: Seen) -> NDArray:
        self.alpha_hat, self.channels["alpha_sigma"] = (
            np.full((len(seen.pose), 3), 0.9),
            np.full((len(seen.pose), 3), 0.05),
        )
        target, speed = self.reference.at(frame, seen.pose)
        pull = 3.0 * (target - seen.pose)
        self.channels["pull"] = pull[:, :2]
        if frame >= 50:
            self.channels["asked"] = np.full(len(pull), float(frame))
        return speed + pull


class Breaks(Own):
    """Fails in frame 70."""

    def command(self, frame: int, seen: Seen) -> NDArray:
        return super().command(frame, seen) if frame < 70 else np.full((len(seen.pose), 3), np.nan)


def driven_by(path: Path, controllers: list[str | type[Controller]], *overrides: str, **head: object) -> Driven:
    chosen = scenario.load("rect", list(overrides), {"plant": "kinematic", **head})
    simulation = Simulation(chosen, controllers)
    recorded = record(simulation, path)
    return Driven(simulation.log.table(), recorded)


@pytest.fixture(scope="module")
def driven(tmp_path_factory: pytest.TempPathFactory) -> Driven:
    """A small rectangle with a turn in it, on real wheels."""
    path = tmp_path_factory.mktemp("run") / "recording.rrd"
    return driven_by(path, list(CONTROLLERS), WAY, "wheels.model=two-rollers", plant="mujoco")


@pytest.fixture(scope="module")
def recorded(driven: Driven) -> Recorded:
    return driven.recorded


@pytest.fixture(scope="module")
def own(tmp_path_factory: pytest.TempPathFactory) -> Driven:
    """Controllers with channels of their own, of which one fails."""
    return driven_by(tmp_path_factory.mktemp("own") / "recording.rrd", ["flc", Own, Breaks], SHORT)


def poses(recorded: Recorded, entity: str) -> NDArray:
    """Transforms as [x, y, heading] (frames, 3)."""
    at = np.array([row[0] for row in recorded.column(entity, "Transform3D:translation")])
    quaternion = np.array([row[0] for row in recorded.column(entity, "Transform3D:quaternion")])
    assert not quaternion[:, :2].any()  # about z
    return np.column_stack([at[:, :2], 2 * np.arctan2(quaternion[:, 2], quaternion[:, 3])])


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


def test_channels_of_a_controllers_own_are_recorded_from_when_it_has_them(own: Driven) -> None:
    found = {entity for entity in own.recorded.entities() if entity.startswith("/plots/own/")}
    assert found == {
        f"/plots/own/{channel}/{name}" for channel in ("pull", "asked", "alpha_sigma") for name in ("Own", "Breaks")
    }
    table = rows(own.table, "Own")
    pull = np.column_stack([table["own_pull_1"], table["own_pull_2"]])
    np.testing.assert_array_equal(own.recorded.values("/plots/own/pull/Own"), pull)
    asked = own.recorded.values("/plots/own/asked/Own")[:, 0]
    np.testing.assert_array_equal(asked[-3:], table["own_asked"][-3:])
    assert np.isnan(asked[:50]).all()
    np.testing.assert_allclose(
        own.recorded.values("/plots/alpha/x/Own/sigma"), np.broadcast_to([0.8, 1.0], (len(asked), 2))
    )
    assert own.recorded.static("/plots/own/pull/Own", "SeriesLines:names") == ["Own 1 (60 Hz)", "Own 2 (60 Hz)"]
    layouts = own.recorded.layouts()
    assert all({"own", "pull"} <= names for names in layouts)
    assert ["asked" in names for names in layouts].count(True) == 1


def test_a_robot_that_failed_is_recorded_up_to_there_and_says_why(own: Driven) -> None:
    assert sorted(own.recorded.frames("/world/Breaks/robot")) == list(range(70))
    assert len(own.recorded.frames("/world/Own/robot")) > 100
    said = [row[0] for row in own.recorded.column("/events/Breaks", "TextLog:text")]
    assert next(text for text in said if "stopped" in text).startswith("1.17 s  Breaks: stopped: ")
    assert len(said) == len(set(said))


@pytest.mark.parametrize("before", [0, 40, 400])
def test_a_simulation_that_is_reset_is_recorded_from_its_start(tmp_path: Path, before: int) -> None:
    """However much of what was before has been sent: nothing, or a block, what is read back is the last run alone."""
    simulation = Simulation(scenario.load("rect", ["reference.laps=2"], {"plant": "kinematic"}), ["flc"])
    with FileRecording(tmp_path / "reset.rrd", simulation) as recording:
        for _ in range(before):
            simulation.step()
            recording.update()
        simulation.reset(seed=5)
        for _ in range(350):
            simulation.step()
            recording.update()
        recording.write()
    recorded = Recorded(tmp_path / "reset.rrd")
    assert sorted(recorded.frames("/world/flc/robot")) == list(range(350))
    table = rows(simulation.log.table(), "flc", 5)
    np.testing.assert_allclose(poses(recorded, "/world/flc/robot")[:, 0], table["x_m"], atol=1e-6)
    assert "seed 5" in recorded.static("/settings", "TextDocument:text")[0]


def test_a_block_is_made_of_its_own_frames(tmp_path: Path) -> None:
    """So that it costs the same however long the run: the same is recorded where all frames before were wiped out.

    But for the last, from which the path goes on, and those of the window of alpha's ratio.
    """
    chosen = scenario.load("rect-noise", ["reference.laps=2", "reference.settle_s=0.1"], {"plant": "kinematic"})

    def record_run(path: Path, wiped: bool) -> int:
        simulation = Simulation(chosen, ["flc", "comp-flc"])
        log = simulation.log
        with FileRecording(path, simulation) as recording:

            def after_frame(frame: int) -> None:
                recording.update()
                if wiped and recording._sent == log.length:
                    for channel in log.columns:
                        log.channel(channel)[: log.length - 1 - ALPHA_WINDOW_FRAMES - ALPHA_START_FRAMES] = 0

            simulation.run(after_frame)
            recording.write()
        return log.length

    lengths = [record_run(tmp_path / f"{wiped}.rrd", wiped) for wiped in (False, True)]
    assert min(lengths) > 4 * 300, "blocks of 300 frames"
    assert rrd("compare", tmp_path / "False.rrd", tmp_path / "True.rrd").returncode == 0


def test_a_killed_run_leaves_its_blocks(tmp_path: Path) -> None:
    """Killed while it writes, of every entity the same whole blocks of 300 frames are there, but for the last one."""
    options = ["--scenario", "rect", "--plant", "kinematic", "--set", "reference.laps=100", "--out", tmp_path]
    process = subprocess.Popen([sys.executable, "-m", "omni_mj.run", "--no-figures", "--quiet", *options])
    path, deadline = tmp_path / "recording.rrd", time.monotonic() + 60
    while not (path.exists() and path.stat().st_size > 2e6) and time.monotonic() < deadline:
        time.sleep(0.02)
    os.kill(process.pid, signal.SIGKILL)
    process.wait()
    with pytest.warns(match="no footer"):
        recorded = Recorded(path)
    series = [e for e in recorded.entities() if "/plots/" in e or e.endswith("/robot")]
    lengths = {entity: len(recorded.frames(entity)) for entity in series}
    assert len(series) == 2 * 15 + 2
    assert min(lengths.values()) >= 600
    assert max(lengths.values()) - min(lengths.values()) <= 300
    for entity in series:
        assert sorted(recorded.frames(entity)) == list(range(lengths[entity]))
    assert "| laps | **100** |" in recorded.static("/settings", "TextDocument:text")[0]
    assert "has not ended" in recorded.static("/summary", "TextDocument:text")[0]
