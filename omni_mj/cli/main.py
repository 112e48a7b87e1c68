"""The command line: a group of commands, each imported when it is called."""

from collections.abc import Iterator, Mapping
from pkgutil import resolve_name
from typing import NoReturn

import click

from omni_mj.cli import console

HELP_SECTIONS = {  # heading -> command -> purpose; a line must fit 80 columns
    "Simulate": {
        "run": "run a scenario with one or several controllers",
        "play": "play with robots in the browser, with sliders",
        "compare": "compare controllers on many scenarios and seeds",
        "sweep": "vary settings and seeds, and count failures and errors",
        "limit": "find the smallest possible error in a scenario by learning",
        "loop": "measure step responses and stability margins of controllers",
        "alpha": "measure gain and lag of a robot, and what causes them",
        "slip": "measure wheel slip, and compare it with that of real robots",
    },
    "Your robots and software": {
        "identify": "find the parameters of your robot in its logs",
        "serve": "simulate robots for any team's software",
        "drive": "drive real robots, or those of another simulator",
        "new": "write a file to start from: scenario, controller or robot",
        "export": "write a robot as MJCF for any MuJoCo scene",
    },
    "Results": {
        "report": "write an HTML report about one or several runs",
        "film": "render a run as a film: GIF or WebP",
        "screenshot": "save an image of the viewer that shows a recording",
        "verify": "repeat a run, and compare the results bit for bit",
    },
    "Reference": {
        "list": "list scenarios, controllers, plants, robots, settings, faults",
        "show": "print a scenario, a robot or a controller in full",
        "schema": "print the JSON Schema of scenario files, for editors",
    },
}
COMMANDS = {name: text for commands in HELP_SECTIONS.values() for name, text in commands.items()}
MODULES = {  # module -> commands in it; every other command has a module NAME_command
    "list_and_show_commands": ("list", "show", "schema", "new"),
    "result_commands": ("report", "film", "screenshot", "verify"),
    "study_commands": ("alpha", "identify", "limit", "loop", "slip"),
}
EPILOG = """
\b
Examples; docs/reference/commands.md has more:
omni-mj run --scenario rect
    the paper's experiment, with figures, report and recording
omni-mj run --scenario rect --controller comp-flc --controller mpc --view
    two other controllers, shown live
omni-mj run --scenario league --robot ubc-thunderbots --set carpet.friction=0.6
    another robot on another carpet
omni-mj compare --scenario rect --scenario league --seeds 3
    all controllers in one table
omni-mj new controller mine
    write mine.py, a controller to change
omni-mj run --scenario rect --controller comp-flc --controller mine.py:Mine
    run it next to another
omni-mj list settings friction
    all settings about friction

"omni-mj COMMAND --help" explains a command. "omni-mj run" may be shortened to
"omni-mj" if options follow.
docs/tutorials/tour.md is a tour of 15 minutes, docs/how-to/use-from-python.md
shows how to do all this from Python.
"""


class _LazyCommands(Mapping[str, click.Command]):
    """Commands by name. Looking one up imports its module; listing the names imports nothing."""

    def __getitem__(self, name: str) -> click.Command:
        if name not in COMMANDS:
            raise KeyError(name)
        modules = (module for module, names in MODULES.items() if name in names)
        module_name = next(modules, f"{name}_command")
        return resolve_name(f"omni_mj.cli.{module_name}:{name}_command")

    def __iter__(self) -> Iterator[str]:
        return iter(COMMANDS)

    def __len__(self) -> int:
        return len(COMMANDS)


class _CommandGroup(click.Group):
    """Click group whose help has headings. Options without a command are those of `run`."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Add `run` before options, and --help if there are no arguments; see `click.Group`."""
        args = args or ["--help"]
        if args[0].startswith("-") and args[0] not in (*ctx.help_option_names, "--version"):
            args = ["run", *args]
        return super().parse_args(ctx, args)

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the commands under their headings, without importing them; see `click.Group`."""
        widest = max(map(len, COMMANDS))
        for heading, commands in HELP_SECTIONS.items():
            with formatter.section(heading):
                formatter.write_dl([(name.ljust(widest), text) for name, text in commands.items()])


@click.group(
    cls=_CommandGroup,
    commands=_LazyCommands(),
    epilog=EPILOG,
    options_metavar="",
    subcommand_metavar="COMMAND [OPTIONS]",
)
@click.version_option(None, "--version", package_name="omni-mj", message="omni-mj %(version)s")
def cli() -> None:
    """Simulate the motion control of RoboCup Small Size League robots.

    Dead time, wheel slip, motor heat and battery are simulated physically.
    """


def main() -> NoReturn:
    """Run the console script."""
    console.run_program(cli)


if __name__ == "__main__":
    main()
