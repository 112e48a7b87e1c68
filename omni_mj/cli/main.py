"""The console script `omni-mj`: its commands, each imported when it is called; `run` may be left out."""

from importlib import import_module
from typing import NoReturn

import click

from omni_mj.cli import console

COMMANDS = (
    "run",
    "compare",
    "sweep",
    "limit",
    "alpha",
    "slip",
    "loop",
    "identify",
    "serve",
    "drive",
    "verify",
    "report",
    "picture",
    "film",
    "list",
    "schema",
)


class _Commands(click.Group):
    """A group whose commands are in files of their names; options alone mean `run`: omni-mj --scenario rect."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """See `click.Group`."""
        return list(COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """See `click.Group`: imports the command's file."""
        if cmd_name not in COMMANDS:
            return None
        command = import_module(f"omni_mj.cli.{cmd_name}").command
        assert isinstance(command, click.Command)
        return command

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """See `click.Group`; nothing at all asks for help."""
        args = args or ["--help"]
        if args[0].startswith("-") and args[0] not in (*ctx.help_option_names, "--version"):
            args = ["run", *args]
        return super().parse_args(ctx, args)


@click.group(cls=_Commands)
@click.version_option(None, "--version", package_name="omni-mj", message="omni-mj %(version)s")
def cli() -> None:
    """Motion control of RoboCup Small Size League robots on real physics."""


def main() -> NoReturn:
    """Entry point of the console script."""
    console.invoke(cli)


if __name__ == "__main__":
    main()
