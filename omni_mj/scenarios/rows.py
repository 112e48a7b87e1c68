"""The table of rows: what each robot of a simulation is, where it stands, who drives it, under which settings."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass

from omni_mj.scenarios.faults import Fault, of_robot
from omni_mj.scenarios.settings import Settings


@dataclass(frozen=True)
class Row:
    """One robot.

    Args:
        world: number of its world; rows of one world meet each other and are numbered one after the other.
        place: its number in that world.
        controller: label of the controller that drives it.
        seed: of its random numbers, and of its world.
        settings: its own.
        robot: which robot it is, by name or file.
    """

    world: int
    place: int
    controller: str
    seed: int
    settings: Settings
    robot: str

    @property
    def noise_seed(self) -> tuple[int, ...]:
        """What its random numbers are drawn from: robots at different places of a world do not share their noise."""
        return (self.seed, self.place) if self.place else (self.seed,)

    @property
    def faults(self) -> tuple[Fault, ...]:
        """What happens to it."""
        return of_robot(self.settings.fault, self.place)

    @property
    def where(self) -> tuple[float, float, float]:
        """Pose [x, y, heading] in m and rad by which its reference, and with it its start, is displaced."""
        x, y, heading = self.settings.world.places[self.place]
        return x, y, heading


def table(
    controllers: Iterable[str], seeds: Iterable[int], settings_of: Callable[[int], Settings], robot: str
) -> list[Row]:
    """All seeds of one controller after those of the one before; in each world, as many robots as it has places.

    Args:
        controllers: labels.
        seeds: of the random numbers.
        settings_of: a seed -> the settings of its rows.
        robot: which it is, by name or file.
    """
    settings = {seed: settings_of(seed) for seed in seeds}
    worlds = [(controller, seed) for controller in controllers for seed in settings]
    return [
        Row(world, place, controller, seed, settings[seed], robot)
        for world, (controller, seed) in enumerate(worlds)
        for place in range(len(settings[seed].world.places))
    ]


def numbers(rows: Iterable[Row], of: Iterable[Row]) -> list[int]:
    """Which rows of a table are those `of` another, by controller, seed and place, which must be in it."""
    known = {(row.controller, row.seed, row.place): i for i, row in enumerate(rows)}
    return [known[row.controller, row.seed, row.place] for row in of]
