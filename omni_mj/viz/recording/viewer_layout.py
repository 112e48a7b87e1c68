"""Layout of a recording in the viewer: the field, close-ups of robots, plots and events."""

from collections.abc import Mapping, Sequence

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from omni_control.kinematics import Array
from omni_mj.config import PERIOD_S
from omni_mj.viz.recording.plots import ONE_ROBOT_TABS, Plot
from omni_mj.viz.recording.rerun_stream import FRAME, TIME
from omni_mj.viz.recording.scene import ERROR_SCALE, ESTIMATES, measure_scene

LEGEND_LINES = 3  # that fit into a plot of normal height
LEGEND_FRACTION = 0.4  # of a run's time, left free on the right for the legend
# Pixels of all plots of a tab in a small window, of a plot's title and time axis, between labels
TAB_PX, TITLE_PX, LABEL_PX = 780, 45, 20
MAX_STRETCH = 3.0  # of an axis for labels; beyond, curves would be too flat
LABEL_MARGIN = 0.08  # of an axis beyond its last label, relative to the distance of labels
CLOSE_UP_EYE = [0.22, 0.25, 0.09], [0.0, 0.0, 0.055]  # m; close enough to see the rollers
FIELD_TITLE = f"field: each flag is a position error, drawn {ERROR_SCALE} times as long"
Range = tuple[float, float]
Eye = tuple[list[float], list[float]]  # position of the eye, and the point it looks at, m


def create_layout(
    names: Sequence[str],
    references: Sequence[Array],
    tabs: Mapping[str, Sequence[Plot]],
    extremes: Mapping[str, Range],
    is_live: bool,
) -> rrb.Blueprint:
    """Return the layout.

    Args:
        names: Names of the robots.
        references: Reference poses that the robots follow, (frames, 3) each.
        tabs: Plots of each tab.
        extremes: Smallest and largest value of some plots, by path.
        is_live: Follow the end of the recording instead of waiting at its start.
    """
    # The first robot is often the baseline; the second one is more interesting.
    active_robot = min(1, len(names) - 1)
    robots = [f"world/{name}" for name in names]
    hidden = [f"- {robot}/{channel}/**" for robot in robots for channel in ESTIMATES]
    # The eye sees all references from the side.
    (x, y), size_m = measure_scene(references)
    field_eye = [x, y - 0.53 * size_m, 0.53 * size_m], [x, y, 0.08 * size_m]
    field = _scene_view(FIELD_TITLE, ["$origin/**", *hidden], field_eye, robots)
    close_ups = []
    for name, robot in zip(names, robots, strict=True):
        contents = ["world/field/**", "world/reference", f"{robot}/**", f"- {robot}/error/**"]
        close_ups.append(_scene_view(name, contents, CLOSE_UP_EYE, [robot], f"{robot}/robot"))
    left_column = rrb.Vertical(
        field, rrb.Tabs(*close_ups, active_tab=active_robot), row_shares=[4, 3]
    )
    duration_s = PERIOD_S * max(map(len, references))
    right_views: list[rrb.Container | rrb.View] = []
    for tab, plots in tabs.items():
        if plots and tab in ONE_ROBOT_TABS:
            stacks = [
                _stack_plots(name, plots, extremes, duration_s, 1, f"/{name}") for name in names
            ]
            right_views.append(rrb.Tabs(*stacks, name=tab, active_tab=active_robot))
        elif plots:
            right_views.append(_stack_plots(tab, plots, extremes, duration_s, len(names)))
    right_views.append(rrb.TextLogView(origin="events", name="events"))
    time_panel = rrb.TimePanel(
        timeline=TIME, play_state="following" if is_live else "paused", state="collapsed"
    )
    return rrb.Blueprint(
        rrb.Horizontal(left_column, rrb.Tabs(*right_views)), time_panel, collapse_panels=True
    )


def _scene_view(
    name: str, contents: list[str], eye: Eye, robots: Sequence[str], origin: str = "world"
) -> rrb.Spatial3DView:
    """Return a view of the scene; paths of robots reach from the start to the time cursor.

    Args:
        name: Title of the view.
        contents: Entities that the view shows, or excludes with a minus sign.
        eye: Position of the eye, and the point it looks at, m.
        robots: Entities of the robots whose paths are visible.
        origin: Entity that defines the axes of the view.
    """
    start, cursor = rrb.TimeRangeBoundary.infinite(), rrb.TimeRangeBoundary.cursor_relative()
    ranges = rrb.VisibleTimeRanges(
        [rrb.VisibleTimeRange(line, start=start, end=cursor) for line in (FRAME, TIME)]
    )
    position, target = eye
    return rrb.Spatial3DView(
        origin=origin,
        contents=contents,
        name=name,
        eye_controls=rrb.EyeControls3D(position=position, look_target=target, eye_up=[0, 0, 1]),
        line_grid=False,
        overrides={f"{robot}/path": ranges for robot in robots},
    )


def _stack_plots(
    name: str,
    plots: Sequence[Plot],
    extremes: Mapping[str, Range],
    duration_s: float,
    n_robots: int,
    suffix: str = "",
) -> rrb.Vertical:
    """Return plots above each other; the first has the legend and the height that it needs.

    Args:
        name: Name of the tab.
        plots: Plots from top to bottom.
        extremes: Smallest and largest value of some plots, by path.
        duration_s: Duration of the run, s.
        n_robots: Number of robots in each plot.
        suffix: End of the plots' entities: a slash and a robot's name, or empty for all robots.
    """
    start = rr.TimeRangeBoundary.absolute(seconds=0.0)
    end = rr.TimeRangeBoundary.absolute(seconds=(1 + LEGEND_FRACTION) * duration_s)
    n_lines = n_robots * len(plots[0].lines)
    heights = [max(1.0, n_lines / LEGEND_LINES), *[1.0] * (len(plots) - 1)]
    views = []
    for i, (plot, height) in enumerate(zip(plots, heights, strict=True)):
        axis_range = plot.range
        if plot.path in extremes and not axis_range:
            axis_range = _choose_range(
                *extremes[plot.path], TAB_PX * height / sum(heights) - TITLE_PX
            )
        views.append(
            rrb.TimeSeriesView(
                origin=f"plots/{plot.path}{suffix}",
                name=plot.title,
                axis_x=rrb.TimeAxis(view_range=rr.TimeRange(start, end)),
                axis_y=rrb.ScalarAxis(range=axis_range),
                plot_legend=rrb.PlotLegend(corner="RightTop", visible=not i),
            )
        )
    return rrb.Vertical(*views, name=name, row_shares=heights)


def _choose_range(low: float, high: float, height_px: float) -> Range | None:
    """Return limits of an axis on which two ticks have labels; None if those of the data suffice.

    The viewer labels multiples of the smallest power of ten for which there is room.

    Args:
        low: Smallest value.
        high: Largest value.
        height_px: Height of the plot.
    """
    if not low < high:
        return None
    step = 10.0 ** np.ceil(np.log10((high - low) * LABEL_PX / height_px))
    low_tick, high_tick = np.floor(low / step) - LABEL_MARGIN, np.ceil(high / step) + LABEL_MARGIN
    has_labels = np.ceil(low / step) < np.floor(high / step)
    if has_labels or (high_tick - low_tick) * step > MAX_STRETCH * (high - low):
        return None
    return low_tick * step, high_tick * step
