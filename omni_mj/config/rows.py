"""The table of rows: what each robot of a simulation is, where it stands, who drives it, under which settings."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass

from omni_mj.config.faults import Fault, select_faults_of_robot
from omni_mj.config.settings import Settings


@dataclass(frozen=True)
class Row:
    """One robot.

    Args:
        world: Number of its world; rows of one world meet each other and are numbered one after the
            other.
        slot: Its number in that world.
        controller: Label of the controller that drives it.
        seed: Of its random numbers, and of its world.
        settings: Its own.
        robot: Which robot it is, by name or file.
    """

    world: int
    slot: int
    controller: str
    seed: int
    settings: Settings
    robot: str

    @property
    def noise_seed(self) -> tuple[int, ...]:
        """The seed of its random numbers: robots of one world do not share their noise."""
        return (self.seed, self.slot) if self.slot else (self.seed,)

    @property
    def faults(self) -> tuple[Fault, ...]:
        """The faults that happen to it."""
        return select_faults_of_robot(self.settings.fault, self.slot)

    @property
    def start_pose(self) -> tuple[float, float, float]:
        """Pose [x, y, heading] in m and rad by which its reference, and with it its start, is displaced."""
        return self.settings.world.start_poses[self.slot]


def build_rows(
    controllers: Iterable[str],
    seeds: Iterable[int],
    settings_of: Callable[[int], Settings],
    robot: str,
) -> list[Row]:
    """Return all seeds of one controller after those of the one before; a row for each slot of a world.

    Args:
        controllers: Labels.
        seeds: Of the random numbers.
        settings_of: A seed -> the settings of its rows.
        robot: Which it is, by name or file.
    """
    settings = {seed: settings_of(seed) for seed in seeds}
    worlds = [(controller, seed) for controller in controllers for seed in settings]
    return [
        Row(world, slot, controller, seed, settings[seed], robot)
        for world, (controller, seed) in enumerate(worlds)
        for slot in range(len(settings[seed].world.start_poses))
    ]
