"""The path travelled: at full scale differences vanish, so where controllers stray farthest is shown enlarged."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from matplotlib.ticker import MaxNLocator
from scipy.ndimage import maximum_filter1d
from scipy.spatial import cKDTree

from omni_control.kinematics import Array
from omni_mj.show import style
from omni_mj.show.figures import canvas
from omni_mj.show.figures.first import FirstRows

FINER = 20  # points of the reference between two frames, so that its nearest point is near enough
NEARBY_FRAMES = 15  # within which controllers that stray at the same place may pass the path's points
WIDER = 1.5  # half the width of a square, over how far is strayed in it
LEAST_M = 0.005
MAGNIFIED = 18.0  # extent of the path over half the width of a square at least, so that it enlarges three times
COLUMNS = 4  # of enlarged places, where each controller has its own


def path(first: FirstRows) -> Figure:
    """The reference and the paths travelled (figures 7 and 10), enlarged where controllers stray farthest."""
    reference, pose = first.reference[:, :2], first.channel("pose")[..., :2]
    names, everyone = first.names, range(len(first.names))
    spots = _spots(reference, pose)
    if len(names) <= canvas.TOGETHER:
        figure = Figure(figsize=(8, 4.7))
        grid = figure.add_gridspec(len(spots), 2, width_ratios=(2, 1))
        overview = figure.add_subplot(grid[:, 0])
        details = [figure.add_subplot(grid[i, 1]) for i in range(len(spots))]
        for letter, axes, spot in zip("AB", details, spots, strict=False):
            _draw(axes, names, reference, pose, everyone)
            _enlarge(axes, spot, f"{letter}, {_wide(spot)}")
    else:
        spots, rows = spots[:1], -(-len(names) // COLUMNS)
        figure = Figure(figsize=(8, 3.6 + 2.2 * rows))
        grid = figure.add_gridspec(1 + rows, COLUMNS, height_ratios=(3.2, *[2.2] * rows))
        overview = figure.add_subplot(grid[0, :])
        for i, name in enumerate(names):
            axes = figure.add_subplot(grid[1 + i // COLUMNS, i % COLUMNS])
            if i:
                axes.plot(*pose[:, 0].T, color=style.REFERENCE, lw=0.8)
            _draw(axes, names, reference, pose, [i])
            _enlarge(axes, spots[0], name)
            axes.label_outer()
    _draw(overview, names, reference, pose, everyone)
    overview.plot(*reference[0], "o", color="black", ms=6, zorder=6, label="start")
    for i in first.failed:
        travelled = pose[~np.isnan(pose[:, i, 0]), i]
        overview.plot(*travelled[-1:].T, "X", color=style.colour(first.slots[i]), ms=8, mec="black", zorder=6,
                      label=f"{names[i]} failed")  # fmt: skip
    overview.margins(0.06)
    overview.set(xlabel="$x$ in m", ylabel="$y$ in m")
    for letter, (centre, half) in zip("AB", spots, strict=False):
        overview.add_patch(Rectangle(tuple(centre - half), 2 * half, 2 * half, fill=False, ec="black", lw=1, zorder=7))
        overview.annotate(letter, tuple(centre + half), (3, 1), textcoords="offset points", weight="bold")
    canvas.legend(figure, overview)
    figure.suptitle("Path travelled" + (f", and enlarged at A, {_wide(spots[0])}" if len(spots) == 1 else ""))
    return figure


def _draw(axes: Axes, controllers: tuple[str, ...], reference: Array, pose: Array, shown: Sequence[int]) -> None:
    axes.plot(*reference.T, color=style.BACKGROUND, lw=4, zorder=1, label="reference")
    slots = style.slots(controllers)
    for i in shown:
        axes.plot(*pose[:, i].T, zorder=3, label=controllers[i], **style.line(slots[i]) | {"marker": ""})
    axes.set_aspect("equal", adjustable="box")


def _enlarge(axes: Axes, spot: tuple[Array, float], title: str) -> None:
    (x, y), half = spot
    axes.set(xlim=(x - half, x + half), ylim=(y - half, y + half), title=title)
    axes.set_xlabel("$x$ in m", fontsize=8)
    axes.set_ylabel("$y$ in m", fontsize=8)
    axes.xaxis.set_major_locator(MaxNLocator(3))
    axes.yaxis.set_major_locator(MaxNLocator(3))
    axes.spines[:].set_visible(True)


def _wide(spot: tuple[Array, float]) -> str:
    return f"{200 * spot[1]:.0f} cm wide" if spot[1] < 0.5 else f"{2 * spot[1]:.1f} m wide"


def _spots(reference: Array, pose: Array) -> list[tuple[Array, float]]:
    """Centres and half widths of one or two squares, m: where the typical controller strays farthest from the path.

    With few controllers, before that where any of them does.
    """
    astray = _astray(reference, pose)
    extent = float(max(np.ptp(reference, axis=0).max(), 0.01))
    typical = np.median(astray, axis=1)
    few = pose.shape[1] <= canvas.TOGETHER
    spots: list[tuple[Array, float]] = []
    far = np.ones(len(reference), bool)
    for rank in (astray.max(1), typical) if few else (typical,):
        if far.any():
            worst = int(np.where(far, rank, -1.0).argmax())
            spots.append((reference[worst], float(np.clip(WIDER * rank[worst], LEAST_M, extent / MAGNIFIED))))
            far &= np.linalg.norm(reference - reference[worst], axis=1) > extent / 4
    return spots


def _astray(reference: Array, pose: Array) -> Array:
    """How far each controller was from the path when it passed each of its points at most, (frames, controllers) m."""
    at = np.linspace(0, len(reference) - 1, FINER * len(reference))
    fine = np.stack([np.interp(at, np.arange(len(reference)), column) for column in reference.T], axis=-1)
    tree, most = cKDTree(fine), np.zeros((len(reference), pose.shape[1]))
    for i in range(pose.shape[1]):
        distance, nearest = tree.query(pose[~np.isnan(pose[:, i]).any(-1), i])
        np.maximum.at(most[:, i], np.rint(at[nearest]).astype(int), distance)
    return maximum_filter1d(most, NEARBY_FRAMES, axis=0)
