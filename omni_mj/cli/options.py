"""Options that several commands share."""

import json
from pathlib import Path
from typing import TYPE_CHECKING

import click

from omni_mj.cli import complete

if TYPE_CHECKING:
    from omni_mj.scenarios.scenario import Scenario

SCENARIO = click.option(
    "--scenario", "name", metavar="NAME|FILE.toml", shell_complete=complete.scenarios, help="What to drive."
)
CONTROLLER = click.option(
    "--controller", "controllers", metavar="NAME|FILE.py:Class", multiple=True, shell_complete=complete.controllers,
    help="What drives it; may be repeated. [the scenario's]",
)  # fmt: skip
PLANT = click.option(
    "--plant", metavar="NAME|FILE.py:Class", shell_complete=complete.plants, help="What is driven. [mujoco]"
)
SETTINGS = click.option(
    "--set", "overrides", metavar="SECTION.FIELD=VALUE", multiple=True, shell_complete=complete.settings,
    help="A setting, such as radio.delay_frames=9; may be repeated. See omni-mj list settings.",
)  # fmt: skip
MODEL = click.option(
    "--model", metavar="FILE.xml", shell_complete=complete.files,
    help="Your robot's MJCF; the robot's file says the rest. [ours]",
)  # fmt: skip
ROBOT = click.option(
    "--robot", metavar="NAME|FILE.toml", shell_complete=complete.robots, help="Which robot it is. [tigers-v2016]"
)
RECORD = click.option("--record/--no-record", default=True, help="Write recording.rrd for the rerun viewer.")
VIEW = click.option("--view", is_flag=True, help="Watch the run in a rerun viewer of its own.")
CONNECT = click.option("--connect", metavar="URL", help="Watch the run in a rerun viewer that is running.")
FIGURES = click.option("--figures/--no-figures", "draw", default=True, help="Draw the figures.")
SVG = click.option("--svg", is_flag=True, help="Draw the figures as SVG too.")
SUBJECT = click.option("--subject", metavar="NAME", help="A controller whose verdict is asked for.")
ALLOW_CODE = click.option(
    "--allow-code", is_flag=True, help="Run controllers and plants of your own that the scenario's file names."
)
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
