"""The plants by name; a plant is added by its file and one line here."""

from importlib import import_module
from typing import Any

from omni_control.errors import OmniError, choose
from omni_mj.scenarios import user_files

PLANTS: dict[str, str] = {
    "mujoco": "omni_mj.plants.mujoco:MujocoPlant",
    "planar": "omni_mj.plants.planar:PlanarPlant",
    "kinematic": "omni_mj.plants.kinematic:KinematicPlant",
    "live": "omni_mj.live.drive:LivePlant",
}
_CALLS = ("pose", "twist", "advance", "telemetry")  # that `omni_mj.plants.Plant` answers


def check_plant(name: str) -> None:
    """See that there is such a plant, without importing one that comes with the package.

    Raises:
        OmniError: there is none, or it is a class in a file that is no plant.
    """
    if name not in PLANTS:
        find_plant(name)


def find_plant(name: str) -> type[Any]:
    """The class of a plant, by its name or as `my_file.py:MyPlant`; what it answers is in `omni_mj.plants.Plant`.

    Raises:
        OmniError: there is none, or the class lacks one of the calls.
    """
    if name in PLANTS:
        module, _, class_name = PLANTS[name].partition(":")
        kind: type[Any] = getattr(import_module(module), class_name)
        return kind
    if not user_files.names_class(name):
        raise OmniError(f"unknown plant {name!r}; {choose(name, PLANTS)}, or a class of yours: file.py:Class")
    calls = ", ".join(f"{call}()" for call in _CALLS)
    return user_files.find(name, f"with {calls}", lambda kind: all(callable(getattr(kind, c, None)) for c in _CALLS))
