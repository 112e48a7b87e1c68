"""Options that several commands share."""

import json
from collections.abc import Callable
from dataclasses import dataclass, fields
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

if TYPE_CHECKING:
    from omni_mj.config.scenario import Scenario


SCENARIO = click.option("--scenario", "name", metavar="NAME|FILE.toml", help="What to drive.")
CONTROLLER = click.option(
    "--controller", "controllers", metavar="NAME|FILE.py:Class", multiple=True,
    help="What drives it; may be repeated. [the scenario's]",
)  # fmt: skip
PLANT = click.option("--plant", metavar="NAME|FILE.py:Class", help="What is driven. [mujoco]")
SETTINGS = click.option(
    "--set", "overrides", metavar="SECTION.FIELD=VALUE", multiple=True,
    help="A setting, such as radio.delay_frames=9; may be repeated. See omni-mj list settings.",
)  # fmt: skip
MODEL = click.option(
    "--model", metavar="FILE.xml",
    help="Your robot's MJCF; the robot's file says the rest. [ours]",
)  # fmt: skip
ROBOT = click.option("--robot", metavar="NAME|FILE.toml", help="Which robot it is. [tigers-v2016]")
RECORD = click.option(
    "--record/--no-record", default=True, help="Write recording.rrd for the rerun viewer."
)
VIEW = click.option("--view", is_flag=True, help="Watch the run in a rerun viewer of its own.")
CONNECT = click.option(
    "--connect", metavar="URL", help="Watch the run in a rerun viewer that is running."
)
FIGURES = click.option("--figures/--no-figures", "draw", default=True, help="Draw the figures.")
SVG = click.option("--svg", is_flag=True, help="Draw the figures as SVG too.")
SUBJECT = click.option("--subject", metavar="NAME", help="A controller whose verdict is asked for.")
ALLOW_CODE = click.option(
    "--allow-code",
    is_flag=True,
    help="Run controllers and plants of your own that the scenario's file names.",
)
OVERWRITE = click.option(
    "--overwrite", is_flag=True, help="Replace the files of an earlier run in --out."
)
QUIET = click.option("--quiet", is_flag=True, help="Print nothing but errors.")
FOLDER = click.Path(path_type=Path)


@dataclass(frozen=True)
class Choice:
    """What a command line says of the scenario that it names; what it does not say is the scenario's."""

    controllers: tuple[str, ...] = ()
    plant: str | None = None
    robot: str | None = None
    model: str | None = None
    seed: int | None = None
    seeds: int | None = None
    overrides: tuple[str, ...] = ()
    allow_code: bool = False

    @property
    def settings(self) -> tuple[str, ...]:
        """What --set and --model say, as --set would."""
        model = (
            ()
            if self.model is None
            else (f"model.file={json.dumps(self.model, ensure_ascii=False)}",)
        )
        return (*self.overrides, *model)

    def load(self, name: str, *usual: str) -> "Scenario":
        """The scenario of that name with what was chosen.

        Args:
            name: of a built-in scenario, or its file.
            usual: settings of the command, before those of the user.

        Raises:
            OmniError: see `omni_mj.config.scenario.load_with_overrides`.
        """
        from omni_mj.config import scenario

        head = {key: getattr(self, key) for key in ("plant", "robot", "seed", "seeds")}
        given = {key: value for key, value in head.items() if value is not None}
        if self.controllers:
            given["controllers"] = self.controllers
        return scenario.load_with_overrides(name, (*usual, *self.settings), given, self.allow_code)


@dataclass(frozen=True)
class Outputs:
    """What a run shows and leaves besides its numbers."""

    record: bool = True
    view: bool = False
    connect: str | None = None
    draw: bool = True
    svg: bool = False


def _packed(kind: type, name: str) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Return a decorator that hands a command those of its options that are fields of a dataclass as one argument."""

    def decorate(command: Callable[..., None]) -> Callable[..., None]:
        @wraps(command)
        def with_packed(**given: Any) -> None:
            own = {
                field.name: given.pop(field.name) for field in fields(kind) if field.name in given
            }
            command(**given, **{name: kind(**own)})

        return with_packed

    return decorate


choice = _packed(Choice, "choice")
outputs = _packed(Outputs, "outputs")
