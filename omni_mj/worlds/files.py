"""Where the models are: MJCF files by name, or anywhere else by path."""

from pathlib import Path

from omni_control.errors import OmniError, choose

ROBOT, SCENE = "ssl_robot", "scene"


def folder() -> Path:
    """The folder of models: beside the package in a checkout, inside it in an installed wheel."""
    package = Path(__file__).parents[1]
    for place in (package.parent / "models", package / "models"):
        if (place / f"{ROBOT}.xml").is_file():
            return place
    raise OmniError(f"models/{ROBOT}.xml is missing from this installation of omni-mj; install it again")


def path(model: str) -> Path:
    """Path of an MJCF file.

    Args:
        model: a name, such as "ssl_robot", of a file in the folder of models, or a path that ends in .xml.

    Raises:
        OmniError: there is no such file.
    """
    if model.endswith(".xml"):
        if not (given := Path(model)).is_file():
            raise OmniError(f"there is no model {model}")
        return given.resolve()
    if not (named := folder() / f"{model}.xml").is_file():
        names = sorted(file.stem for file in folder().glob("*.xml"))
        raise OmniError(f"there is no model {model!r}: {choose(model, names)}, or give a path to an .xml file")
    return named
