"""The robots that figures and recordings show, and what both compute of what was recorded."""

from dataclasses import dataclass

import numpy as np

from omni_control.kinematics import Array, wrap_angle
from omni_mj.config.settings import Settings
from omni_mj.results.metrics import ALPHA_WINDOW_FRAMES, driven_alpha
from omni_mj.simulation.log import CHANNEL_PREFIX, Log
from omni_mj.viz import style

PALER, PALEST = 0.35, 0.7  # share of white per robot of one controller, and at most
ALPHA_RANGE = (0.4, 1.3)  # of axes that show alpha
# Channel of a controller's own, standard deviation of its estimate
SIGMA = CHANNEL_PREFIX + "alpha_sigma"


@dataclass(frozen=True)
class RecordedRobot:
    """A robot that is shown, and what was recorded of it.

    Args:
        log: Log of the run.
        row: Its row in the log.
        order: Its number among the robots shown.
        name: Its controller's, and its place if that drives several robots in a world.
        slot: Its controller's in `style`.
        colour: Its controller's, paler from place to place.
        first: Frame from which its channels are returned.
    """

    log: Log
    row: int
    order: int
    name: str
    slot: int
    colour: style.Rgb
    first: int = 0

    @property
    def settings(self) -> Settings:
        """Its own settings."""
        return self.log.rows[self.row].settings

    @property
    def length(self) -> int:
        """Number of frames recorded."""
        return int(self.log.lengths[self.row])

    def __getitem__(self, channel: str) -> Array:
        """Return a channel, (frames, columns)."""
        return self.log.channel(channel)[self.first : self.length, self.row]

    def error(self) -> Array:
        """Return pose less reference, (frames, 3) cm, cm, deg."""
        error = self["pose"] - self["ref"]
        return np.column_stack([100 * error[:, :2], np.rad2deg(wrap_angle(error[:, 2]))])

    def alpha(self, axis: int) -> Array:
        """Return what is known of alpha along x or y, NaN where nothing is.

        Returns:
            Displacement achieved over commanded in the window that ends in each frame, the
            controller's estimate less and plus two standard deviations, and the estimate; (frames,
            4).
        """
        estimate = self["alpha_hat"][:, axis, None]
        estimate = np.where(
            estimate == 1, np.nan, estimate
        )  # exactly 1: nothing is estimated, or nothing yet
        sigma = self[SIGMA][:, axis, None] if SIGMA in self.log.columns else np.nan
        ratio = np.full_like(estimate, np.nan)
        if len(ratio) > ALPHA_WINDOW_FRAMES:
            ratio[ALPHA_WINDOW_FRAMES:, 0] = driven_alpha(
                self["pose"][:, axis], self["applied"][:, axis]
            )
        return np.hstack([ratio, estimate - 2 * sigma, estimate + 2 * sigma, estimate])


def select_robots(log: Log, places: int | None = None) -> list[RecordedRobot]:
    """Return the robots of each controller's first world, or as many of them, controller by controller."""
    robots: list[RecordedRobot] = []
    for controller, slot in style.style_indices(row.controller for row in log.rows).items():
        world = log.rows[log.first(controller)].world
        together = [row for row in log.of(controller).tolist() if log.rows[row].world == world][
            :places
        ]
        for k, row in enumerate(together):
            name = controller if len(together) == 1 else f"{controller}/{log.rows[row].slot}"
            colour = style.mix_with_white(style.rgb(style.colour(slot)), min(k * PALER, PALEST))
            robots.append(RecordedRobot(log, row, len(robots), name, slot, colour))
    return robots
