"""What the study of alpha found: responses, what each cause takes of them, and alpha in use; as data and as a table."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from omni_control.kinematics import Array
from omni_mj.measure.metrics import ALPHA_MIN_SPEED_M_S, ALPHA_PERCENTILES, ALPHA_START_FRAMES, ALPHA_WINDOW_FRAMES
from omni_mj.measure.response import NAMES, Response
from omni_mj.measure.table import DASH, Table
from omni_mj.measure.table import text as aligned
from omni_mj.scenarios.settings import FRAME_RATE_HZ
from omni_mj.studies.conditions import CAUSES, LABELS, PROFILE, USUAL, WORN, Conditions, shares
from omni_mj.studies.drives import AXES, CONTROLLER, DIRECTIONS

DEFINITIONS = {
    "steady": "speed achieved / commanded in the last 0.5 s of the cruise",
    "speeding_up": "slope of the speed achieved over that commanded in the second half of the ramp up",
    "lag_s": "way missing after the ramp up and run on after that down, beside steady gain x way; / (2 gain speed)",
    "share": "mean over all orders in which the causes could be added to a robot without any; shares add up",
    "alone": "what a cause adds to a robot without any of them",
    "last": "what a cause adds to a robot with all the others",
    "alpha": (
        f"displacement achieved / commanded in windows of {ALPHA_WINDOW_FRAMES / FRAME_RATE_HZ:g} s, where in each"
        f" and the {ALPHA_START_FRAMES / FRAME_RATE_HZ:g} s before it more than {ALPHA_MIN_SPEED_M_S:g} m/s was"
        f" commanded along the axis; driven by {CONTROLLER}"
    ),
}
_UNITS = {"steady": (1.0, 3), "speeding_up": (1.0, 3), "lag_s": (1000.0, 0)}
_HEADINGS = ["steady gain: fwd", "side", "speeding up: fwd", "side", "lag, ms: fwd", "side"]


@dataclass(frozen=True)
class Study:
    """Responses, each with the directions of `DIRECTIONS` as its last axis, and alpha in use.

    Attributes:
        conditions: those that were changed alone, name -> values.
        base: of the robot as the scenario has it, (directions,).
        changed: condition -> under its values, (values, directions).
        caused: of a worn robot with every combination of `CAUSES`: an axis of two for each, then directions.
        wheels: of the worn robot's wheels, (directions,): what it would do if they did not slip.
        in_use: task -> axis -> percentiles of alpha.
    """

    conditions: Conditions
    base: Response
    changed: Mapping[str, Response]
    caused: Response
    wheels: Response
    in_use: Mapping[str, Mapping[str, Mapping[str, float]]]

    @property
    def worn(self) -> Response:
        """Of the worn robot, with all causes, (directions,)."""
        return self.caused.at((1,) * len(CAUSES))

    @property
    def loop(self) -> Response:
        """Of the same without any cause: what wheel loops and motors leave by themselves, (directions,)."""
        return self.caused.at((0,) * len(CAUSES))

    def shares(self, quantity: str) -> dict[str, dict[str, Array]]:
        """What each cause adds to a quantity of `Response`: cause -> share, alone, last -> (directions,)."""
        return shares(getattr(self.caused, quantity))

    def report(self) -> dict[str, Any]:
        """The study in plain values."""
        return {
            "definitions": DEFINITIONS,
            "directions": list(DIRECTIONS),
            "profile": vars(PROFILE),
            "base": _plain(self.base),
            "changed": {name: {"values": list(self.conditions[name])} | _plain(r) for name, r in self.changed.items()},
            "worn": {"conditions": WORN, **_plain(self.worn)},
            "worn_wheels": _plain(self.wheels),
            "wheel_loop_alone": _plain(self.loop),
            "causes": {
                name: {
                    cause: {how: _list(values) for how, values in each.items()}
                    for cause, each in self.shares(name).items()
                }
                for name in NAMES
            },
            "usual": {name: list(values) for name, values in USUAL.items()},
            "in_use": self.in_use,
        }

    def text(self) -> str:
        """The study as tables of plain text."""
        drive = f"{PROFILE.speed_m_s:g} m/s at {PROFILE.acceleration_m_s2:g} m/s²"
        worn = f"windings at {WORN['winding_c']:g} °C, battery at {100 * WORN['charge']:g} %"
        usual = "; ".join(f"{LABELS[name]} {', '.join(f'{v:g}' for v in values)}" for name, values in USUAL.items())
        tables = [
            Table(f"one condition changed, {drive}", ["", "", *_HEADINGS], list(self._conditions()), 2),
            Table(f"where gain and lag come from: {drive}, {worn}", ["", "", *_HEADINGS], list(self._causes()), 2),
            Table(
                f"alpha over {ALPHA_WINDOW_FRAMES / FRAME_RATE_HZ:g} s in use, driven by {CONTROLLER}; {usual}",
                ["", "", *(f"{p} %" for p in ALPHA_PERCENTILES)],
                list(self._ranges()),
                2,
            ),
        ]
        return "\n\n".join(aligned(table) for table in tables if table.rows)

    def _conditions(self) -> Iterator[list[str]]:
        yield ["as it is", "", *_cells(self.base)]
        for name, found in self.changed.items():
            for i, value in enumerate(self.conditions[name]):
                yield ["" if i else LABELS[name], f"{value:g}", *_cells(found.at(i))]

    def _causes(self) -> Iterator[list[str]]:
        yield ["wheel loop and back-EMF alone", "", *_cells(self.loop)]
        each = {name: self.shares(name) for name in NAMES}
        for how, meaning in (("share", "share of"), ("alone", "alone:"), ("last", "last of all:")):
            for cause in CAUSES:
                added = Response(*(each[name][cause][how] for name in NAMES))
                yield [f"{meaning} {cause}", "", *_cells(added, "+")]
            if how == "share":
                yield ["sum: the worn robot", "", *_cells(self.worn)]
                yield ["  of which its wheels turn", "", *_cells(self.wheels)]

    def _ranges(self) -> Iterator[list[str]]:
        for task, axes in self.in_use.items():
            for axis in AXES:
                cells = [f"{value:.2f}" for value in axes[axis].values()]
                yield [task, axis, *(cells or [DASH] * 3)]


def _cells(response: Response, sign: str = "") -> list[str]:
    """Forward and sideways of each quantity."""
    return [
        f"{factor * getattr(response, name)[j]:{sign}.{digits}f}"
        for name, (factor, digits) in _UNITS.items()
        for j in range(len(AXES))
    ]


def _plain(response: Response) -> dict[str, Any]:
    return {name: _list(getattr(response, name)) for name in NAMES}


def _list(values: Array) -> Any:
    """Nested lists, with None for what is not a number."""
    rounded = values.round(6).astype(object)
    rounded[np.isnan(values)] = None
    return rounded.tolist()
