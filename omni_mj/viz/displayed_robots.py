"""Robots that figures, recordings and pages show, with quantities computed from the log."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from omni_control.kinematics import Array, wrap_angle
from omni_mj.config.rows import Row
from omni_mj.config.settings import Settings
from omni_mj.results.alpha_windows import ALPHA_WINDOW_FRAMES, driven_alpha
from omni_mj.simulation.log import CHANNEL_PREFIX, Log
from omni_mj.viz import style

WHITE_STEP, MAX_WHITE = 0.35, 0.7  # fraction of white per robot of one controller, and at most
ALPHA_RANGE = (0.4, 1.3)  # of axes that show alpha
# Channel of a controller: standard deviation of its estimate of alpha.
SIGMA_CHANNEL = CHANNEL_PREFIX + "alpha_sigma"


@dataclass(frozen=True)
class RecordedRobot:
    """A robot of a figure or recording, with its part of the log.

    Attributes:
        log: Log of the run.
        row: Row of the robot in the log.
        layer: Index of the robot's controller among those of the run.
        name: Name of the controller, with the robot's slot if the controller drives several robots.
        style_index: Index of the controller's colors and markers in `style`.
        color: Color of the controller, paler for each further robot of its world.
        first_frame: First frame of the channels that are returned.
    """

    log: Log
    row: int
    layer: int
    name: str
    style_index: int
    color: style.Rgb
    first_frame: int = 0

    @property
    def settings(self) -> Settings:
        """Settings of the robot's row."""
        return self.log.rows[self.row].settings

    @property
    def length(self) -> int:
        """Number of recorded frames."""
        return int(self.log.lengths[self.row])

    def __getitem__(self, channel: str) -> Array:
        """Return a channel of the log from the first frame on, (frames, columns)."""
        return self.log.channel_of_row(channel, self.row, self.first_frame)

    def pose_error(self) -> Array:
        """Return true pose minus reference, (frames, 3) cm, cm, deg."""
        error = self["pose"] - self["ref"]
        return np.column_stack([100 * error[:, :2], np.rad2deg(wrap_angle(error[:, 2]))])

    def position_error(self) -> Array:
        """Return the distance of the true position from the reference, (frames,) cm."""
        return np.linalg.norm(self.pose_error()[:, :2], axis=1)

    def alpha(self, axis: int) -> Array:
        """Return the motor correction factor along one axis, (frames, 4), NaN where unknown.

        The columns are: displacement achieved divided by displacement commanded in the window
        that ends in each frame; the controller's estimate minus and plus two standard deviations;
        the estimate.

        Args:
            axis: 0 for x, 1 for y.
        """
        estimate = self["alpha_hat"][:, axis]
        # The value 1 is the default of controllers that estimate nothing, or nothing yet.
        estimate = np.where(estimate == 1, np.nan, estimate)
        has_sigma = SIGMA_CHANNEL in self.log.columns
        sigma = self[SIGMA_CHANNEL][:, axis] if has_sigma else np.nan
        ratio = np.full_like(estimate, np.nan)
        if len(ratio) > ALPHA_WINDOW_FRAMES:
            position, command = self["pose"][:, axis], self["applied"][:, axis]
            ratio[ALPHA_WINDOW_FRAMES:] = driven_alpha(position, command)
        return np.column_stack([ratio, estimate - 2 * sigma, estimate + 2 * sigma, estimate])


def select_robots(log: Log, max_per_world: int | None = None) -> list[RecordedRobot]:
    """Return the robots of each controller's first world.

    Args:
        log: Log of the run.
        max_per_world: Number of robots per controller. Default: all.
    """
    indices = style.style_indices(row.controller for row in log.rows)
    chosen = []
    for controller in indices:
        rows = log.rows_of(controller).tolist()
        world = log.rows[rows[0]].world_index
        chosen += [row for row in rows if log.rows[row].world_index == world][:max_per_world]
    controllers = [log.rows[row].controller for row in chosen]
    names_and_colors = name_and_color([log.rows[row] for row in chosen])
    return [
        RecordedRobot(log, row, list(indices).index(controller), name, indices[controller], color)
        for row, controller, (name, color) in zip(
            chosen, controllers, names_and_colors, strict=True
        )
    ]


def name_and_color(rows: Sequence[Row]) -> list[tuple[str, style.Rgb]]:
    """Return name and color of the robots of some rows, one world per controller.

    See `RecordedRobot`.
    """
    indices = style.style_indices(row.controller for row in rows)
    n_robots = Counter(row.controller for row in rows)
    names_and_colors = []
    for row in rows:
        is_alone = n_robots[row.controller] == 1
        color = style.rgb(style.color(indices[row.controller]))
        color = style.mix_with_white(color, min(row.slot * WHITE_STEP, MAX_WHITE))
        name = row.controller if is_alone else f"{row.controller}/{row.slot}"
        names_and_colors.append((name, color))
    return names_and_colors
