"""`omni-mj compare`: every controller on every scenario over many seeds, in one table."""

import json
import shlex
import time
from collections.abc import Iterable, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import click

from omni_control.controllers import CONTROLLERS
from omni_control.errors import OmniError
from omni_mj.cli import console, folders
from omni_mj.cli.interrupts import Interrupts, StoppedError
from omni_mj.measure import compare_statistics
from omni_mj.measure.summary import versions
from omni_mj.scenarios import controllers, scenario
from omni_mj.scenarios.plants import PLANTS
from omni_mj.scenarios.scenario import Scenario
from omni_mj.scenarios.settings import PERIOD_S
from omni_mj.show import compare_figure, compare_table
from omni_mj.simulate.simulation import Simulation

OUTPUTS = ("compare.json", "compare.md", "compare.png", "compare.svg")
LEFT_OUT = ("heat",)  # many times as long as the others


@click.command("compare")
@click.option(
    "--scenario", "scenarios", metavar="NAME|FILE.toml", multiple=True,
    help="May be repeated. [all that come with the program, but for the long heat]",
)  # fmt: skip
@click.option("--controller", "names", metavar="NAME", multiple=True, help="May be repeated. [all]")
@click.option("--plant", metavar="|".join(PLANTS), default="mujoco", help="What is driven. [mujoco]")
@click.option("--seeds", type=int, metavar="N", default=5, help="How many seeds, counting up from the first. [5]")
@click.option("--seed", type=int, metavar="S", default=0, help="First seed of the random numbers. [0]")
@click.option("--set", "overrides", metavar="SECTION.FIELD=VALUE", multiple=True, help="In all; see omni-mj --list.")
@click.option("--out", type=click.Path(path_type=Path), metavar="DIR", help="[runs/compare-<UTC time>]")
@click.option("--overwrite", is_flag=True, help="Replace the files of an earlier comparison in --out.")
@click.option("--quiet", is_flag=True, help="Print nothing but errors.")
def command(
    scenarios: tuple[str, ...],
    names: tuple[str, ...],
    plant: str,
    seeds: int,
    seed: int,
    overrides: tuple[str, ...],
    out: Path | None,
    overwrite: bool,
    quiet: bool,
) -> None:
    """Compare controllers on many scenarios and seeds: errors, effort, time to settle."""
    names = names or tuple(CONTROLLERS)
    head = {"controllers": names, "plant": plant, "seed": seed, "seeds": seeds}
    given = scenarios or [name for name in scenario.builtin() if name not in LEFT_OUT]
    chosen = [scenario.load(name, overrides, head) for name in given]
    _check_names(chosen)
    repeat = ["--plant", plant, "--seeds", str(seeds), "--seed", str(seed)]
    for option, values in (("--scenario", given), ("--controller", names), ("--set", overrides)):
        repeat += [word for value in values for word in (option, value)]
    folder = folders.prepare(out, "compare", OUTPUTS, overwrite)
    with console.writing(folder):
        execute(chosen, overrides, shlex.join(["omni-mj", "compare", *repeat]), folder, quiet)


def execute(chosen: Sequence[Scenario], overrides: Iterable[str], repeat: str, folder: Path, quiet: bool) -> None:
    """Run the scenarios one after the other, all with the same controllers, seeds and plant.

    The files in `folder` are complete for what was done from the start on, whatever ends the comparison. A scenario
    that fails is noted and the others go on.
    """
    started = time.perf_counter()
    result = _nothing_done(chosen, overrides, repeat)
    stop = None
    try:
        with Interrupts() as interrupts:
            for i, each in enumerate(chosen, 1):
                _save(result, started, folder)
                entry = result["scenarios"][each.name]
                entry |= _run(each, f"{each.name} ({i} of {len(chosen)})", interrupts, quiet)
        result["complete"] = True
    except StoppedError as signal:
        stop, result["stopped"] = signal, signal.reason
    _save(result, started, folder)
    done = [name for name, entry in result["scenarios"].items() if entry["status"] == "done"]
    failed = [name for name, entry in result["scenarios"].items() if entry["status"] == "failed"]
    if done:
        compare_figure.save(result, folder / "compare")
    if not quiet:
        compare_table.show(result)
        files = ", ".join(str(folder / output) for output in OUTPUTS if (folder / output).exists())
        print(f"{result['wall_s']:.1f} s; results in {files}")
    if stop:
        console.fail(f"{stop.reason}; {len(done)} of {len(chosen)} scenarios are in {folder}", stop.exit_code)
    if failed:
        why = f"{failed[0]}: {result['scenarios'][failed[0]]['reason']}"
        console.fail(f"{len(failed)} of {len(chosen)} scenarios failed; {why}", console.FAILED)


def _check_names(chosen: Iterable[Scenario]) -> None:
    names = [each.name for each in chosen]
    for name in names:
        if names.count(name) > 1:
            raise OmniError(f"two scenarios are called {name!r}; give each once, or files with another name in them")


def _nothing_done(chosen: Sequence[Scenario], overrides: Iterable[str], repeat: str) -> dict[str, Any]:
    first = chosen[0]
    return {
        "created": datetime.now(UTC).isoformat(timespec="seconds"),
        "complete": False,
        "stopped": None,
        "wall_s": 0.0,
        "repeat": repeat,
        "plant": first.plant,
        "seeds": first.seed_list,
        "overrides": list(overrides),
        "controllers": list(first.labels),
        "limits": _limits(first),
        "scenarios": {
            each.name: {
                "description": each.description, "status": "not run", "reason": None, "simulated_s": 0.0, "wall_s": 0.0,
                "results": {}, "verdict": None, "settings": each.settings.plain(),
            }
            for each in chosen
        },
        "definitions": compare_statistics.DEFINITIONS,
        "versions": versions(),
    }  # fmt: skip


def _run(chosen: Scenario, label: str, interrupts: Interrupts, quiet: bool) -> dict[str, Any]:
    """Run a scenario with all controllers and seeds as rows of one batch; return what is to be said of it.

    Raises:
        StoppedError: a signal came.
    """
    started = time.perf_counter()
    interrupts.check()
    try:
        simulation = Simulation(chosen)
        with console.progress(label, simulation.reference.frames, quiet) as show:

            def after_frame(frame: int) -> None:
                interrupts.check()
                show(frame + 1)

            simulation.run(after_frame)
    except OmniError as error:
        return {"status": "failed", "reason": " ".join(str(error).split())}
    trajectory = simulation.trajectory
    found = compare_statistics.results(trajectory)
    return {
        "status": "done",
        "simulated_s": trajectory.length * PERIOD_S,
        "wall_s": round(time.perf_counter() - started, 3),
        "results": found,
        "verdict": compare_statistics.verdict(found, _limits(chosen)),
    }


def _limits(chosen: Scenario) -> list[str]:
    """The controllers that are given the truth: no competitors."""
    names = zip(chosen.labels, chosen.controllers, strict=True)
    return [label for label, name in names if controllers.find(name).knows_truth]


def _save(result: dict[str, Any], started: float, folder: Path) -> None:
    """Write the table's files; each appears whole or not at all."""
    result["wall_s"] = round(time.perf_counter() - started, 3)
    texts = {
        "compare.json": json.dumps(result, indent=1, allow_nan=False) + "\n",
        "compare.md": compare_table.markdown(result),
    }
    for name, text in texts.items():
        partial = folder / f"{name}.partial"
        try:
            partial.write_text(text, encoding="utf-8")
            partial.replace(folder / name)
        finally:
            partial.unlink(missing_ok=True)


if __name__ == "__main__":
    console.invoke(command)
