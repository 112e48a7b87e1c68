"""The console script `omni-mj`: its commands, each imported when it is called; `run` may be left out."""

from collections.abc import Iterator, Mapping
from importlib import import_module
from typing import NoReturn

import click

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
        "film": "a run as a film: GIF or WebP",
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
EPILOG = """
\b
Examples, of which docs/reference/commands.md has more:
omni-mj run --scenario rect
    the paper's experiment, with figures, report and recording
omni-mj run --scenario rect --controller comp-flc --controller mpc --view
    two others, watched
omni-mj run --scenario league --robot ubc-thunderbots --set carpet.friction=0.6
    another robot and carpet
omni-mj compare --scenario rect --scenario league --seeds 3
    all controllers, in a table
omni-mj new controller mine
    write mine.py, a controller to change
omni-mj run --scenario rect --controller comp-flc --controller mine.py:Mine
    drive it beside another
omni-mj list settings friction
    what can be set, of which that word says something

omni-mj COMMAND --help tells what a command takes. docs/tutorials/tour.md is a tour of a quarter of an hour,
docs/how-to/use-from-python.md tells how to do all this from Python.
"""


SHARED = {
    "show": "list",
    "schema": "list",
    "alpha": "study_commands",
    "identify": "study_commands",
    "limit": "study_commands",
    "loop": "study_commands",
    "slip": "study_commands",
}  # commands that are in another's file


class _Files(Mapping[str, click.Command]):
    """The commands by name; looking one up imports its file, while names alone import nothing."""

    def __getitem__(self, name: str) -> click.Command:
        if name not in COMMANDS:
            raise KeyError(name)
        module = import_module(f"omni_mj.cli.{SHARED.get(name, name)}")
        command: click.Command = getattr(module, name if name in SHARED else "command")
        return command

    def __iter__(self) -> Iterator[str]:
        return iter(COMMANDS)

    def __len__(self) -> int:
        return len(COMMANDS)


class _Commands(click.Group):
    """A group in whose help commands have sections; options alone mean `run`: omni-mj --scenario rect."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Put `run` in front of options, ask for help if there is nothing; see `click.Group`."""
        args = args or ["--help"]
        if args[0].startswith("-") and args[0] not in (*ctx.help_option_names, "--version"):
            args = ["run", *args]
        return super().parse_args(ctx, args)

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """List the commands by sections, without importing any; see `click.Group`."""
        widest = max(map(len, COMMANDS))
        for heading, commands in SECTIONS.items():
            with formatter.section(heading):
                formatter.write_dl([(name.ljust(widest), what) for name, what in commands.items()])


@click.group(
    cls=_Commands,
    commands=_Files(),
    epilog=EPILOG,
    options_metavar="",
    subcommand_metavar="COMMAND [OPTIONS]",
)
@click.version_option(None, "--version", package_name="omni-mj", message="omni-mj %(version)s")
def cli() -> None:
    """Motion control of RoboCup Small Size League robots on real physics: dead time, slip, motors that heat."""


def main() -> NoReturn:
    """Entry point of the console script."""
    console.program(cli)


if __name__ == "__main__":
    main()
