"""The console script `omni-mj`: its subcommands, of which `run` may be left out."""

from typing import NoReturn

import click

from omni_mj.cli import console
from omni_mj.cli.run import run
from omni_mj.show import report
from omni_mj.studies import compare


class _DefaultRun(click.Group):
    """A group in which options alone mean `run`: omni-mj --scenario rect."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        if args and args[0].startswith("-") and args[0] not in ctx.help_option_names:
            args = ["run", *args]
        return super().parse_args(ctx, args)


@click.group(cls=_DefaultRun)
def cli() -> None:
    """Motion control of RoboCup Small Size League robots on real physics."""


for command in (run, compare.command, report.command):
    cli.add_command(command)


def main() -> NoReturn:
    """Entry point of the console script."""
    console.invoke(cli)


if __name__ == "__main__":
    main()
