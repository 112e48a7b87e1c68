"""The table of rows: what each robot of a simulation is, where it stands, who drives it, under which settings."""

from dataclasses import dataclass

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
    """

    world: int
    place: int
    controller: str
    seed: int
    settings: Settings

    @property
    def noise_seed(self) -> tuple[int, ...]:
        """What its random numbers are drawn from: robots at different places of a world do not share their noise."""
        return (self.seed, self.place) if self.place else (self.seed,)
