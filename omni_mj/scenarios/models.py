"""Where the models are: robots and scenes in MJCF, by name or anywhere else by path."""

from pathlib import Path

from omni_control.errors import OmniError, choose

DEFAULT = "ssl_robot"
SCENE = "scene"
_NO_ROBOTS = (SCENE, "ssl_robot_on_carpet")  # models that a robot stands in


def folder() -> Path:
    """The folder of models: beside the package in a checkout, inside it in an installed wheel.

    Raises:
        OmniError: there is none.
    """
    package = Path(__file__).parents[1]
    for found in (package.parent / "models", package / "models"):
        if (found / f"{DEFAULT}.xml").is_file():
            return found
    raise OmniError(f"models/{DEFAULT}.xml is missing from this installation of omni-mj; install it again")


def names() -> list[str]:
    """The robots that come with the package."""
    return sorted(path.stem for path in folder().glob("*.xml") if path.stem not in _NO_ROBOTS)


def model_path(robot: str) -> Path:
    """The MJCF of a robot, given its name in the folder of models or the path of an .xml file.

    Raises:
        OmniError: there is no such robot or file.
    """
    if robot.endswith(".xml"):
        if not (path := Path(robot)).is_file():
            raise OmniError(f"there is no robot's model {path}")
        return path
    if robot not in names():
        raise OmniError(f"unknown robot {robot!r}; {choose(robot, names())}, or a model of yours: file.xml")
    return folder() / f"{robot}.xml"


def scene_path(scene: str) -> Path:
    """The MJCF of a scene, given its name in the folder of models or the path of an .xml file.

    Raises:
        OmniError: there is no such scene or file.
    """
    path = Path(scene) if scene.endswith(".xml") else folder() / f"{scene}.xml"
    if not path.is_file():
        raise OmniError(f"there is no scene {scene!r}; {choose(scene, [SCENE])}, or a model of yours: file.xml")
    return path
