"""Live plots of the page: errors, commands, alpha, temperatures, and estimates beside the truth."""

from typing import TYPE_CHECKING, Any

import numpy as np

from omni_control.kinematics import Array
from omni_mj.config import FRAME_RATE_HZ
from omni_mj.viz.displayed_robots import ALPHA_RANGE

if TYPE_CHECKING:
    import viser

    from omni_mj.play.play_session import PlaySession, Snapshot

WINDOW_S = 10.0
STRIDE = 3  # frames between points
HEIGHT_PX = 124
DOT_STRIDE = 4  # points between dots
# Title -> range of the vertical axis (None: that of the data), and whether each robot has dots for
# the truth. A line would join points across unknown values.
PLOTS: dict[str, tuple[tuple[float, float] | None, bool]] = {
    "Position error, cm": (None, False),
    "Commanded speed, m/s": (None, False),
    "Alpha forward: estimate, true (dots)": (ALPHA_RANGE, True),
    "Latency, ms: estimate; dead time (dots)": ((0.0, 350.0), True),
    "Hottest winding, °C": (None, False),
}


class LivePlots:
    """Plots of the last 10 s, in a panel of their own.

    Args:
        gui: GUI of the page.
        session: Session with n robots.

    Attributes:
        handles: The plots.
    """

    def __init__(self, gui: "viser.GuiApi", session: "PlaySession") -> None:
        self._session, self._n = session, len(session.labels)
        self._times = np.empty(0)
        self._values = np.empty(
            (0, sum(1 + has_truth for _, has_truth in PLOTS.values()) * self._n)
        )
        self.handles = [self._add_plot(gui, title, *options) for title, options in PLOTS.items()]

    def add(self, snapshot: "Snapshot") -> None:
        """Store the values of a frame."""
        if self._times.size and snapshot.time_s <= self._times[-1]:
            self._times, self._values = self._times[:0], self._values[:0]  # a restart
        frame = round(snapshot.time_s * FRAME_RATE_HZ)
        if frame % STRIDE:
            return
        is_dot = frame % (DOT_STRIDE * STRIDE) == 0
        unknown = np.full(self._n, np.nan)
        dead_time = [row.settings.radio.delay_frames for row in self._session.simulation.rows]
        values = [
            np.nan_to_num(100 * snapshot.error_m),  # without a target: NaN
            np.hypot(*snapshot.command.T[:2]),
            snapshot.alpha_hat[:, 0],
            self._session.compute_alpha()[:, 0] if is_dot else unknown,
            snapshot.latency_hat * 1000 / FRAME_RATE_HZ,
            np.multiply(dead_time, 1000 / FRAME_RATE_HZ) if is_dot else unknown,
            np.nan_to_num(snapshot.winding_c),
        ]
        n_points = round(WINDOW_S * FRAME_RATE_HZ / STRIDE)
        self._times = np.append(self._times, snapshot.time_s)[-n_points:]
        self._values = np.vstack([self._values, np.concatenate(values)])[-n_points:]

    def send(self) -> None:
        """Show the stored values on the page."""
        if len(self._times) < 2:
            return
        column = 0
        for handle in self.handles:
            n_lines = len(handle.series) - 1
            lines = self._values[:, column : column + n_lines].T
            # uPlot fails to draw axes whose ticks differ by less than 1e-6.
            handle.data = (self._times, *np.ascontiguousarray(lines.round(3)))
            column += n_lines

    def rms_error_cm(self) -> Array:
        """Return the root mean square of the position error in the window, (n,) cm."""
        errors = self._values[:, : self._n]
        return np.sqrt(np.mean(errors**2, axis=0)) if len(errors) else np.full(self._n, np.nan)

    def _add_plot(
        self,
        gui: "viser.GuiApi",
        title: str,
        y_range: tuple[float, float] | None,
        has_truth: bool,
    ) -> "viser.GuiUplotHandle":
        """Add an empty plot with a line per robot, and with dots for the truth."""
        series: list[Any] = [{"label": "time, s"}]
        for is_truth in (False, True)[: 1 + has_truth]:
            series += [
                {
                    "label": label,
                    "stroke": f"rgb{color}",
                    "width": 0 if is_truth else 1.5,
                    "points": {"show": is_truth, "size": 3, "fill": f"rgb{color}", "width": 0},
                }
                for label, color in zip(self._session.labels, self._session.colors, strict=True)
            ]
        data = tuple(np.array([0.0, 1.0]) for _ in series)
        return gui.add_uplot(
            data,
            tuple(series),
            title=title,
            scales={"x": {"time": False}, "y": {"range": y_range} if y_range else {}},
            axes=({"size": 24}, {"size": 42}),
            legend={"show": False},
            height=HEIGHT_PX,
            padding=(8, 8, 0, 0),
        )
