"""The console script `omni-mj`: its commands, each imported when it is called; `run` may be left out."""

from importlib import import_module
from typing import Any, NoReturn

import click

from omni_control.errors import OmniError, choose
from omni_mj.cli import console

SECTIONS = {  # heading -> command -> what it is for, at most what fits a line of 80
    "Drive": {
        "run": "drive a scenario with one or several controllers",
        "compare": "who wins where: controllers on many scenarios, over seeds",
        "sweep": "how often it fails, and where: settings and seeds",
        "limit": "what is possible in a scenario, found by learning it",
        "loop": "step responses of controllers, gain and phase margins",
        "alpha": "how a robot follows commands: gain, lag and their causes",
        "slip": "how robots slip, beside measured ones",
    },
    "Your robots and software": {
        "identify": "the numbers of your robot, from its logs",
        "serve": "a simulator of the league, for any team's software",
        "drive": "other simulators' robots, or real ones",
        "new": "a starter file: a scenario, controller or robot of yours",
    },
    "What came of it": {
        "report": "one page about a run, or several",
        "film": "a run as a film: GIF, WebP, MP4, WebM",
        "picture": "what the viewer shows of a recording",
        "verify": "whether a run gives the same again, here",
    },
    "What there is": {
        "list": "scenarios, controllers, plants, robots, settings",
        "show": "a scenario, a robot or a controller in full",
        "schema": "the JSON Schema of scenario files, for editors",
    },
}
COMMANDS = {name: what for commands in SECTIONS.values() for name, what in commands.items()}
EXAMPLES = {
    "omni-mj run --scenario rect": "the paper's experiment, with figures, report and recording",
    "omni-mj run --scenario rect --controller comp-flc --controller mpc --view": "two others, watched",
    "omni-mj run --scenario league --robot ubc-thunderbots --set carpet.friction=0.6": "another robot and carpet",
    "omni-mj compare --scenario rect --scenario league --seeds 3": "all controllers, in a table",
    "omni-mj new controller mine": "write mine.py, a controller to change",
    "omni-mj run --scenario rect --controller comp-flc --controller mine.py:Mine": "drive it beside another",
    "omni-mj list settings friction": "what can be set, of which that word says something",
}
FURTHER = (
    "omni-mj COMMAND --help tells what a command takes. docs/tour.md is a tour of a quarter of an hour, docs/python.md "
    "tells how to do all this from Python. docs/commands.md has more examples, and completion for your shell."
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

    def resolve_command(self, ctx: click.Context, args: list[str]) -> Any:
        """See `click.Group`.

        Raises:
            OmniError: there is no such command; the message names the nearest.
        """
        word = args[0]
        if word not in COMMANDS and not ctx.resilient_parsing:
            from omni_mj.scenarios.library import builtin

            run = f"did you mean omni-mj run --scenario {word}?"
            raise OmniError(f"there is no command {word!r}; {run if word in builtin() else choose(word, COMMANDS)}")
        return super().resolve_command(ctx, args)

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """See `click.Group`; nothing at all asks for help."""
        args = args or ["--help"]
        if args[0].startswith("-") and args[0] not in (*ctx.help_option_names, "--version"):
            args = ["run", *args]
        return super().parse_args(ctx, args)

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """See `click.Group`; by sections, without importing any."""
        widest = max(map(len, COMMANDS))
        for heading, commands in SECTIONS.items():
            with formatter.section(heading):
                formatter.write_dl([(name.ljust(widest), what) for name, what in commands.items()])

    def format_epilog(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """See `click.Group`; examples, which are not wrapped, as they are there to be copied."""
        with formatter.section("Examples"):
            for example, what in EXAMPLES.items():
                formatter.write(f"  {example}\n      {what}\n")
        with formatter.section("Where to go on"):
            formatter.write_text(FURTHER)


@click.group(cls=_Commands, options_metavar="", subcommand_metavar="COMMAND [OPTIONS]")
@click.version_option(None, "--version", package_name="omni-mj", message="omni-mj %(version)s")
def cli() -> None:
    """Motion control of RoboCup Small Size League robots on real physics: dead time, slip, motors that heat."""


def main() -> NoReturn:
    """Entry point of the console script."""
    console.program(cli)


if __name__ == "__main__":
    main()
