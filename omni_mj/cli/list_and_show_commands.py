"""`omni-mj list`, `show`, `schema`, `new`: what can be named, its contents, files to start from."""

import json
import re
import shlex
from pathlib import Path

import click

from omni_control.errors import OmniError, suggest_names
from omni_mj.cli import descriptions, options
from omni_mj.io.atomic_files import write_text

STARTER_FILES = {  # kind -> suffix, and arguments of omni-mj run that use the file
    "scenario": (".toml", "--scenario {path}"),
    "controller": (".py", "--scenario rect --controller comp-flc --controller {path}:{name}"),
    "robot": (".toml", "--scenario rect --robot {path}"),
}


@click.command("list")
@click.argument("title", required=False, metavar=f"[{'|'.join(descriptions.TITLES)}]")
@click.argument("word", required=False, metavar="[WORD]")
def list_command(title: str | None, word: str | None) -> None:
    """List scenarios, controllers, plants, robots, settings and faults.

    With WORD, only entries that contain it: omni-mj list settings friction prints the settings
    with friction in their name or meaning; omni-mj list friction searches all lists.
    """
    chosen = next((known for known in descriptions.TITLES if title in (known, known[:-1])), None)
    if chosen is None and word is not None:
        raise OmniError(f"there is no list {title!r}; {suggest_names(title, descriptions.TITLES)}")
    descriptions.print_lists(chosen, (word if chosen else title) or "")


@click.command("show")
@click.argument("name", metavar="NAME|FILE")
@options.ROBOT
@options.SETTINGS
def show_command(name: str, robot: str | None, overrides: tuple[str, ...]) -> None:
    """Print a scenario, a robot or a controller in full.

    NAME is a name from omni-mj list, FILE a scenario.toml, a robot.toml or file.py:Class. A
    scenario is printed as a file with all settings, their units and meanings; --robot and --set
    change it. A robot is printed as a file for --robot, with the numbers derived from it; a
    controller with its description and parameters.
    """
    print(descriptions.describe(name, overrides, robot), end="")


@click.command("schema")
def schema_command() -> None:
    """Print the JSON Schema of scenario files."""
    from omni_mj.config.scenario import build_json_schema

    print(json.dumps(build_json_schema(), indent=2))


@click.command("new")
@click.argument("kind", type=click.Choice(list(STARTER_FILES)))
@click.argument("name")
@click.option("--overwrite", is_flag=True, help="Replace an existing file of that name.")
def new_command(kind: str, name: str, overwrite: bool) -> None:
    """Write a file to start from: a scenario or robot NAME.toml, or a controller NAME.py.

    It can be run at once. Its comments explain what to change.
    """
    suffix, arguments = STARTER_FILES[kind]
    path = Path(name.removesuffix(suffix) + suffix)
    if not re.fullmatch(r"[A-Za-z][\w-]*", path.stem, re.ASCII):
        raise OmniError(
            f"the name of a {kind} must be a letter followed by letters, digits, _ or -, "
            f"got {path.stem!r}"
        )
    if path.exists() and not overwrite:
        raise OmniError(f"{path} exists; choose another name, or replace it with --overwrite")
    class_name = "".join(word[:1].upper() + word[1:] for word in re.split(r"[_-]", path.stem))
    try:
        write_text(path, _starter_text(kind, path.stem, class_name))
    except OSError as error:
        raise OmniError(f"cannot write {path}: {error.strerror}") from None
    run_options = arguments.format(path=shlex.quote(str(path)), name=class_name)
    print(f"wrote {path}; run it: omni-mj run {run_options}")


def _starter_text(kind: str, name: str, class_name: str) -> str:
    """Return the text of a new file. NAME and CLASS in the templates stand for its names."""
    text = (Path(__file__).parent / "starters" / f"{kind}.txt").read_text(encoding="utf-8")
    text = text.replace("CLASS", class_name).replace("NAME", name)
    if kind == "robot":
        from omni_mj.config import robot_files
        from omni_mj.config.resolve import resolve_settings

        fields = robot_files.read_robot_sections(robot_files.DEFAULT_ROBOT)
        text += descriptions.format_sections(resolve_settings({}), fields)
    return text
