"""Options that several commands share."""

from pathlib import Path

import click

CONTROLLER = click.option(
    "--controller", "controllers", metavar="NAME|FILE.py:Class", multiple=True, help="May be repeated. [the scenario's]"
)
SETTINGS = click.option(
    "--set", "overrides", metavar="SECTION.FIELD=VALUE", multiple=True, help="A setting; see omni-mj list."
)
SUBJECT = click.option("--subject", metavar="NAME", help="A controller whose verdict is asked for.")
OVERWRITE = click.option("--overwrite", is_flag=True, help="Replace the files of an earlier run in --out.")
QUIET = click.option("--quiet", is_flag=True, help="Print nothing but errors.")
FOLDER = click.Path(path_type=Path)
