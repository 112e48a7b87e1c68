"""The path travelled: at full scale differences vanish, so where controllers stray farthest is shown enlarged."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from matplotlib.ticker import FixedLocator, MaxNLocator
from scipy.ndimage import maximum_filter1d
from scipy.spatial import cKDTree

from omni_control.kinematics import Array
from omni_mj.show import style
from omni_mj.show.figures import canvas
from omni_mj.show.figures.first import FirstRows

FINER = 20  # points of the reference between two frames, so that its nearest point is near enough
NEARBY_FRAMES = 15  # within which controllers that stray at the same place may pass the path's points
WIDER = 0.75  # half the width of a square, over how far is strayed in it
LEAST_M = 0.005
ENLARGED = 2.0  # times at least
MARGIN = 0.06  # around the overview, as a share of what it shows
BESIDE = 0.08  # as a share of the path's extent, within which squares have one mark
COLUMNS = 4  # of enlarged places, where each controller has its own
OVERVIEW_IN, MANY_OVERVIEW_IN = (4.7, 3.9), (7.1, 3.4)
DETAIL_IN, MANY_DETAIL_IN = 1.65, 1.4
UNDER_IN = 0.55  # between the overview and what is below it


@dataclass(frozen=True)
class Spot:
    """A square that is shown enlarged: its centre (2,) and half its width, m, and how far who is strayed there."""

    centre: Array
    half: float
    controller: int
    astray: float

    @property
    def wide(self) -> str:
        """Its width in words."""
        return f"{200 * self.half:.2g} cm wide" if self.half < 0.5 else f"{2 * self.half:.1f} m wide"


def path(first: FirstRows) -> Figure:
    """The reference and the paths travelled (figures 7 and 10), enlarged where controllers stray farthest.

    Few controllers are enlarged together, where any strays farthest, and elsewhere where the typical one does; of many
    each where it strays farthest itself.
    """
    reference, pose = first.reference[:, :2], first.channel("pose")[..., :2]
    names = first.names
    few = len(names) <= canvas.TOGETHER
    figure, overview, details = _few() if few else _many(len(names))
    spots = _spots(reference, pose, OVERVIEW_IN if few else MANY_OVERVIEW_IN, DETAIL_IN if few else MANY_DETAIL_IN)
    marks: list[str] = []
    for number, (axes, spot) in enumerate(zip(details, spots, strict=False)):
        if not few and spot.controller:
            axes.plot(*pose[:, 0].T, label=f"{names[0]}, to compare", **canvas.TO_COMPARE)
        _draw(axes, names, reference, pose, range(len(names)) if few else [spot.controller])
        mark = "AB"[number] if few else str(number + 1)
        _enlarge(axes, spot, f"{mark}, {spot.wide}" if few else f"{mark} {names[spot.controller]}")
        if not few:
            axes.set_xlabel(f"{100 * spot.astray:.3g} cm off the path", fontsize=8)
        edge = "black" if few else style.colour(first.slots[spot.controller])
        overview.add_patch(
            Rectangle(tuple(spot.centre - spot.half), 2 * spot.half, 2 * spot.half, fill=False, ec=edge, lw=1, zorder=7)
        )
        marks.append(mark)
    for group in _beside_each_other(spots, BESIDE * float(np.ptp(reference, axis=0).max())):
        x, y = spots[group[0]].centre + spots[group[0]].half
        overview.text(x, y, " ".join(marks[i] for i in group), weight="bold", zorder=8, path_effects=[canvas.HALO])
    for axes in details[len(spots) :]:
        axes.remove()
    _draw(overview, names, reference, pose, range(len(names)))
    overview.plot(*reference[0], "o", color="black", ms=6, zorder=6, label="start")
    for i in first.failed:
        travelled = pose[~np.isnan(pose[:, i, 0]), i]
        overview.plot(*travelled[-1:].T, "X", color=style.colour(first.slots[i]), ms=8, mec="black", zorder=6,
                      label=f"{names[i]} failed")  # fmt: skip
    overview.margins(MARGIN)
    overview.set(xlabel="x in m", ylabel="y in m")
    canvas.legend(figure, [overview, *details[: len(spots)]])
    figure.suptitle(
        f"Path travelled, and enlarged, in cm, where {'controllers stray' if few else 'each strays farthest'}"
    )
    return figure


def _few() -> tuple[Figure, Axes, list[Axes]]:
    """A sheet with the overview, and two enlarged places beside it."""
    wide = canvas.LEFT_IN + OVERVIEW_IN[0] + canvas.GAP_IN[0] + DETAIL_IN + canvas.RIGHT_IN
    high = canvas.ABOVE_IN + OVERVIEW_IN[1] + canvas.BELOW_IN
    figure = canvas.sheet(wide, high)
    x, top = wide - canvas.RIGHT_IN - DETAIL_IN, high - canvas.ABOVE_IN
    overview = _place(figure, canvas.LEFT_IN, canvas.BELOW_IN, *OVERVIEW_IN)
    return figure, overview, [_place(figure, x, y, DETAIL_IN, DETAIL_IN) for y in (top - DETAIL_IN, canvas.BELOW_IN)]


def _many(count: int) -> tuple[Figure, Axes, list[Axes]]:
    """A sheet with the overview, and `count` enlarged places below it."""
    lines, apart = -(-count // COLUMNS), MANY_DETAIL_IN + UNDER_IN + 0.1
    high = canvas.ABOVE_IN + MANY_OVERVIEW_IN[1] + UNDER_IN + lines * apart + canvas.BELOW_IN - UNDER_IN + 0.1
    figure = canvas.sheet(canvas.LEFT_IN + MANY_OVERVIEW_IN[0] + canvas.RIGHT_IN, high)
    bottom = high - canvas.ABOVE_IN - MANY_OVERVIEW_IN[1]
    overview = _place(figure, canvas.LEFT_IN, bottom, *MANY_OVERVIEW_IN)
    across = (MANY_OVERVIEW_IN[0] - MANY_DETAIL_IN) / (COLUMNS - 1)
    places = [(canvas.LEFT_IN + (i % COLUMNS) * across, bottom - (i // COLUMNS + 1) * apart) for i in range(count)]
    return figure, overview, [_place(figure, x, y, MANY_DETAIL_IN, MANY_DETAIL_IN) for x, y in places]


def _place(figure: Figure, x: float, y: float, width: float, height: float) -> Axes:
    """Axes at a place in inches from the sheet's lower left corner."""
    wide, high = figure.get_size_inches()
    return figure.add_axes((x / wide, y / high, width / wide, height / high))


def _draw(axes: Axes, controllers: tuple[str, ...], reference: Array, pose: Array, shown: Sequence[int]) -> None:
    axes.plot(*reference.T, color=style.BACKGROUND, lw=4, zorder=1, label="reference")
    slots = style.slots(controllers)
    for i in shown:
        axes.plot(*pose[:, i].T, zorder=3, label=controllers[i], **style.line(slots[i]) | {"marker": ""})
    axes.set_aspect("equal", adjustable="box")


def _enlarge(axes: Axes, spot: Spot, title: str) -> None:
    """Show a square, with scales that tell cm from its centre."""
    (x, y), half = spot.centre, spot.half
    axes.set(xlim=(x - half, x + half), ylim=(y - half, y + half), title=title)
    apart = np.asarray(MaxNLocator(4, steps=canvas.STEPS).tick_values(-half, half))
    shown = apart[np.abs(apart) <= half]
    for axis, middle in ((axes.xaxis, x), (axes.yaxis, y)):
        axis.set_major_locator(FixedLocator(middle + shown))
        axis.set_major_formatter(_centimetres_from(middle))
    axes.spines[:].set_visible(True)


def _centimetres_from(middle: float) -> Callable[[float, float], str]:
    return lambda tick, _: f"{100 * (tick - middle):.3g}".replace("-", "\N{MINUS SIGN}")


def _spots(reference: Array, pose: Array, overview: tuple[float, float], detail: float) -> list[Spot]:
    """Where who strays farthest from the path: of few controllers two places, of many one each.

    Args:
        reference: (frames, 2) m.
        pose: positions (frames, controllers, 2), m.
        overview: inches of the axes in which all is shown.
        detail: inches of a square.
    """
    far_at, at = _astray(reference, pose)
    astray = maximum_filter1d(far_at, NEARBY_FRAMES, axis=0)
    seen = np.concatenate([reference, pose.reshape(-1, 2)])
    extent = np.nanmax(seen, axis=0) - np.nanmin(seen, axis=0)
    per_metre = min(np.array(overview) / np.maximum((1 + 2 * MARGIN) * extent, LEAST_M))
    most = max(detail / (2 * ENLARGED * per_metre), LEAST_M)

    def spot(point: int, controller: int) -> Spot:
        first = max(point - NEARBY_FRAMES // 2, 0)
        point = first + int(far_at[first : point + NEARBY_FRAMES // 2 + 1, controller].argmax())
        far, where = float(far_at[point, controller]), pose[at[point, controller], controller]
        half = max(WIDER * far, LEAST_M)
        # What is strayed too far to be shown whole is seen in the overview; enlarged is then the robot's own path.
        return Spot((reference[point] + where) / 2 if half <= most else where, min(half, most), controller, far)

    if pose.shape[1] > canvas.TOGETHER:
        return [spot(int(each.argmax()), i) for i, each in enumerate(astray.T)]
    point = int(astray.max(1).argmax())
    spots = [spot(point, int(astray[point].argmax()))]
    far = np.linalg.norm(reference - reference[point], axis=1) > np.ptp(reference, axis=0).max() / 4
    if far.any():
        typical = np.where(far, np.median(astray, axis=1), -1.0)
        point = int(typical.argmax())
        spots.append(spot(point, int(np.argsort(astray[point])[(pose.shape[1] - 1) // 2])))
    return spots


def _beside_each_other(spots: Sequence[Spot], near: float) -> list[list[int]]:
    """Numbers of the squares whose marks would lie on one another, `near` m or less apart, together."""
    groups: list[list[int]] = []
    for i, spot in enumerate(spots):
        corner = spot.centre + spot.half
        there = (g for g in groups if np.linalg.norm(spots[g[0]].centre + spots[g[0]].half - corner) <= near)
        group = next(there, None)
        groups.append([i]) if group is None else group.append(i)
    return groups


def _astray(reference: Array, pose: Array) -> tuple[Array, np.ndarray]:
    """How far each controller was from the path when it passed each of its points at most, and in which frame.

    Returns:
        Distances (frames, controllers), m, and frames (frames, controllers).
    """
    along = np.linspace(0, len(reference) - 1, FINER * len(reference))
    fine = np.stack([np.interp(along, np.arange(len(reference)), column) for column in reference.T], axis=-1)
    tree, most = cKDTree(fine), np.zeros((len(reference), pose.shape[1]))
    frames = np.zeros(most.shape, int)
    for i in range(pose.shape[1]):
        own = np.flatnonzero(~np.isnan(pose[:, i]).any(-1))
        distance, nearest = tree.query(pose[own, i])
        order = np.argsort(distance, kind="stable")  # so that the farthest is written last
        point = np.rint(along[nearest[order]]).astype(int)
        most[point, i], frames[point, i] = distance[order], own[order]
    return most, frames
