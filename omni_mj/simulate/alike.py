"""Which rows can share a simulation."""

from collections.abc import Hashable

from omni_mj.scenarios.scenario import Scenario
from omni_mj.scenarios.settings import Settings
from omni_mj.worlds.shape import Shape

_OF_MODEL = {"body", "wheels", "motor", "model", "physics"}  # sections that a key of `mujoco` looks into


def alike(plant: str, settings: Settings) -> Hashable:
    """A key; rows of a plant with equal keys can be simulated together: on `mujoco`, those of one model and physics."""
    places = len(settings.world.places)
    return (Shape.of(settings), settings.physics, places) if plant == "mujoco" else places


def all_alike(scenario: Scenario) -> bool:
    """Whether all seeds of a scenario can be simulated together, whatever they draw."""
    return scenario.plant != "mujoco" or not any(name.split(".")[0] in _OF_MODEL for name in scenario.distributions)
