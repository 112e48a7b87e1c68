"""Films of runs: MuJoCo draws a panel for each controller with its name and position error."""

from collections.abc import Iterable, Iterator, Sequence
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pyarrow.compute as pc
from PIL import Image, ImageDraw, ImageFont

from omni_control.errors import OmniError
from omni_control.kinematics import Array
from omni_mj.config import PERIOD_S
from omni_mj.config.resolve import resolve_settings
from omni_mj.config.settings import Settings
from omni_mj.io import parquet
from omni_mj.io.atomic_files import open_atomic
from omni_mj.mjcf import mujoco, world_builder
from omni_mj.mjcf.field import ROBOT_HEIGHT_M, ROBOT_RADIUS_M
from omni_mj.results.summary import read_summary
from omni_mj.viz import style
from omni_mj.viz.recording.robot_shapes import cover_materials, points_above

SUFFIXES = (".gif", ".webp")
GAP_PIXELS = 4  # between panels
MAX_SEGMENTS = 300  # of a path
ELEVATION_DEG = {"follow": -38.0, "plan": -90.0}  # view -> elevation of the camera's direction
FOLLOW_DISTANCE_M = 0.85  # of the camera from the robot that it follows
REFERENCE_RGBA, ROUTE_RGBA = (1.0, 1.0, 1.0, 1.0), (1.0, 1.0, 1.0, 0.6)
LINE_WIDTH = 0.007  # of lines, as a fraction of the camera's distance
# Brightness of the light at the camera, which adds to the scene's light. Brighter light would
# overexpose covers in the view from above.
HEADLIGHT = 0.1
MAX_GEOMS = 20_000  # a robot with complete wheels has about 200
MARGIN_M = 0.35  # of the plan view around the route, for the robots on it


class FilmTrack(NamedTuple):
    """Trajectories of one controller's robots in the first seed.

    Attributes:
        controller: Name of the controller.
        color: Color of the controller in figures and recordings.
        poses: True poses, (frames, robots, 3) m, m, rad.
        references: Reference poses, (frames, robots, 3) m, m, rad.
        wheel_angles: Angles of the wheels, (frames, robots, wheels) rad.
    """

    controller: str
    color: str
    poses: Array
    references: Array
    wheel_angles: Array


def load_tracks(folder: Path, controllers: Sequence[str]) -> tuple[Settings, list[FilmTrack]]:
    """Return the settings of a run's robots, and a track for each controller.

    Args:
        folder: Folder of the run.
        controllers: Names of controllers; empty: all.

    Raises:
        OmniError: The folder has no run, no trajectory, or no such controller.
    """
    entry = next(iter(read_summary(folder)["scenarios"].values()))
    sections = ("model", "body", "wheels")
    settings = resolve_settings({name: entry["settings"][name] for name in sections})
    columns = ["x_m", "y_m", "heading_rad", "ref_x_m", "ref_y_m", "ref_heading_rad"]
    for i in range(len(settings.wheels.azimuths_deg)):
        columns.append(f"wheel_angle_{i + 1}_rad")
    keys = ["controller", "seed", "slot"]
    trajectory = parquet.read_table(folder / "trajectory.parquet", keys + columns)
    known = trajectory["controller"].unique().to_pylist()
    if unknown := [name for name in controllers if name not in known]:
        raise OmniError(f"{folder} has no controller {unknown[0]!r}; it has {', '.join(known)}")
    indices = style.style_indices(known)
    is_first_seed = pc.field("seed") == pc.min(trajectory["seed"])
    tracks = []
    for name in controllers or known:
        rows = trajectory.filter((pc.field("controller") == name) & is_first_seed)
        values = np.nan_to_num(np.column_stack([rows[column].to_numpy() for column in columns]))
        robots = np.split(values, 1 + np.flatnonzero(np.diff(rows["slot"].to_numpy())))
        n_frames = max(map(len, robots))
        # A robot that failed has fewer frames; it keeps its last pose.
        robots = [np.pad(robot, [(0, n_frames - len(robot)), (0, 0)], "edge") for robot in robots]
        poses, references, wheel_angles = np.split(np.stack(robots, axis=1), (3, 6), axis=2)
        color = style.color(indices[name])
        tracks.append(FilmTrack(name, color, poses, references, wheel_angles))
    return settings, tracks


class FilmRenderer:
    """A world with a camera that draws tracks in panels side by side.

    Args:
        settings: Settings of the robots.
        tracks: Tracks from left to right.
        view: Name of a view in `ELEVATION_DEG`.
        size: Width and height of a picture, pixels.

    Raises:
        OmniError: MuJoCo cannot draw on this computer.
    """

    def __init__(
        self, settings: Settings, tracks: Sequence[FilmTrack], view: str, size: tuple[int, int]
    ) -> None:
        self._tracks = tracks
        self._size = size
        n_robots = tracks[0].poses.shape[1]
        width, height = size[0] // len(tracks) - GAP_PIXELS, size[1]
        settings = settings.replace(wheels={"model": "rollers"})
        self._world = world_builder.build_world(settings, n_robots, with_hulls=False)
        self._data = mujoco.MjData(self._world.model)
        visual = self._world.model.vis
        visual.global_.offwidth, visual.global_.offheight = width, height
        # A software renderer's time grows with the facets of about 80 rollers.
        quality = visual.quality
        quality.numslices, quality.numstacks, quality.shadowsize = 20, 8, 1024
        visual.headlight.diffuse[:] = HEADLIGHT
        try:
            self._renderer = mujoco.Renderer(self._world.model, height, width, MAX_GEOMS)
        except Exception as error:  # the type depends on the platform's GL
            reason = error or type(error).__name__
            raise OmniError(
                f"MuJoCo cannot draw here: {reason}; without a display it needs EGL, on Debian "
                "libegl1 and libgl1-mesa-dri"
            ) from None
        self._follows_robot = view == "follow" and n_robots == 1
        self._camera = self._create_camera(view, height / width)
        self._line_width_m = LINE_WIDTH * self._camera.distance

    def render(self, times: Array) -> Iterator[Image.Image]:
        """Yield a picture for each of the times, s."""
        for time in times:
            picture = Image.new("RGB", self._size, "white")
            for i, track in enumerate(self._tracks):
                x = i * self._size[0] // len(self._tracks)
                picture.paste(self._draw_panel(track, time), (x, 0))
            yield picture

    def _create_camera(self, view: str, aspect_ratio: float) -> mujoco.MjvCamera:
        """Return a camera whose picture contains the whole route, or one near the robot."""
        poses = [track.references.reshape(-1, 3) for track in self._tracks]
        route = np.concatenate(poses)[:, :2]
        low, high = route.min(0) - MARGIN_M, route.max(0) + MARGIN_M
        camera = mujoco.MjvCamera()
        camera.azimuth, camera.elevation = 90.0, ELEVATION_DEG[view]
        camera.lookat[:] = *(low + high) / 2, 0.05
        if self._follows_robot:
            camera.distance = FOLLOW_DISTANCE_M
        else:
            visible_height_m = max(high[1] - low[1], (high[0] - low[0]) * aspect_ratio)
            half_angle = np.deg2rad(self._world.model.vis.global_.fovy / 2)
            camera.distance = visible_height_m / 2 / np.tan(half_angle)
        return camera

    def _draw_panel(self, track: FilmTrack, time: float) -> Image.Image:
        """Return the picture of one track with the controller's name, its error and the time."""
        frame = min(round(time / PERIOD_S), len(track.poses) - 1)
        error = (track.poses - track.references)[: frame + 1, :, :2]
        errors_cm = 100 * np.linalg.norm(error, axis=-1).max(-1)
        self._set_scene(track, frame)
        panel = Image.fromarray(self._renderer.render())
        pen, inset = ImageDraw.Draw(panel), panel.height // 40
        large, small = (ImageFont.load_default(max(9, panel.height // n)) for n in (18, 26))
        name, bottom = track.controller, panel.height - inset
        pen.text((inset, inset), name, "white", large, stroke_width=2, stroke_fill=track.color)
        text = f"position error {errors_cm[-1]:.1f} cm, maximum {errors_cm.max():.1f} cm"
        pen.text((inset, bottom), text, "white", small, "ls", stroke_width=2, stroke_fill="black")
        pen.text((panel.width - inset, inset), f"{time:.1f} s", "white", small, anchor="ra")
        return panel

    def _set_scene(self, track: FilmTrack, frame: int) -> None:
        """Move robots and camera to their poses in a frame, and add the lines of paths."""
        data, model, references = self._data, self._world.model, track.references[frame]
        color = np.array(style.rgb(track.color)) / 255
        data.qpos[:] = self._world.rest_qpos
        for slot, robot in enumerate(self._world.robots):
            x, y, heading = track.poses[frame, slot]
            data.qpos[robot.qpos[:2]] = x, y
            data.qpos[robot.qpos[3:7]] = np.cos(heading / 2), 0.0, 0.0, np.sin(heading / 2)
            data.qpos[robot.wheel_qpos] = track.wheel_angles[frame, slot]
        model.mat_rgba[cover_materials(model), :3] = color
        mujoco.mj_fwdPosition(model, data)
        if self._follows_robot:
            self._camera.lookat[:2] = (track.poses[frame, 0, :2] + references[0, :2]) / 2
        self._renderer.update_scene(data, self._camera)
        for slot, (x, y, heading) in enumerate(references):
            self._add_line(track.references[:, slot, :2], ROUTE_RGBA)
            self._add_line(track.poses[: frame + 1, slot, :2], (*color, 1.0))
            # The reference is a ring above the robot with a line that shows its heading.
            angles = heading + np.linspace(0, 2 * np.pi, 25)
            ring = [x, y] + ROBOT_RADIUS_M * np.column_stack([np.cos(angles), np.sin(angles)])
            self._add_line(np.vstack([[x, y], ring]), REFERENCE_RGBA, ROBOT_HEIGHT_M)

    def _add_line(self, points: Array, rgba: tuple[float, ...], height: float = 0.0) -> None:
        """Add a line through points (n, 2) at a height in m to the scene."""
        points = points[:: 1 + len(points) // MAX_SEGMENTS]
        scene, capsule, zero = self._renderer.scene, mujoco.mjtGeom.mjGEOM_CAPSULE, np.zeros(3)
        for start, end in pairwise(points_above(points, height)):
            geom, color = scene.geoms[scene.ngeom], np.array(rgba, np.float32)
            mujoco.mjv_initGeom(geom, capsule, zero, zero, np.eye(3).ravel(), color)
            mujoco.mjv_connector(geom, capsule, self._line_width_m / 2, start, end)
            scene.ngeom += 1


def write_film(pictures: Iterable[Image.Image], out: Path, rate: float) -> None:
    """Write pictures of equal size to a file.

    Args:
        pictures: At least one picture.
        out: File with one of `SUFFIXES`.
        rate: Pictures per second.

    Raises:
        OSError: The file cannot be written.
    """
    with open_atomic(out) as file:
        first_picture, *other_pictures = pictures
        first_picture.save(
            file,
            out.suffix[1:],
            save_all=True,
            append_images=other_pictures,
            loop=0,
            duration=round(1000 / rate),
        )
