"""Where the models are: the robot's and the scene's MJCF."""

from pathlib import Path

from omni_control.errors import OmniError, choose

ROBOT = "ssl_robot"
SCENE = "field"


def folder() -> Path:
    """The folder of models: beside the package in a checkout, inside it in an installed wheel.

    Raises:
        OmniError: there is none.
    """
    package = Path(__file__).parents[1]
    for found in (package.parent / "models", package / "models"):
        if (found / f"{ROBOT}.xml").is_file():
            return found
    raise OmniError(f"models/{ROBOT}.xml is missing from this installation of omni-mj; install it again")


def robot_path() -> Path:
    """The MJCF of a robot's shape."""
    return folder() / f"{ROBOT}.xml"


def scene_path(scene: str) -> Path:
    """The MJCF of a scene, given its name in the folder of models or the path of an .xml file.

    Raises:
        OmniError: there is no such scene or file.
    """
    path = Path(scene) if scene.endswith(".xml") else folder() / f"{scene}.xml"
    if not path.is_file():
        raise OmniError(f"there is no scene {scene!r}; {choose(scene, [SCENE])}, or a model of yours: file.xml")
    return path
