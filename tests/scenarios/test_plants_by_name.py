"""Plants by name: those that come along, and a user's own from a file."""

from pathlib import Path

import pytest

from omni_control.errors import OmniError
from omni_mj.live.plant import LivePlant
from omni_mj.plants.kinematic import KinematicPlant
from omni_mj.plants.mujoco import MujocoPlant
from omni_mj.plants.planar import PlanarPlant
from omni_mj.scenarios import scenario
from omni_mj.scenarios.plants import PLANTS, find_plant

TOY = """
class Toy:
    def pose(self): ...
    def twist(self): ...
    def advance(self, received): ...
    def telemetry(self): ...

class Half:
    def pose(self): ...
"""


def test_every_registered_plant_is_found() -> None:
    assert {name: find_plant(name) for name in PLANTS} == {
        "mujoco": MujocoPlant,
        "planar": PlanarPlant,
        "kinematic": KinematicPlant,
        "live": LivePlant,
    }


def test_a_plant_of_a_users_own(tmp_path: Path) -> None:
    (tmp_path / "toy.py").write_text(TOY)
    name = f"{tmp_path / 'toy.py'}:Toy"
    assert find_plant(name).__name__ == "Toy"
    assert scenario.scenario("rect", plant=name).plant == name
    with pytest.raises(OmniError, match=r"no class 'Half' with pose\(\), twist\(\), advance\(\), telemetry\(\);.*Toy"):
        scenario.scenario("rect", plant=name.replace("Toy", "Half"))
