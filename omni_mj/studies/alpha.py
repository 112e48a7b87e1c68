"""`python -m omni_mj.alpha`: how the motor correction factor alpha comes out of friction, heat, battery and lint.

Robots drive standard velocity profiles, each combination of conditions in a robot of its own; nothing but the firmware
is between the profile and the wheels: no camera, no tracker, no dead time.
"""

import itertools
import json
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import click
import numpy as np

from omni_control.kinematics import Array
from omni_mj.cli import console, folders
from omni_mj.link.radio import Received
from omni_mj.measure.metrics import ALPHA_PERCENTILES, ALPHA_WINDOW_FRAMES, alpha_windows
from omni_mj.measure.summary import versions
from omni_mj.plants.mujoco import MujocoPlant
from omni_mj.scenarios import scenario
from omni_mj.scenarios.settings import FRAME_RATE_HZ, PERIOD_S, Settings
from omni_mj.show import alpha_figure

Conditions = dict[str, tuple[float, ...]]
CONDITIONS: Conditions = {
    "friction": (0.3, 0.4, 0.5, 0.7, 0.9, 1.0),
    "winding_c": (25.0, 75.0, 120.0),
    "charge": (1.0, 0.5, 0.15),
    "lint": (0.03, 0.065, 0.15),
}
DIRECTIONS = {"x": (1.0, 0.0), "y": (0.0, 1.0), "diagonal": (0.5**0.5, 0.5**0.5)}
SPEED_M_S, ACCELERATION_M_S2 = 1.5, 3.0
# The windows of 0.25 s: the ramp takes two, then the profile cruises; what follows a change of slope is left out.
PHASES = {"accelerating": range(2), "cruising": range(3, 6)}
FRAMES = ALPHA_WINDOW_FRAMES * 6
# What real robots meet, over which the paper's interval [0.7, 1] should come out.
USUAL = {"friction": (0.5, 0.9), "winding_c": (25.0, 120.0), "charge": (0.15, 1.0), "lint": (0.065, 0.065)}


@dataclass(frozen=True)
class Study:
    """alpha over friction, winding temperature, charge, lint, direction and window, in this order of axes.

    `conditions` are the values of the first four.
    """

    conditions: Conditions
    alpha: Array

    def phase(self, name: str) -> Array:
        """The windows of one phase."""
        return self.alpha[..., list(PHASES[name])]

    def usual(self) -> Array:
        """Both phases under the conditions of `USUAL`, flat."""
        inside = np.ix_(*(_inside(values, USUAL[name]) for name, values in self.conditions.items()))
        return np.concatenate([self.phase(name)[inside].ravel() for name in PHASES])

    def trend(self, condition: str) -> Array:
        """Mean of alpha over everything but one condition, in the order of its values."""
        axis = list(self.conditions).index(condition)
        both = np.concatenate([self.phase(name) for name in PHASES], axis=-1)
        mean: Array = both.mean(tuple(i for i in range(both.ndim) if i != axis))
        return mean


def profile() -> Array:
    """The commanded speed in each frame, m/s: a ramp, then constant."""
    return np.minimum(SPEED_M_S, ACCELERATION_M_S2 * PERIOD_S * np.arange(1, FRAMES + 1))


def run(
    settings: Settings, conditions: Conditions = CONDITIONS, progress: Callable[[int], None] = lambda frame: None
) -> Study:
    """Drive the profiles under all combinations of `conditions`, everything else as in `settings`.

    Hot windings come with a housing as warm as it gets in equilibrium with them.
    """
    rows = [_under(settings, *values) for values in itertools.product(*conditions.values()) for _ in DIRECTIONS]
    heading = np.tile(list(DIRECTIONS.values()), (len(rows) // len(DIRECTIONS), 1))
    plant = MujocoPlant(rows, np.zeros((len(rows), 3)), [0] * len(rows), FRAMES)
    along = [np.zeros(len(rows))]
    for frame, speed in enumerate(profile()):
        plant.advance(frame, Received.at_once(np.pad(speed * heading, ((0, 0), (0, 1)))))
        along.append((plant.pose()[:, :2] * heading).sum(1))
        progress(frame + 1)
    command = np.append(profile(), 0.0)[:, None] * np.ones(len(rows))
    windows = alpha_windows(np.array(along), command)[::ALPHA_WINDOW_FRAMES]
    shape = [len(values) for values in conditions.values()] + [len(DIRECTIONS), len(windows)]
    return Study(conditions, windows.T.reshape(shape))


def report(study: Study, settings: Settings, wall_s: float) -> dict[str, Any]:
    """The study as what alpha.json holds."""
    return {
        "definition": f"displacement achieved / commanded along the drive, windows of {ALPHA_WINDOW_FRAMES} frames",
        "profile": {"speed_m_s": SPEED_M_S, "acceleration_m_s2": ACCELERATION_M_S2, "rate_hz": FRAME_RATE_HZ},
        "axes": {**study.conditions, "direction": list(DIRECTIONS)},
        "alpha": {name: study.phase(name).mean(-1).round(6).tolist() for name in PHASES},
        "windows": {name: [round(i * ALPHA_WINDOW_FRAMES * PERIOD_S, 6) for i in PHASES[name]] for name in PHASES},
        "trends": {name: study.trend(name).round(6).tolist() for name in study.conditions},
        "usual": {"conditions": USUAL, **_percentiles(study.usual())},
        "firmware": settings.plain()["firmware"],
        "wall_s": round(wall_s, 3),
        "versions": versions(),
    }


def _percentiles(values: Array) -> dict[str, float]:
    return {f"p{p}": round(float(np.percentile(values, p)), 6) for p in ALPHA_PERCENTILES}


def _under(settings: Settings, friction: float, winding_c: float, charge: float, lint: float) -> Settings:
    motor = settings.motor
    share = motor.housing_ambient_k_w / (motor.housing_ambient_k_w + motor.winding_housing_k_w)
    housing_c = motor.ambient_c + share * (winding_c - motor.ambient_c)
    return settings.replace(
        carpet={"friction": friction, "lint": lint},
        motor={"winding_c": winding_c, "housing_c": housing_c},
        battery={"charge": charge},
    )


def _inside(values: Sequence[float], bounds: tuple[float, float]) -> list[int]:
    return [i for i, value in enumerate(values) if bounds[0] <= value <= bounds[1]]


@click.command("alpha")
@click.option("--set", "overrides", metavar="SECTION.FIELD=VALUE", multiple=True, help="A setting; see run --list.")
@click.option("--out", type=click.Path(path_type=Path), metavar="DIR", help="[runs/alpha-<UTC time>]")
@click.option("--overwrite", is_flag=True, help="Replace the files of an earlier study in --out.")
@click.option("--quiet", is_flag=True, help="Print nothing but errors.")
def command(overrides: tuple[str, ...], out: Path | None, overwrite: bool, quiet: bool) -> None:
    """Map alpha over carpet friction, winding temperature, battery charge and lint."""
    settings = scenario.load("rect", overrides).settings
    folder = folders.prepare(out, "alpha", ("alpha.json", "alpha.png"), overwrite)
    started = time.perf_counter()
    with console.progress("alpha", FRAMES, quiet) as show:
        study = run(settings, progress=show)
    result = report(study, settings, time.perf_counter() - started)
    (folder / "alpha.json").write_text(json.dumps(result, indent=1) + "\n", encoding="utf-8")
    alpha_figure.save(study, folder / "alpha.png")
    if not quiet:
        console.print_alpha(result, folder)


if __name__ == "__main__":
    console.invoke(command)
