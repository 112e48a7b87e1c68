"""Which of the settings that are drawn matters: Sobol's indices or Morris's effects, by SALib.

I. M. Sobol, Math. Comput. Simul. 55 (2001); A. Saltelli et al., Comput. Phys. Commun. 181 (2010): of the variance of an
error, which part a setting makes by itself (first order), and which with all others (total). M. D. Morris,
Technometrics 33 (1991): how much an error changes with a setting on average, and how unlike that change is from place
to place. Runs share their seeds, so that noise is the same in all.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from omni_control.controllers.base import Controller
from omni_control.errors import OmniError
from omni_control.kinematics import Array
from omni_mj.measure.statistics import plain
from omni_mj.scenarios.scenario import Scenario
from omni_mj.studies.run import chosen
from omni_mj.studies.sweep.cells import SHOWN
from omni_mj.studies.sweep.plan import AT_ONCE, Axis, Plan

if TYPE_CHECKING:
    from omni_mj.studies.sweep.study import Sweep

NUMBERS = {"sobol": ("S1", "S1_conf", "ST", "ST_conf"), "morris": ("mu_star", "mu_star_conf", "sigma")}
MOST = 1 << 16
FAILED = "failed"


@dataclass(frozen=True)
class Design:
    """How settings are sampled.

    Args:
        method: "sobol" or "morris".
        samples: N: Sobol's takes N (D + 2) runs for D settings, N a power of two; Morris's N (D + 1).

    Raises:
        OmniError: there is no such method, or N is not allowed.
    """

    method: str
    samples: int

    def __post_init__(self) -> None:
        if self.method not in NUMBERS:
            raise OmniError(f"sensitivity must be one of {', '.join(NUMBERS)}, not {self.method}")
        if not 2 <= self.samples <= MOST or (self.method == "sobol" and self.samples & (self.samples - 1)):
            power = ", a power of two" if self.method == "sobol" else ""
            raise OmniError(f"samples must be from 2 to {MOST}{power}, not {self.samples}")

    def cube(self, names: Sequence[str]) -> Array:
        """Samples in the unit cube (runs, D); always the same."""
        sample, problem = _salib("sample", self.method), _problem(names)
        if self.method == "sobol":
            return sample.sample(problem, self.samples, calc_second_order=False, seed=0)
        return sample.sample(problem, self.samples, num_levels=4, seed=0)

    def analysed(self, names: Sequence[str], values: Array) -> list[dict[str, float | None]]:
        """The numbers of each setting, of which those called `conf` are half of a 95 % interval.

        Args:
            names: of the settings.
            values: of the runs, in the order of `cube`, (runs,).
        """
        if np.ptp(values) == 0:  # nothing changes, of which no part is anything's
            return [dict.fromkeys(NUMBERS[self.method]) for _ in names]
        analyze, problem = _salib("analyze", self.method), _problem(names)
        if self.method == "sobol":
            found = analyze.analyze(problem, values, calc_second_order=False, seed=0)
        else:
            found = analyze.analyze(problem, self.cube(names), values, num_levels=4, seed=0)
        return [{key: plain(found[key][i]) for key in NUMBERS[self.method]} for i in range(len(names))]


def plan(
    scenario: Scenario | str,
    design: Design,
    controllers: Sequence[str | type[Controller]] | None = None,
    seeds: Iterable[int] | None = None,
    at_once: int = AT_ONCE,
) -> Plan:
    """The sweep over samples of all that a scenario draws.

    Raises:
        OmniError: it draws nothing, or from a distribution without ends of which Morris's method needs them.
    """
    there = chosen(scenario, controllers, seeds)
    drawn = there.distributions
    if not drawn:
        raise OmniError("nothing is drawn: --set carpet.friction='{uniform = [0.4, 0.9]}' says from what")
    endless = [name for name, each in drawn.items() if not each.ends]
    if endless and design.method == "morris":
        raise OmniError(f"morris needs distributions that have ends; give some to {', '.join(endless)}")
    cube = design.cube(list(drawn))
    axes = [
        Axis(name, tuple(each.quantile(float(u)) for u in cube[:, i])) for i, (name, each) in enumerate(drawn.items())
    ]
    return Plan(there, tuple(axes), at_once, (design.method, design.samples))


def indices(found: "Sweep") -> list[dict[str, Any]]:
    """What each setting does to each controller's errors, and to whether it fails, a dictionary for each of these.

    Keys are controller, of, setting, and the numbers; None where a robot failed, whose error has no bound, or where
    nothing changes. Of several seeds and places, the mean.

    Raises:
        OmniError: the sweep was made for another purpose, or is not complete.
    """
    if not found.plan.design:
        raise OmniError(f"{found.folder} holds a sweep over a grid, which says nothing of parts of variance")
    if not found.complete:
        raise OmniError(f"{found.folder} is not complete; go on with it first")
    design, table, names = Design(*found.plan.design), found.rows(), [axis.name for axis in found.plan.axes]
    point, controller = (table[name].to_numpy(zero_copy_only=False) for name in ("point", "controller"))
    columns = {name: table[name].to_numpy(zero_copy_only=False) for name in SHOWN}
    columns[FAILED] = (~np.isnan(table["failed_at_s"].to_numpy(zero_copy_only=False))).astype(float)
    lines = []
    for label in found.plan.scenario.labels:
        own = controller == label
        for name, values in columns.items():
            sums = np.bincount(point[own], values[own], len(found.plan.points))
            means = sums / np.bincount(point[own], minlength=len(found.plan.points))
            parts = (
                design.analysed(names, means)
                if np.isfinite(means).all()
                else [dict.fromkeys(NUMBERS[design.method]) for _ in names]
            )
            lines += [
                {"controller": label, "of": name, "setting": setting, **part}
                for setting, part in zip(names, parts, strict=True)
            ]
    return lines


def _problem(names: Sequence[str]) -> dict[str, Any]:
    return {"num_vars": len(names), "names": list(names), "bounds": [[0.0, 1.0]] * len(names)}


def _salib(part: str, method: str) -> Any:
    from importlib import import_module

    try:
        return import_module(f"SALib.{part}.{method}")
    except ModuleNotFoundError as error:
        if error.name != "SALib":
            raise
        raise OmniError("sensitivity needs the package SALib: pip install 'omni-mj[sensitivity]'") from None
