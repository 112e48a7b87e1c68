"""Layout of a recording in the viewer: the scene from aside and from next to a robot, series, events."""

from collections.abc import Mapping, Sequence

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from omni_control.kinematics import Array
from omni_mj.config.settings import PERIOD_S
from omni_mj.viz.recording.plots import SINGLE, Plot
from omni_mj.viz.recording.scene import FRAME, TIME

LEGEND_LINES = 3  # that the legend of a plot has room for; with more, the plot is higher
LEGEND_SHARE = 0.4  # of a run's time, left free on the right for the legend
MARGIN_M = 0.8  # in sight around the references, in all
FIELD = "field (ring: seen by vision; cylinder: predicted; dot: reference)"


def blueprint(
    names: Sequence[str], paths: Sequence[Array], tabs: Mapping[str, Sequence[Plot]], live: bool
) -> rrb.Blueprint:
    """Return the layout.

    Args:
        names: Names of the robots.
        paths: References that they follow, (frames, 3) each.
        tabs: Plots of each tab.
        live: Follow what is being recorded instead of waiting at its start.
    """
    points = np.concatenate([path[:, :2] for path in paths])
    low, high = points.min(0), points.max(0)
    (x, y), reach = (low + high) / 2, MARGIN_M + float(np.hypot(*(high - low)))
    aside = ([x, y - 0.6 * reach, 0.55 * reach], [x, y, 0])
    near = ([0.22, 0.25, 0.09], [0, 0, 0.055])  # close enough to see the rollers
    second = min(
        1, len(names) - 1
    )  # where there is room for one robot, not the one that others are compared with
    close_ups = [
        _scene(
            name,
            ["world/field/**", "world/reference", f"world/{name}/**"],
            near,
            [name],
            f"world/{name}/robot",
        )
        for name in names
    ]
    left = rrb.Vertical(
        _scene(FIELD, ["$origin/**"], aside, names),
        rrb.Tabs(*close_ups, active_tab=second),
    )
    seconds = PERIOD_S * max(map(len, paths))
    right: list[rrb.Container | rrb.View] = []
    for tab, plots in tabs.items():
        if plots and tab in SINGLE:
            stacks = (_stack(name, plots, seconds, 1, f"/{name}") for name in names)
            right.append(rrb.Tabs(*stacks, name=tab, active_tab=second))
        elif plots:
            right.append(_stack(tab, plots, seconds, len(names)))
    right.append(rrb.TextLogView(origin="events", name="events"))
    time = rrb.TimePanel(
        timeline=TIME, play_state="following" if live else "paused", state="collapsed"
    )
    return rrb.Blueprint(rrb.Horizontal(left, rrb.Tabs(*right)), time, collapse_panels=True)


def _scene(
    name: str,
    contents: list[str],
    eye: tuple[list[float], list[float]],
    robots: Sequence[str],
    origin: str = "world",
) -> rrb.Spatial3DView:
    """Return a view of the scene; paths of robots are shown from the start to the time cursor.

    Args:
        name: Name of the view.
        contents: Entities that it shows.
        eye: Position of the eye, and the point that it looks at, m.
        robots: Names of the robots whose paths are shown.
        origin: Entity whose axes are the view's.
    """
    start, now = rrb.TimeRangeBoundary.infinite(), rrb.TimeRangeBoundary.cursor_relative()
    ranges = rrb.VisibleTimeRanges(
        [rrb.VisibleTimeRange(line, start=start, end=now) for line in (FRAME, TIME)]
    )
    return rrb.Spatial3DView(
        origin=origin,
        contents=contents,
        name=name,
        eye_controls=rrb.EyeControls3D(position=eye[0], look_target=eye[1], eye_up=[0, 0, 1]),
        line_grid=False,
        overrides={f"world/{robot}/path": ranges for robot in robots},
    )


def _stack(
    name: str, plots: Sequence[Plot], seconds: float, robots: int, below: str = ""
) -> rrb.Vertical:
    """Return plots above each other; the first, which has the legend, is as high as that needs."""
    start, end = (
        rr.TimeRangeBoundary.absolute(seconds=at) for at in (0.0, (1 + LEGEND_SHARE) * seconds)
    )
    lines = robots * len(plots[0].lines)
    views = [
        rrb.TimeSeriesView(
            origin=f"plots/{plot.path}{below}",
            name=plot.title,
            axis_x=rrb.TimeAxis(view_range=rr.TimeRange(start, end)),
            axis_y=rrb.ScalarAxis(range=plot.range) if plot.range else None,
            plot_legend=rrb.PlotLegend(corner="RightTop", visible=not i),
        )
        for i, plot in enumerate(plots)
    ]
    return rrb.Vertical(
        *views, name=name, row_shares=[max(1.0, lines / LEGEND_LINES), *[1.0] * (len(plots) - 1)]
    )
