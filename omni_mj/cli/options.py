"""Options that several commands share."""

import json
from pathlib import Path
from typing import TYPE_CHECKING

import click

if TYPE_CHECKING:
    from omni_mj.scenarios.scenario import Scenario

CONTROLLER = click.option(
    "--controller", "controllers", metavar="NAME|FILE.py:Class", multiple=True, help="May be repeated. [the scenario's]"
)
SETTINGS = click.option(
    "--set", "overrides", metavar="SECTION.FIELD=VALUE", multiple=True, help="A setting; see omni-mj list."
)
MODEL = click.option("--model", metavar="FILE.xml", help="Your robot's MJCF; the robot's file says the rest. [ours]")
SUBJECT = click.option("--subject", metavar="NAME", help="A controller whose verdict is asked for.")
OVERWRITE = click.option("--overwrite", is_flag=True, help="Replace the files of an earlier run in --out.")
QUIET = click.option("--quiet", is_flag=True, help="Print nothing but errors.")
FOLDER = click.Path(path_type=Path)


def with_model(overrides: tuple[str, ...], model: str | None) -> tuple[str, ...]:
    """Settings as given, with that of a model."""
    return overrides if model is None else (*overrides, f"model.file={json.dumps(model, ensure_ascii=False)}")


def tell_model(scenario: "Scenario", quiet: bool) -> None:
    """Print in what a model of the user's differs from the robot's file."""
    from omni_mj.scenarios import own_model, robots

    if not quiet:
        for line in own_model.differences(robots.sections(scenario.robot), scenario.robot, scenario.settings.model):
            click.echo(f"note: {line}", err=True)
