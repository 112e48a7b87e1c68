"""`omni-mj list`, `show` and `schema`: what there is to name, one of it in full, what editors check."""

import json

import click

from omni_control.errors import OmniError, suggest_names
from omni_mj.cli import catalog, options


@click.command("list")
@click.argument("what", required=False, metavar=f"[{'|'.join(catalog.TITLES)}]")
@click.argument("word", required=False, metavar="[WORD]")
def command(what: str | None, word: str | None) -> None:
    """List scenarios, controllers, plants, robots, settings and faults: all, one list, or what has WORD in it.

    omni-mj list settings friction prints the settings in whose name or meaning that word stands;
    omni-mj list friction looks for it in all lists.
    """
    only = next((title for title in catalog.TITLES if what in (title, title[:-1])), None)
    if only is None and word is not None:
        raise OmniError(f"there is no list {what!r}; {suggest_names(what, catalog.TITLES)}")
    catalog.print_lists(only, (word if only else what) or "")


@click.command("show")
@click.argument("name", metavar="NAME|FILE")
@options.ROBOT
@options.SETTINGS
def show(name: str, robot: str | None, overrides: tuple[str, ...]) -> None:
    """Print a scenario, a robot or a controller in full.

    NAME is one that omni-mj list prints; FILE a scenario.toml, a robot.toml or a controller,
    file.py:Class. A scenario is printed with all its settings, their units and meanings, as a file
    that can be run; --robot and --set change it, as they do for omni-mj run. Of a robot that is a
    file for --robot, with what follows from its numbers; of a controller, what it does and its
    parameters.
    """
    print(catalog.describe(name, overrides, robot), end="")


@click.command("schema")
def schema() -> None:
    """Print the JSON Schema of scenario files."""
    from omni_mj.config.scenario import build_json_schema

    print(json.dumps(build_json_schema(), indent=2))
