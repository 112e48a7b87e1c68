"""`omni-mj show`: a scenario, a robot or a controller in full."""

import click

from omni_mj.cli import options


@click.command("show")
@click.argument("name", metavar="NAME|FILE", shell_complete=options.complete("scenarios", "robots", "controllers"))
@options.ROBOT
@options.SETTINGS
def command(name: str, robot: str | None, overrides: tuple[str, ...]) -> None:
    """Print a scenario, a robot or a controller in full.

    NAME is one that omni-mj list prints; FILE a scenario.toml, a robot.toml or a controller, file.py:Class. A scenario
    is printed with all its settings, their units and meanings, as a file that can be run; --robot and --set change it,
    as they do for omni-mj run. Of a robot that is a file for --robot, with what follows from its numbers; of a
    controller, what it does and its parameters.
    """
    from omni_mj.show import full

    print(full.text(name, overrides, robot), end="")
