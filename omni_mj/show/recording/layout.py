"""How the viewer lays out a recording: the scene, from the field and from beside a robot, time series, texts."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from omni_control.kinematics import Array
from omni_mj.scenarios.settings import PERIOD_S
from omni_mj.show.recording.scene import ABOVE, extent, pixel
from omni_mj.show.recording.series import Plot
from omni_mj.show.recording.tabs import EACH
from omni_mj.show.recording.timelines import FRAME, TIME

LEGEND_LINES = 3  # for which the legend of a plot has room; with more, the first of a tab has one, and is higher
LEGEND_SHARE = 0.4  # of a run's time, left free beside it for the legend


def blueprint(
    names: Sequence[str], paths: Sequence[Array], tabs: Mapping[str, Sequence[Plot]], live: bool
) -> rrb.Blueprint:
    """Build the layout.

    Args:
        names: of the robots.
        paths: the references that they follow, each (frames, 3).
        tabs: the plots under each tab.
        live: follow what is being recorded, instead of waiting at its start.
    """
    low, high = extent(paths)
    so_far = _so_far(names)
    close = rrb.Tabs(*(_beside(name, so_far) for name in names), active_tab=_second(names))
    left = rrb.Vertical(
        _field(low, high, so_far),
        rrb.Horizontal(_plan(names, low, high, so_far), close),
        rrb.Tabs(
            rrb.TextDocumentView(origin="summary", name="summary"),
            rrb.TextLogView(
                origin="events",
                name="events",
                columns=rrb.TextLogColumns(timeline_columns=[FRAME], text_log_columns=["LogLevel", "Body"]),
            ),
            rrb.TextDocumentView(origin="settings", name="settings"),
        ),
        row_shares=[5, 4, 2.3],
    )
    seconds = PERIOD_S * max(len(path) for path in paths)
    right = rrb.Tabs(*(_plots(name, plots, names, seconds) for name, plots in tabs.items() if plots))
    time = rrb.TimePanel(timeline=TIME, play_state="following" if live else "paused", state="collapsed")
    return rrb.Blueprint(rrb.Horizontal(left, right, column_shares=[1, 1]), time, collapse_panels=True)


def _so_far(names: Sequence[str]) -> dict[Any, rrb.VisibleTimeRanges]:
    """Travelled paths are shown from the start to the time cursor, everything else at the time cursor."""
    start, now = rrb.TimeRangeBoundary.infinite(), rrb.TimeRangeBoundary.cursor_relative()
    ranges = rrb.VisibleTimeRanges([rrb.VisibleTimeRange(line, start=start, end=now) for line in (FRAME, TIME)])
    return {f"world/{name}/path": ranges for name in names}


def _field(low: Array, high: Array, overrides: dict[Any, rrb.VisibleTimeRanges]) -> rrb.Spatial3DView:
    centre, reach = (low + high) / 2, float(np.hypot(*(high - low)))
    back = max(0.6 * reach, (high[1] - low[1]) / 2 + 0.28 * reach)  # behind the names, which lie at the front
    target = [centre[0], centre[1] - 0.07 * reach, 0.0]
    position = [centre[0], centre[1] - back, 0.42 * reach]
    eye = rrb.EyeControls3D(position=position, look_target=target, eye_up=[0, 0, 1])
    return rrb.Spatial3DView(
        origin="world",
        contents=["$origin/**", f"- {ABOVE}/**"],
        name="field (ring: seen by vision; ghost: predicted; dot: reference)",
        eye_controls=eye,
        line_grid=False,
        overrides=overrides,
    )


def _plan(
    names: Sequence[str], low: Array, high: Array, overrides: dict[Any, rrb.VisibleTimeRanges]
) -> rrb.Spatial2DView:
    (left, bottom), (right, top) = pixel(*low), pixel(*high)
    return rrb.Spatial2DView(
        origin=ABOVE,
        contents=["world/**", *(f"- world/{name}/name" for name in names)],
        name="plan",
        visual_bounds=rrb.VisualBounds2D(x_range=[left, right], y_range=[top, bottom]),
        overrides=overrides,
    )


def _beside(name: str, overrides: dict[Any, rrb.VisibleTimeRanges]) -> rrb.Spatial3DView:
    """A robot from beside it, close enough to see its rollers; the view turns with it."""
    entity = f"world/{name}"
    return rrb.Spatial3DView(
        origin=f"{entity}/robot",
        contents=["world/field/**", "world/reference/**", f"{entity}/**", f"- {entity}/name"],
        name=name,
        eye_controls=rrb.EyeControls3D(position=[0.22, 0.25, 0.09], look_target=[0, 0, 0.055], eye_up=[0, 0, 1]),
        line_grid=False,
        overrides={path: ranges for path, ranges in overrides.items() if str(path).startswith(f"{entity}/")},
    )


def _plots(tab: str, plots: Sequence[Plot], names: Sequence[str], seconds: float) -> rrb.Container:
    if tab not in EACH:
        lines = [len(names) * sum(len(series.lines) for series in plot.series) for plot in plots]
        together = [
            _plot(plot, f"plots/{plot.entity}", seconds, not i or count <= LEGEND_LINES)
            for i, (plot, count) in enumerate(zip(plots, lines, strict=True))
        ]
        shares = [max(1.0, lines[0] / LEGEND_LINES), *[1.0] * (len(plots) - 1)]
        return rrb.Vertical(*together, name=tab, row_shares=shares)
    single = (
        rrb.Vertical(*(_plot(plot, f"plots/{plot.entity}/{name}", seconds) for plot in plots), name=name)
        for name in names
    )
    return rrb.Tabs(*single, name=tab, active_tab=_second(names))


def _second(names: Sequence[str]) -> int:
    """Which robot is shown where there is room for one: not the first, with which others are compared."""
    return min(1, len(names) - 1)


def _plot(plot: Plot, origin: str, seconds: float, tell: bool = True) -> rrb.TimeSeriesView:
    """A plot over a run of so many seconds, and beyond, where its legend hides nothing; or none if not to `tell`."""
    start, end = (rr.TimeRangeBoundary.absolute(seconds=at) for at in (0.0, (1 + LEGEND_SHARE) * seconds))
    return rrb.TimeSeriesView(
        origin=origin,
        name=f"{plot.title}, {plot.unit}".removesuffix(", "),
        axis_x=rrb.TimeAxis(view_range=rr.TimeRange(start, end)),
        axis_y=rrb.ScalarAxis(range=plot.range) if plot.range else None,
        plot_legend=rrb.PlotLegend(corner=plot.legend, visible=tell),
    )
