"""Layout of a recording in the viewer: the scene from the field and from beside a robot, time series, texts."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from omni_control.kinematics import Array
from omni_mj.scenarios.settings import PERIOD_S
from omni_mj.show.recording.plots import SINGLE, Plot
from omni_mj.show.recording.scene import ABOVE, extent, pixel
from omni_mj.show.recording.sink import FRAME, TIME

LEGEND_LINES = 3  # that the legend of a plot has room for; with more, the plot is higher
LEGEND_SHARE = 0.4  # of a run's time, left free on the right for the legend
FIELD = "field (ring: seen by vision; ghost: predicted; dot: reference)"
Ranges = dict[Any, rrb.VisibleTimeRanges]


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
    # Paths are shown from the start to the time cursor, everything else at the cursor.
    start, now = rrb.TimeRangeBoundary.infinite(), rrb.TimeRangeBoundary.cursor_relative()
    ranges = rrb.VisibleTimeRanges([rrb.VisibleTimeRange(line, start=start, end=now) for line in (FRAME, TIME)])
    so_far: Ranges = {f"world/{name}/path": ranges for name in names}
    second = min(1, len(names) - 1)  # where there is room for one robot, not the one that others are compared with
    columns = rrb.TextLogColumns(timeline_columns=[FRAME], text_log_columns=["LogLevel", "Body"])
    left = rrb.Vertical(
        _field(paths, so_far),
        rrb.Horizontal(
            _plan(names, paths, so_far), rrb.Tabs(*(_close_up(n, ranges) for n in names), active_tab=second)
        ),
        rrb.Tabs(
            rrb.TextDocumentView(origin="summary", name="summary"),
            rrb.TextLogView(origin="events", name="events", columns=columns),
            rrb.TextDocumentView(origin="settings", name="settings"),
        ),
        row_shares=[5, 4, 2.3],
    )
    seconds = PERIOD_S * max(len(path) for path in paths)
    right: list[rrb.Container] = []
    for tab, plots in tabs.items():
        if plots and tab in SINGLE:
            single = (_stack(name, plots, seconds, 1, f"/{name}") for name in names)
            right.append(rrb.Tabs(*single, name=tab, active_tab=second))
        elif plots:
            right.append(_stack(tab, plots, seconds, len(names)))
    time = rrb.TimePanel(timeline=TIME, play_state="following" if live else "paused", state="collapsed")
    return rrb.Blueprint(rrb.Horizontal(left, rrb.Tabs(*right), column_shares=[1, 1]), time, collapse_panels=True)


def _field(paths: Sequence[Array], overrides: Ranges) -> rrb.Spatial3DView:
    low, high = extent(paths)
    centre, reach = (low + high) / 2, float(np.hypot(*(high - low)))
    back = max(0.6 * reach, (high[1] - low[1]) / 2 + 0.28 * reach)  # behind the names, which lie at the front
    target = [centre[0], centre[1] - 0.07 * reach, 0.0]
    position = [centre[0], centre[1] - back, 0.42 * reach]
    return rrb.Spatial3DView(
        origin="world",
        contents=["$origin/**", f"- {ABOVE}/**"],
        name=FIELD,
        eye_controls=rrb.EyeControls3D(position=position, look_target=target, eye_up=[0, 0, 1]),
        line_grid=False,
        overrides=overrides,
    )


def _plan(names: Sequence[str], paths: Sequence[Array], overrides: Ranges) -> rrb.Spatial2DView:
    low, high = extent(paths)
    (left, bottom), (right, top) = pixel(*low), pixel(*high)
    return rrb.Spatial2DView(
        origin=ABOVE,
        contents=["world/**", *(f"- world/{name}/name" for name in names)],
        name="plan",
        visual_bounds=rrb.VisualBounds2D(x_range=[left, right], y_range=[top, bottom]),
        overrides=overrides,
    )


def _close_up(name: str, ranges: rrb.VisibleTimeRanges) -> rrb.Spatial3DView:
    """Return a view from beside a robot, close enough to see its rollers; it turns with the robot."""
    entity = f"world/{name}"
    return rrb.Spatial3DView(
        origin=f"{entity}/robot",
        contents=["world/field/**", "world/reference/**", f"{entity}/**", f"- {entity}/name"],
        name=name,
        eye_controls=rrb.EyeControls3D(position=[0.22, 0.25, 0.09], look_target=[0, 0, 0.055], eye_up=[0, 0, 1]),
        line_grid=False,
        overrides={f"{entity}/path": ranges},
    )


def _stack(name: str, plots: Sequence[Plot], seconds: float, robots: int, below: str = "") -> rrb.Vertical:
    """Return plots above each other; the first, which has the legend, is as high as that needs."""
    start, end = (rr.TimeRangeBoundary.absolute(seconds=at) for at in (0.0, (1 + LEGEND_SHARE) * seconds))
    lines = robots * sum(len(series.lines) for series in plots[0].series)
    views = [
        rrb.TimeSeriesView(
            origin=f"plots/{plot.entity}{below}",
            name=f"{plot.title}, {plot.unit}".removesuffix(", "),
            axis_x=rrb.TimeAxis(view_range=rr.TimeRange(start, end)),
            axis_y=rrb.ScalarAxis(range=plot.range) if plot.range else None,
            plot_legend=rrb.PlotLegend(corner="RightTop", visible=not i),
        )
        for i, plot in enumerate(plots)
    ]
    return rrb.Vertical(*views, name=name, row_shares=[max(1.0, lines / LEGEND_LINES), *[1.0] * (len(plots) - 1)])
