"""`omni-mj new`: files to begin with. In the texts in starters/, NAME and CLASS stand for what they are called."""

import os
import re
from pathlib import Path

import click

from omni_control.errors import OmniError
from omni_mj.cli import options
from omni_mj.files import write

ENDINGS = {"scenario": ".toml", "controller": ".py", "robot": ".toml"}
STARTERS = Path(__file__).parent / "starters"


@click.command("new")
@click.argument("kind", type=click.Choice(list(ENDINGS)))
@click.argument("name")
@click.option("--overwrite", is_flag=True, help="Replace a file of that name.")
@options.QUIET
def command(kind: str, name: str, overwrite: bool, quiet: bool) -> None:
    """Write a file to begin with: NAME.toml, a scenario or a robot, or NAME.py, a controller.

    It says in comments what can be changed, and runs as it is.
    """
    path = Path(name if name.endswith(ENDINGS[kind]) else name + ENDINGS[kind])
    if not re.fullmatch(r"[A-Za-z][\w-]*", path.stem, re.ASCII):
        raise OmniError(f"the name of a {kind} must be a letter and then letters, digits, _ or -, unlike {path.stem!r}")
    if os.path.exists(path) and not overwrite:
        raise OmniError(f"there is a file {path}; give another name, or --overwrite to replace it")
    if not os.path.isdir(path.parent):
        raise OmniError(f"there is no folder {path.parent} for {path.name}")
    called = "".join(word[:1].upper() + word[1:] for word in re.split(r"[_-]", path.stem))
    try:
        write(path, _starter(kind).replace("CLASS", called).replace("NAME", path.stem))
    except OSError as error:
        raise OmniError(f"cannot write {path}: {error.strerror}") from None
    if not quiet:
        drive = {
            "scenario": f"--scenario {path}",
            "controller": f"--scenario rect --controller comp-flc --controller {path}:{called}",
            "robot": f"--scenario rect --robot {path}",
        }
        print(f"wrote {path}; drive it: omni-mj run {drive[kind]}")


def _starter(kind: str) -> str:
    """The text of the file; a robot's has the numbers of the default robot, with what they are."""
    text = (STARTERS / f"{kind}.txt").read_text(encoding="utf-8")
    if kind != "robot":
        return text
    from omni_mj.scenarios import robots
    from omni_mj.scenarios.resolve import resolve
    from omni_mj.show import listing

    must = robots.sections(robots.DEFAULT)
    return text + listing.sections(resolve({}, robots.DEFAULT), must)
