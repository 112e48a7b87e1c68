"""Films of runs: a panel for each controller, drawn by MuJoCo, with its name and its error."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction
from itertools import pairwise
from pathlib import Path
from typing import Any, BinaryIO

import mujoco
import numpy as np
import pyarrow.compute as pc
from PIL import Image, ImageDraw, ImageFont

from omni_control.errors import OmniError
from omni_control.kinematics import Array
from omni_mj import parquet
from omni_mj.files import whole
from omni_mj.scenarios import scenario
from omni_mj.scenarios.settings import PERIOD_S, Settings
from omni_mj.show import style
from omni_mj.show.recording.scene import COVER
from omni_mj.worlds import build, parts

CODECS = {".mp4": "libx264", ".webm": "libvpx-vp9"}
KINDS = (".gif", ".webp", *CODECS)
NEEDS = "MuJoCo cannot draw here: {reason}; without a display it needs EGL, on Debian libegl1 and libgl1-mesa-dri"
PANELS_ACROSS, GAP = 4, 4  # panels in a row at most; pixels between panels
TRAIL_STEP = 3  # frames between points of a trail
# View -> elevation of its direction, deg, and distance, m, or None to have the whole route in sight.
VIEWS: dict[str, tuple[float, float | None]] = {"follow": (-38.0, 0.85), "whole": (-55.0, None), "plan": (-90.0, None)}
REFERENCE, ROUTE = (1.0, 1.0, 1.0, 1.0), (1.0, 1.0, 1.0, 0.6)
RING_M, ABOVE_M = 0.09, 0.15  # radius and height of the league's envelope, on top of which a ring shows the reference
LINE_SHARE = 0.007  # thickness of lines, as a share of the distance from which they are seen
HEADLIGHT = 0.1  # next to the scene's own light; more, and seen from above a robot's colour is burnt out
MAX_GEOMS = 20_000  # a robot with whole wheels has some 200, a path one for each of its pieces
MARGIN_M = 0.35  # around the route, for the robots on it


@dataclass(frozen=True)
class Take:
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

    @property
    def errors(self) -> Array:
        """Largest distance of a robot from its reference, (frames,) m."""
        return np.linalg.norm((self.poses - self.references)[..., :2], axis=-1).max(-1)


@dataclass(frozen=True)
class Film:
    """A run, as far as a film shows it.

    Args:
        settings: Settings of its robots.
        takes: Takes of its controllers.
    """

    settings: Settings
    takes: Sequence[Take]

    @classmethod
    def of(cls, folder: Path, controllers: Sequence[str] = (), code: bool = False) -> "Film":
        """Read the first seed of a run.

        Args:
            folder: Folder of a run.
            controllers: Names of controllers. [all]
            code: Whether controllers of a user's own, which the scenario names, may be imported.

        Raises:
            OmniError: The folder holds no run, no trajectory, or no such controller.
        """
        frames = folder / "trajectory.parquet"
        for file in (folder / "scenario.toml", frames):
            if not file.is_file():
                raise OmniError(f"{folder} holds no run to film: there is no {file.name}; give the folder of a run")
        settings = scenario.load(str(folder / "scenario.toml"), code=code).settings
        pose = ["x_m", "y_m", "heading_rad"]
        angles = [f"wheel_angle_{i + 1}_rad" for i in range(len(settings.wheels.kinematics.azimuths))]
        has_angles = set(angles) <= set(parquet.schema(frames).names)  # the kinematic plant has no wheels
        needed = ["controller", "seed", "place", "frame", *pose, *(f"ref_{name}" for name in pose)]
        table = parquet.read(frames, needed + angles * has_angles)
        if not table.num_rows or any(column.null_count for column in table.columns):
            raise OmniError(f"{frames} is not a run's trajectory: it lacks what a film shows")
        table = table.filter(pc.equal(table["seed"], table["seed"][0]))
        known = table["controller"].unique().to_pylist()
        if unknown := [name for name in controllers if name not in known]:
            raise OmniError(f"{folder} has no controller {unknown[0]!r}; it has {', '.join(known)}")
        slots, takes = style.slots(known), []
        for name in controllers or known:
            part = table.filter(pc.equal(table["controller"].cast("string"), name))
            part = part.sort_by([("frame", "ascending"), ("place", "ascending")])
            places = len(part["place"].unique())
            numbers = np.column_stack([part[key].to_numpy() for key in part.column_names[4:]])
            numbers = numbers[: len(numbers) // places * places]  # robots that failed have no frames after that
            numbers = numbers.reshape(-1, places, numbers.shape[1])
            turned = numbers[..., 6:] if has_angles else np.zeros((*numbers.shape[:2], len(angles)))
            colour = style.colour(slots[name])
            takes.append(Take(name, colour, numbers[..., :3], numbers[..., 3:6], np.nan_to_num(turned)))
        return cls(settings, takes)

    @property
    def duration_s(self) -> float:
        """Duration of the longest take."""
        return max(len(take.poses) for take in self.takes) * PERIOD_S

    @property
    def grid(self) -> tuple[int, int]:
        """Rows and columns of panels."""
        rows = -(-len(self.takes) // PANELS_ACROSS)
        return rows, -(-len(self.takes) // rows)

    def pictures(self, instants: Array, view: str, size: tuple[int, int]) -> Iterator[Image.Image]:
        """Yield a picture for each of the `instants` in s, from one of `VIEWS`, of a size in pixels.

        Raises:
            OmniError: MuJoCo finds nothing to draw with.
        """
        rows, columns = self.grid
        width, height = (size[0] - GAP * (columns - 1)) // columns, (size[1] - GAP * (rows - 1)) // rows
        route = np.concatenate([take.references[..., :2].reshape(-1, 2) for take in self.takes])
        stage = _Stage(self.settings, self.takes[0].poses.shape[1], view, route, (width, height))
        try:
            for instant in instants:
                picture = Image.new("RGB", size, "white")
                for i, take in enumerate(self.takes):
                    row, column = divmod(i, columns)
                    picture.paste(_panel(stage, take, instant), (column * (width + GAP), row * (height + GAP)))
                yield picture
        finally:
            stage.renderer.close()


def write(pictures: Iterable[Image.Image], out: Path, rate: float) -> None:
    """Write pictures of one size to a file of a kind of `KINDS`, `rate` of them a second.

    Raises:
        OmniError: Its kind is unknown, PyAV is missing, or the file cannot be written.
    """
    if out.suffix not in KINDS:
        raise OmniError(f"{out}: a film's name ends in {', '.join(KINDS)}")
    try:
        with whole(out) as file:
            if out.suffix in CODECS:
                _write_video(pictures, file, out.suffix, rate)
            else:
                first, *others = pictures
                duration = round(1000 / rate)
                first.save(file, out.suffix[1:], save_all=True, append_images=others, loop=0, duration=duration)
    except ImportError:
        raise OmniError(f"{out}: videos need PyAV: pip install 'omni-mj[film]'; .gif and .webp do not") from None
    except OSError as error:
        raise OmniError(f"{out}: {error.strerror or error}") from None


def _write_video(pictures: Iterable[Image.Image], file: BinaryIO, kind: str, rate: float) -> None:
    import av

    frame: Any = av.VideoFrame
    with av.open(file, "w", format=kind[1:]) as container:
        stream: Any = container.add_stream(CODECS[kind], rate=Fraction(rate).limit_denominator(1000))
        stream.pix_fmt = "yuv420p"
        for picture in pictures:
            even = (0, 0, picture.width // 2 * 2, picture.height // 2 * 2)
            if not stream.codec_context.is_open:
                stream.width, stream.height = even[2:]
            container.mux(stream.encode(frame.from_image(picture.crop(even))))
        container.mux(stream.encode())


def _panel(stage: "_Stage", take: Take, instant: float) -> Image.Image:
    now = min(round(instant / PERIOD_S), len(take.poses) - 1)
    panel = Image.fromarray(stage.draw(take, now))
    pen, inset = ImageDraw.Draw(panel), panel.height // 40
    large, small = (ImageFont.load_default(max(9, panel.height // n)) for n in (18, 26))
    pen.text((inset, inset), take.controller, "white", large, stroke_width=2, stroke_fill=take.colour)
    error = f"{100 * take.errors[now]:.1f} cm off, {100 * take.errors[: now + 1].max():.1f} at most"
    pen.text((inset, panel.height - inset), error, "white", small, anchor="ls", stroke_width=2, stroke_fill="#00000080")
    pen.text((panel.width - inset, inset), f"{instant:.1f} s", "white", small, anchor="ra")
    return panel


class _Stage:
    """The robots of one world and a camera.

    Args:
        settings: Settings of the robots.
        places: Number of robots.
        view: Name of one of `VIEWS`.
        route: Where all references go, (m, 2) m.
        size: Width and height of a picture, pixels.

    Raises:
        OmniError: MuJoCo finds nothing to draw with.
    """

    def __init__(self, settings: Settings, places: int, view: str, route: Array, size: tuple[int, int]) -> None:
        self._world = build.world(settings.replace(wheels={"model": "rollers"}), places, hulls=False)
        self._model, (width, height) = self._world.model, size
        self._data, visual = mujoco.MjData(self._model), self._model.vis
        visual.global_.offwidth, visual.global_.offheight = width, height
        quality = visual.quality  # of a software renderer: time goes with the facets of some 80 rollers
        quality.numslices, quality.numstacks, quality.shadowsize = 20, 8, 1024
        visual.headlight.diffuse[:] = HEADLIGHT
        try:
            self.renderer = mujoco.Renderer(self._model, height, width, MAX_GEOMS)
        except Exception as error:  # whatever the platform's GL raises
            raise OmniError(NEEDS.format(reason=error or type(error).__name__)) from None
        low, high = route.min(0) - MARGIN_M, route.max(0) + MARGIN_M
        self._camera = mujoco.MjvCamera()
        self._camera.azimuth = 90.0
        self._camera.elevation, near = VIEWS[view]
        self._follows = near is not None and places == 1
        self._camera.lookat[:] = *(low + high) / 2, 0.05
        # The whole route is in sight from where its height and, less by the picture's shape, its width are.
        size_m = max(high[1] - low[1], (high[0] - low[0]) * height / width)
        far = float(size_m / 2 / np.tan(np.deg2rad(visual.global_.fovy / 2)))
        self._camera.distance = near if near and self._follows else far
        self._thickness = LINE_SHARE * self._camera.distance

    def draw(self, take: Take, frame: int) -> np.ndarray:
        """Return a picture of a frame, (height, width, 3) bytes."""
        poses, references = take.poses[frame], take.references[frame]
        colour = np.array(style.rgb(take.colour)) / 255
        self._pose(poses, take.wheels[frame], colour)
        if self._follows:
            self._camera.lookat[:2] = (poses[0, :2] + references[0, :2]) / 2
        self.renderer.update_scene(self._data, self._camera)
        for place, (x, y, heading) in enumerate(references):
            self._add_line(take.references[::TRAIL_STEP, place, :2], ROUTE)
            self._add_line(take.poses[: frame + 1 : TRAIL_STEP, place, :2], (*colour, 1.0))
            angles = heading + np.linspace(0, 2 * np.pi, 25)
            ring = np.array([x, y]) + RING_M * np.column_stack([np.cos(angles), np.sin(angles)])
            self._add_line(np.concatenate([[[x, y]], ring]), REFERENCE, ABOVE_M)
        return np.array(self.renderer.render())

    def _pose(self, poses: Array, wheels: Array, colour: Array) -> None:
        data, model = self._data, self._model
        data.qpos[:] = self._world.standing
        for place, (robot, (x, y, heading), angles) in enumerate(zip(self._world.robots, poses, wheels, strict=True)):
            data.qpos[robot.qpos[:2]] = x, y
            data.qpos[robot.qpos[3:7]] = np.cos(heading / 2), 0.0, 0.0, np.sin(heading / 2)
            data.qpos[robot.wheel_qpos] = angles
            cover = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_MATERIAL, parts.prefix(place) + COVER)
            if cover >= 0:
                model.mat_rgba[cover, :3] = colour
        for compute in (mujoco.mj_kinematics, mujoco.mj_comPos, mujoco.mj_camlight):
            compute(model, data)

    def _add_line(self, points: Array, rgba: tuple[float, ...], height: float | None = None) -> None:
        """Add a line through points (m, 2) at a height in m, else on the carpet, to the scene."""
        heights = np.full(len(points), self._thickness / 2 if height is None else height)
        scene, capsule = self.renderer.scene, mujoco.mjtGeom.mjGEOM_CAPSULE
        for start, end in pairwise(np.column_stack([points, heights])):
            if scene.ngeom < scene.maxgeom:
                geom, zero = scene.geoms[scene.ngeom], np.zeros(3)
                mujoco.mjv_initGeom(geom, capsule, zero, zero, np.eye(3).ravel(), np.array(rgba, np.float32))
                mujoco.mjv_connector(geom, capsule, self._thickness / 2, start, end)
                scene.ngeom += 1
