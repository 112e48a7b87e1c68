"""`omni-mj new`: files to begin with. In the texts in starters/, NAME and CLASS stand for what they are called."""

import re
from pathlib import Path

import click

from omni_control.errors import OmniError
from omni_mj.files import write_text

ENDINGS = {"scenario": ".toml", "controller": ".py", "robot": ".toml"}
DRIVE = {
    "scenario": "--scenario {path}",
    "controller": "--scenario rect --controller comp-flc --controller {path}:{name}",
    "robot": "--scenario rect --robot {path}",
}


@click.command("new")
@click.argument("kind", type=click.Choice(list(ENDINGS)))
@click.argument("name")
@click.option("--overwrite", is_flag=True, help="Replace a file of that name.")
def command(kind: str, name: str, overwrite: bool) -> None:
    """Write a file to begin with: NAME.toml, a scenario or a robot, or NAME.py, a controller.

    It says in comments what can be changed, and runs as it is.
    """
    path = Path(name if name.endswith(ENDINGS[kind]) else name + ENDINGS[kind])
    if not re.fullmatch(r"[A-Za-z][\w-]*", path.stem, re.ASCII):
        raise OmniError(
            f"the name of a {kind} must be a letter and then letters, digits, _ or -, unlike {path.stem!r}"
        )
    if path.exists() and not overwrite:
        raise OmniError(f"there is a file {path}; give another name, or --overwrite to replace it")
    class_name = "".join(word[:1].upper() + word[1:] for word in re.split(r"[_-]", path.stem))
    text = (Path(__file__).parent / "starters" / f"{kind}.txt").read_text(encoding="utf-8")
    text = text.replace("CLASS", class_name).replace("NAME", path.stem)
    if kind == "robot":
        from omni_mj.cli import catalog
        from omni_mj.config import robot_files
        from omni_mj.config.resolve import resolve_settings

        text += catalog.format_sections(
            resolve_settings({}, robot_files.DEFAULT_ROBOT),
            robot_files.read_robot_sections(robot_files.DEFAULT_ROBOT),
        )
    try:
        write_text(path, text)
    except OSError as error:
        raise OmniError(f"cannot write {path}: {error.strerror}") from None
    print(f"wrote {path}; drive it: omni-mj run {DRIVE[kind].format(path=path, name=class_name)}")
