"""Films of runs: a panel for each controller, drawn by MuJoCo, with its name and its error."""

from collections.abc import Iterable, Iterator, Sequence
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import mujoco
import numpy as np
import pyarrow.compute as pc
from PIL import Image, ImageDraw, ImageFont

from omni_control.errors import OmniError
from omni_control.kinematics import Array
from omni_mj import parquet
from omni_mj.config.settings import PERIOD_S, Settings
from omni_mj.files import open_atomic
from omni_mj.mjcf import world_builder
from omni_mj.results.summary import read_summary as read_summary
from omni_mj.viz import style
from omni_mj.viz.recording.robot_shapes import cover_materials
from omni_mj.viz.recording.scene import HEIGHT_M, RADIUS_M

SUFFIXES = (".gif", ".webp")
NEEDS = "MuJoCo cannot draw here: {reason}; without a display it needs EGL, on Debian libegl1 and libgl1-mesa-dri"
GAP = 4  # pixels between panels
PIECES = 300  # of a path at most
ELEVATION_DEG = {"follow": -38.0, "plan": -90.0}  # of each view's direction
NEAR_M = 0.85  # from the robot that is followed
REFERENCE, ROUTE = (1.0, 1.0, 1.0, 1.0), (1.0, 1.0, 1.0, 0.6)
LINE_SHARE = 0.007  # thickness of lines, as a share of the distance from which they are seen
# Next to the scene's own light; more, and seen from above a robot's colour is burnt out
HEADLIGHT = 0.1
MAX_GEOMS = 20_000  # a robot with whole wheels has some 200
MARGIN_M = 0.35  # around the route, for the robots on it


class Trajectories(NamedTuple):
    """What one controller did with the first seed.

    Args:
        controller: Its name.
        colour: As in figures and recordings.
        poses: Poses of its robots, (frames, places, 3) m, m, rad.
        references: Poses in which they should be, as `poses`.
        wheels: Angles of their wheels, (frames, places, wheels) rad.
    """

    controller: str
    colour: str
    poses: Array
    references: Array
    wheels: Array


def load_trajectories(
    folder: Path, controllers: Sequence[str] = ()
) -> tuple[Settings, list[Trajectories]]:
    """Return the settings of a run's robots, and what its controllers did with its first seed.

    Args:
        folder: Folder of the run.
        controllers: Names of controllers. [all]

    Raises:
        OmniError: The folder holds no run, no trajectory, or no such controller.
    """
    entry = next(iter(read_summary(folder)["scenarios"].values()))
    settings = Settings(
        **{section: entry["settings"][section] for section in ("model", "body", "wheels")}
    )
    pose = ["x_m", "y_m", "heading_rad"]
    angles = [f"wheel_angle_{i + 1}_rad" for i in range(len(settings.wheels.azimuths_deg))]
    numbers = [*pose, *(f"ref_{name}" for name in pose), *angles]
    table = parquet.read_table(
        folder / "trajectory.parquet", ["controller", "seed", "slot", *numbers]
    )
    known = table["controller"].unique().to_pylist()
    if unknown := [name for name in controllers if name not in known]:
        raise OmniError(f"{folder} has no controller {unknown[0]!r}; it has {', '.join(known)}")
    first = pc.min(table["seed"])
    slots, takes = style.style_indices(known), []
    for name in controllers or known:
        part = table.filter((pc.field("controller") == name) & (pc.field("seed") == first))
        values = np.nan_to_num(np.column_stack([part[column].to_numpy() for column in numbers]))
        robots = np.split(values, np.flatnonzero(np.diff(part["slot"].to_numpy())) + 1)
        longest = max(map(len, robots))
        # Robots that failed have no frames after that, and stay where they are.
        robots = [np.pad(robot, [(0, longest - len(robot)), (0, 0)], "edge") for robot in robots]
        takes.append(
            Trajectories(
                name, style.colour(slots[name]), *np.split(np.stack(robots, axis=1), (3, 6), axis=2)
            )
        )
    return settings, takes


class FilmRenderer:
    """The robots of one world and a camera, which draws panels side by side.

    Args:
        settings: Settings of the robots.
        takes: What is shown.
        view: Name of one of `ELEVATION_DEG`.
        size: Width and height of a picture, pixels.

    Raises:
        OmniError: MuJoCo finds nothing to draw with.
    """

    def __init__(
        self, settings: Settings, takes: Sequence[Trajectories], view: str, size: tuple[int, int]
    ) -> None:
        self._takes, self._size, places = takes, size, takes[0].poses.shape[1]
        width, height = size[0] // len(takes) - GAP, size[1]
        self._world = world_builder.build_world(
            settings.replace(wheels={"model": "rollers"}), places, with_hulls=False
        )
        self._data, visual = mujoco.MjData(self._world.model), self._world.model.vis
        visual.global_.offwidth, visual.global_.offheight = width, height
        # Of a software renderer: time goes with the facets of some 80 rollers
        quality = visual.quality
        quality.numslices, quality.numstacks, quality.shadowsize = 20, 8, 1024
        visual.headlight.diffuse[:] = HEADLIGHT
        try:
            self._renderer = mujoco.Renderer(self._world.model, height, width, MAX_GEOMS)
        except Exception as error:  # whatever the platform's GL raises
            raise OmniError(NEEDS.format(reason=error or type(error).__name__)) from None
        route = np.concatenate([take.references[..., :2].reshape(-1, 2) for take in takes])
        low, high = route.min(0) - MARGIN_M, route.max(0) + MARGIN_M
        self._camera = camera = mujoco.MjvCamera()
        camera.azimuth, camera.elevation, camera.lookat[:] = (
            90.0,
            ELEVATION_DEG[view],
            (*(low + high) / 2, 0.05),
        )
        # The whole route is in sight from where its height and, less by the picture's shape, its
        # width are.
        size_m = max(high[1] - low[1], (high[0] - low[0]) * height / width)
        self._follows = view == "follow" and places == 1
        camera.distance = (
            NEAR_M if self._follows else size_m / 2 / np.tan(np.deg2rad(visual.global_.fovy / 2))
        )
        self._thickness = LINE_SHARE * camera.distance

    def render(self, instants: Array) -> Iterator[Image.Image]:
        """Yield a picture for each of the instants, s."""
        for instant in instants:
            picture = Image.new("RGB", self._size, "white")
            for i, take in enumerate(self._takes):
                picture.paste(
                    self._panel(take, instant), (i * self._size[0] // len(self._takes), 0)
                )
            yield picture

    def _panel(self, take: Trajectories, instant: float) -> Image.Image:
        frame = min(round(instant / PERIOD_S), len(take.poses) - 1)
        errors = 100 * np.linalg.norm(
            (take.poses - take.references)[: frame + 1, :, :2], axis=-1
        ).max(-1)
        self._set(take, frame)
        panel = Image.fromarray(self._renderer.render())
        pen, inset = ImageDraw.Draw(panel), panel.height // 40
        large, small = (ImageFont.load_default(max(9, panel.height // n)) for n in (18, 26))
        text = f"{errors[-1]:.1f} cm off, {errors.max():.1f} at most"
        pen.text(
            (inset, inset), take.controller, "white", large, stroke_width=2, stroke_fill=take.colour
        )
        pen.text(
            (inset, panel.height - inset),
            text,
            "white",
            small,
            "ls",
            stroke_width=2,
            stroke_fill="#00000080",
        )
        pen.text((panel.width - inset, inset), f"{instant:.1f} s", "white", small, "ra")
        return panel

    def _set(self, take: Trajectories, frame: int) -> None:
        """Put robots and lines where they are in a frame."""
        data, model, references = self._data, self._world.model, take.references[frame]
        colour = np.array(style.rgb(take.colour)) / 255
        data.qpos[:] = self._world.rest_qpos
        for place, robot in enumerate(self._world.robots):
            x, y, heading = take.poses[frame, place]
            data.qpos[robot.qpos[:2]] = x, y
            data.qpos[robot.qpos[3:7]] = np.cos(heading / 2), 0.0, 0.0, np.sin(heading / 2)
            data.qpos[robot.wheel_qpos] = take.wheels[frame, place]
        model.mat_rgba[cover_materials(model), :3] = colour
        mujoco.mj_fwdPosition(model, data)
        if self._follows:
            self._camera.lookat[:2] = (take.poses[frame, 0, :2] + references[0, :2]) / 2
        self._renderer.update_scene(data, self._camera)
        for place, (x, y, heading) in enumerate(references):
            self._add_line(take.references[:, place, :2], ROUTE)
            self._add_line(take.poses[: frame + 1, place, :2], (*colour, 1.0))
            # On top of the league's envelope a ring with a line to its front shows the reference.
            angles = heading + np.linspace(0, 2 * np.pi, 25)
            ring = np.column_stack([x + RADIUS_M * np.cos(angles), y + RADIUS_M * np.sin(angles)])
            self._add_line(np.concatenate([[[x, y]], ring]), REFERENCE, HEIGHT_M)

    def _add_line(self, points: Array, rgba: tuple[float, ...], height: float = 0.0) -> None:
        """Add a line through points (m, 2) at a height in m to the scene."""
        points = points[:: 1 + len(points) // PIECES]
        scene, capsule, zero = self._renderer.scene, mujoco.mjtGeom.mjGEOM_CAPSULE, np.zeros(3)
        for start, end in pairwise(np.column_stack([points, np.full(len(points), height)])):
            geom = scene.geoms[scene.ngeom]
            mujoco.mjv_initGeom(
                geom, capsule, zero, zero, np.eye(3).ravel(), np.array(rgba, np.float32)
            )
            mujoco.mjv_connector(geom, capsule, self._thickness / 2, start, end)
            scene.ngeom += 1


def write_film(pictures: Iterable[Image.Image], out: Path, rate: float) -> None:
    """Write pictures of one size to a file of a kind of `SUFFIXES`, `rate` of them a second.

    Raises:
        OmniError: The file cannot be written.
    """
    try:
        with open_atomic(out) as file:
            first, *others = pictures
            duration = round(1000 / rate)
            first.save(
                file, out.suffix[1:], save_all=True, append_images=others, loop=0, duration=duration
            )
    except OSError as error:
        raise OmniError(f"{out}: {error.strerror or error}") from None
