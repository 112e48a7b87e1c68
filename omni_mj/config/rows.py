"""Rows of a simulation: one robot each, with its world, controller, seed and settings."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass

from omni_mj.config.faults import Fault
from omni_mj.config.settings import Settings


@dataclass(frozen=True)
class Row:
    """One simulated robot, and so one index of all arrays of shape (n, ...).

    Attributes:
        world_index: Index of its world. Robots of one world interact. Their rows are consecutive.
        slot: Index of the robot in its world.
        controller: Label of its controller.
        seed: Seed of the world's random numbers.
        settings: Settings of the robot.
        robot: Name or file of the robot.
    """

    world_index: int
    slot: int
    controller: str
    seed: int
    settings: Settings
    robot: str

    @property
    def noise_seed(self) -> tuple[int, ...]:
        """Seed of the robot's noise: the world's seed, with the slot unless it is 0.

        So robots of a world have different noise, and the first one has that of a robot alone.
        """
        return (self.seed, self.slot) if self.slot else (self.seed,)

    @property
    def faults(self) -> tuple[Fault, ...]:
        """Faults that affect the robot."""
        return tuple(fault for fault in self.settings.fault if fault.affects(self.slot))

    @property
    def start_pose(self) -> tuple[float, float, float]:
        """Offset [x, y, heading], m and rad, applied to its reference and its initial pose."""
        return self.settings.world.start_poses[self.slot]


def build_single_robot_rows(runs: Iterable[tuple[str, int, Settings]], robot: str) -> list[Row]:
    """Return a row for each run, alone in its world.

    Args:
        runs: Label of the controller, seed and settings of each run.
        robot: Name or file of the robot.
    """
    return [Row(i, 0, *run, robot) for i, run in enumerate(runs)]


def build_rows(
    controllers: Iterable[str],
    seeds: Iterable[int],
    settings_for_seed: Callable[[int], Settings],
    robot: str,
) -> list[Row]:
    """Return a row for each controller, seed and slot of a world, in this order.

    Args:
        controllers: Labels of the controllers.
        seeds: Seeds of the random numbers.
        settings_for_seed: Function from a seed to the settings of its rows.
        robot: Name or file of the robot.
    """
    settings_by_seed = {seed: settings_for_seed(seed) for seed in seeds}
    worlds = [(controller, seed) for controller in controllers for seed in settings_by_seed]
    rows = []
    for world_index, (controller, seed) in enumerate(worlds):
        settings = settings_by_seed[seed]
        for slot in range(len(settings.world.start_poses)):
            rows.append(Row(world_index, slot, controller, seed, settings, robot))
    return rows
