"""A run as a sequence of pictures: a panel for each controller, side by side, with its name and its error."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import matplotlib
import numpy as np
from PIL import Image, ImageDraw, ImageFont

from omni_control.errors import OmniError
from omni_control.kinematics import Array
from omni_mj import parquet
from omni_mj.scenarios import scenario
from omni_mj.scenarios.settings import PERIOD_S, Settings
from omni_mj.show import style
from omni_mj.show.film.stage import Stage

FONT = Path(matplotlib.get_data_path()) / "fonts" / "ttf" / "DejaVuSans.ttf"
ACROSS = 4  # panels beside each other at most, so that names and robots fit in
GAP = 4  # pixels between panels
TRAIL_EVERY = 3  # frames of a trail from point to point


@dataclass(frozen=True)
class Take:
    """What one controller did with the first seed.

    Args:
        controller: its name.
        colour: as in figures and recordings.
        poses: of its robots, (frames, places, 3) m, m, rad.
        references: poses in which they should be, as poses.
        wheels: wheels' angles, (frames, places, wheels) rad.
    """

    controller: str
    colour: str
    poses: Array
    references: Array
    wheels: Array

    @property
    def errors(self) -> Array:
        """Distance of each robot from where it should be, (frames, places) m."""
        return np.hypot(*np.moveaxis((self.poses - self.references)[..., :2], -1, 0))


@dataclass(frozen=True)
class Reel:
    """A run, as far as a film shows it.

    Args:
        settings: of its robots.
        takes: of its controllers.
    """

    settings: Settings
    takes: Sequence[Take]

    @classmethod
    def of(cls, folder: Path, controllers: Sequence[str] = (), code: bool = False) -> "Reel":
        """Read the folder of a run; of its first seed, all controllers or those that are named.

        Args:
            folder: of a run.
            controllers: their names. [all]
            code: whether controllers of a user's own, which the scenario names, may be read.

        Raises:
            OmniError: it holds no run, no trajectory, or no such controller.
        """
        frames = folder / "trajectory.parquet"
        for file in (folder / "scenario.toml", frames):
            if not file.is_file():
                raise OmniError(f"{folder} holds no run to film: there is no {file.name}; give the folder of a run")
        settings = scenario.load(str(folder / "scenario.toml"), code=code).settings
        count = len(settings.wheels.kinematics.azimuths)
        needed = _columns(parquet.schema(frames).names, count)
        table = parquet.read(frames, needed)
        if (
            len(table.column_names) < len(needed)
            or not table.num_rows
            or any(each.null_count for each in table.columns)
        ):
            raise OmniError(f"{frames} is not a run's trajectory: it lacks what a film shows")
        column = {name: table[name].to_numpy() for name in table.column_names}
        known = list(dict.fromkeys(column["controller"]))
        if unknown := [name for name in controllers if name not in known]:
            raise OmniError(f"{folder} has no controller {unknown[0]!r}; it has {', '.join(known)}")
        first = column["seed"] == column["seed"][0]
        takes, slots = [], dict(zip(known, style.slots(known), strict=True))
        for name in controllers or known:
            mine = first & (column["controller"] == name)
            places = len(set(column["place"][mine]))
            order = np.lexsort((column["place"][mine], column["frame"][mine]))
            data = {key: value[mine][order] for key, value in column.items()}
            whole = len(order) // places * places  # robots that failed have no frames after that
            numbers = np.column_stack([data[key] for key in _columns(data, count)[4:]])[:whole]
            numbers = numbers.reshape(-1, places, numbers.shape[1])
            wheels = numbers[..., 6:] if numbers.shape[2] > 6 else np.zeros((*numbers.shape[:2], count))
            colour, pose, reference = style.colour(slots[name]), numbers[..., :3], numbers[..., 3:6]
            takes.append(Take(name, colour, pose, reference, np.nan_to_num(wheels)))
        return cls(settings, takes)

    @property
    def duration_s(self) -> float:
        """Of the longest take."""
        return max(len(take.poses) for take in self.takes) * PERIOD_S

    def pictures(self, instants: Array, view: str, size: tuple[int, int]) -> Iterator[Image.Image]:
        """Yield a picture for each of the `instants` (s), seen as `stage.VIEWS` names it, of a size in pixels.

        Raises:
            OmniError: see `Stage`.
        """
        lines, columns = grid(len(self.takes))
        panel = (size[0] - GAP * (columns - 1)) // columns, (size[1] - GAP * (lines - 1)) // lines
        route = np.concatenate([take.references[..., :2].reshape(-1, 2) for take in self.takes])
        stage = Stage(self.settings, self.takes[0].poses.shape[1], view, route, panel)
        try:
            for instant in instants:
                whole = Image.new("RGB", size, "white")
                for i, take in enumerate(self.takes):
                    line, column = divmod(i, columns)
                    whole.paste(_panel(stage, take, instant), (column * (panel[0] + GAP), line * (panel[1] + GAP)))
                yield whole
        finally:
            stage.close()


def grid(panels: int) -> tuple[int, int]:
    """Lines and columns of so many panels, `ACROSS` beside each other at most."""
    lines = -(-panels // ACROSS)
    return lines, -(-panels // lines)


def _panel(stage: Stage, take: Take, instant: float) -> Image.Image:
    now = min(round(instant / PERIOD_S), len(take.poses) - 1)
    past = slice(0, now + 1, TRAIL_EVERY)
    places = range(take.poses.shape[1])
    red, green, blue = (byte / 255 for byte in style.rgb(take.colour))
    drawn = stage.draw(
        take.poses[now],
        take.wheels[now],
        take.references[now],
        [_thinned(take.poses[past, place, :2]) for place in places],
        [_thinned(take.references[::TRAIL_EVERY, place, :2]) for place in places],
        (red, green, blue),
    )
    panel = Image.fromarray(drawn)
    pen, font = ImageDraw.Draw(panel), ImageFont.truetype(FONT, max(11, panel.height // 18))
    small = ImageFont.truetype(FONT, max(9, panel.height // 26))
    inset = panel.height // 40
    pen.text((inset, inset), take.controller, "white", font, stroke_width=2, stroke_fill=take.colour)
    error = f"{100 * take.errors[now].max():.1f} cm off, {100 * take.errors[: now + 1].max():.1f} at most"
    pen.text((inset, panel.height - inset), error, "white", small, anchor="ls", stroke_width=2, stroke_fill="#00000080")
    pen.text((panel.width - inset, inset), f"{instant:.1f} s", "white", small, anchor="ra")
    return panel


def _thinned(points: Array) -> Array:
    """Points (m, 2) without those that lie where the one before does."""
    kept = [points[0]]
    for before, point in pairwise(points):
        if np.hypot(*(point - before)) > 1e-4:
            kept.append(point)
    return np.array(kept)


def _columns(there: "Sequence[str] | dict[str, Array]", wheels: int) -> list[str]:
    """Names of the columns that a film needs: what a row is, its pose, the reference, wheels' angles if any."""
    angles = [f"wheel_angle_{i + 1}_rad" for i in range(wheels)]
    pose = ["x_m", "y_m", "heading_rad"]
    needed = ["controller", "seed", "place", "frame", *pose, *(f"ref_{name}" for name in pose)]
    return needed + (angles if all(name in there for name in angles) else [])
