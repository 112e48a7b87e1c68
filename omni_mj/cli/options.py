"""Options that several commands share."""

import json
from collections.abc import Callable
from dataclasses import dataclass, fields
from functools import reduce, wraps
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

if TYPE_CHECKING:
    from omni_mj.config.scenario import Scenario

FOLDER = click.Path(path_type=Path)

SCENARIO = click.option(
    "--scenario",
    "name",
    metavar="NAME|FILE.toml",
    help="Scenario to run: a name that omni-mj list scenarios prints, or a file.",
)
CONTROLLER = click.option(
    "--controller",
    "controllers",
    metavar="NAME|FILE.py:Class",
    multiple=True,
    help="Controller to run; may be repeated. Default: those of the scenario.",
)
PLANT = click.option(
    "--plant",
    metavar="NAME|FILE.py:Class",
    help="Simulated plant: mujoco, planar, kinematic or your own. Default: that of the scenario.",
)
ROBOT = click.option(
    "--robot",
    metavar="NAME|FILE.toml",
    help="Robot (see omni-mj list robots). Default: that of the scenario, usually tigers-v2016.",
)
MODEL = click.option(
    "--model",
    metavar="FILE.xml",
    help="MJCF model of your robot, in place of the built-in model.",
)
SETTINGS = click.option(
    "--set",
    "overrides",
    metavar="SECTION.FIELD=VALUE",
    multiple=True,
    help="Setting, such as radio.delay_frames=9; may be repeated. See omni-mj list settings.",
)
SEED = click.option(
    "--seed",
    type=int,
    metavar="N",
    help="First seed of the random numbers. Default: that of the scenario, usually 0.",
)
SEEDS = click.option(
    "--seeds",
    type=int,
    metavar="N",
    help="Number of seeds, counted up from the first. Default: that of the scenario, usually 1.",
)
SUBJECT = click.option(
    "--subject", metavar="NAME", help="Controller to test against all others. Default: none."
)
INTERFACE = click.option(
    "--interface",
    metavar="ADDRESS",
    default="127.0.0.1",
    help="Address of this computer in the network. Default: 127.0.0.1.",
)
ALLOW_CODE = click.option(
    "--allow-code",
    is_flag=True,
    help="Allow the scenario's file to name Python files, which are then run.",
)
RECORD = click.option(
    "--record/--no-record",
    default=True,
    help="Write recording.rrd for the rerun viewer. Default: --record.",
)
VIEW = click.option("--view", is_flag=True, help="Open a rerun viewer that shows the run live.")
CONNECT = click.option(
    "--connect", metavar="URL", help="Show the run live in a rerun viewer that is already open."
)
FIGURES = click.option(
    "--figures/--no-figures",
    "draw",
    default=True,
    help="Draw the figures. Default: --figures.",
)
SVG = click.option("--svg", is_flag=True, help="Save the figures as SVG too.")
OVERWRITE = click.option(
    "--overwrite", is_flag=True, help="Replace the files of an earlier run in --out."
)
QUIET = click.option("--quiet", is_flag=True, help="Print errors only.")


def out_option(folder_name: str) -> Callable[[Any], Any]:
    """Return the option --out of a command whose results go to runs/<folder_name> by default."""
    text = f"Folder of the results. Default: runs/{folder_name}-<UTC time>."
    return click.option("--out", type=FOLDER, metavar="DIR", help=text)


@dataclass(frozen=True)
class ScenarioOptions:
    """Options that change a scenario. None and empty tuples leave it unchanged."""

    controllers: tuple[str, ...] = ()
    plant: str | None = None
    robot: str | None = None
    model: str | None = None
    seed: int | None = None
    seeds: int | None = None
    overrides: tuple[str, ...] = ()
    allow_code: bool = False

    def load_scenario(self, name: str, *default_overrides: str) -> "Scenario":
        """Return a scenario with these options.

        Args:
            name: Name of a built-in scenario, or a file.
            *default_overrides: SECTION.FIELD=VALUE of the command. Those of the user take
                precedence.

        Raises:
            OmniError: See `omni_mj.config.scenario.load_with_overrides`; or a package is missing
                that a controller or the backend needs.
        """
        from omni_mj.config import plugins, scenario
        from omni_mj.robot.numpy_and_jax_backends import choose_backend

        overrides = [*default_overrides, *self.setting_overrides]
        loaded = scenario.load_with_overrides(name, overrides, self.top_level, self.allow_code)
        for kind in loaded.controllers:
            plugins.find_controller(kind)
        choose_backend(loaded.settings.physics.backend, loaded.plant, n_robots=1, n_frames=1)
        return loaded

    @property
    def top_level(self) -> dict[str, Any]:
        """Values of fields outside of the sections, such as the plant, that replace others."""
        names = ("plant", "robot", "seed", "seeds")
        values = {key: getattr(self, key) for key in names if getattr(self, key) is not None}
        return values | ({"controllers": self.controllers} if self.controllers else {})

    @property
    def setting_overrides(self) -> tuple[str, ...]:
        """SECTION.FIELD=VALUE of --set and --model."""
        if self.model is None:
            return self.overrides
        return *self.overrides, f"model.file={json.dumps(self.model, ensure_ascii=False)}"


@dataclass(frozen=True)
class OutputOptions:
    """Options for the recording, the viewers and the figures of a run."""

    record: bool = True
    view: bool = False
    connect: str | None = None
    draw: bool = True
    svg: bool = False


def collect_options(
    options_class: type, argument: str
) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Return a decorator that collects options of a command in a dataclass.

    Args:
        options_class: Dataclass. Its fields have the names of the options.
        argument: Name of the command's argument that receives the instance.
    """

    def decorate(command: Callable[..., None]) -> Callable[..., None]:
        @wraps(command)
        def with_collected_options(**values: Any) -> None:
            names = [field.name for field in fields(options_class) if field.name in values]
            collected = options_class(**{name: values.pop(name) for name in names})
            command(**values, **{argument: collected})

        return with_collected_options

    return decorate


def combine(*decorators: Callable[[Any], Any]) -> Callable[[Any], Any]:
    """Return a decorator that adds several options to a command, in this order."""
    return lambda command: reduce(lambda inner, add: add(inner), reversed(decorators), command)


model_options = combine(MODEL, SETTINGS, collect_options(ScenarioOptions, "scenario_options"))
robot_options = combine(ROBOT, model_options)
scenario_options = combine(PLANT, robot_options)
viewer_options = combine(RECORD, VIEW, CONNECT, collect_options(OutputOptions, "output_options"))


@dataclass(frozen=True)
class StudyOutput:
    """Options for the results of a study."""

    out: Path | None
    overwrite: bool
    quiet: bool


def study_output_options(study: str) -> Callable[[Any], Any]:
    """Return a decorator that adds --out, --overwrite and --quiet to a study's command."""
    return combine(out_option(study), OVERWRITE, QUIET, collect_options(StudyOutput, "output"))
