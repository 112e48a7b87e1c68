"""A robot's figures from its record: what is fitted to each move, and the means over moves."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from omni_control.kinematics import Array
from omni_mj.measure.statistics import plain
from omni_mj.scenarios.settings import PERIOD_S, Settings
from omni_mj.studies.slip.fits import AT_REST, efficiency, fit_drag, fit_law
from omni_mj.studies.slip.law import AXES, expected
from omni_mj.studies.slip.moves import Move
from omni_mj.studies.slip.published import INERTIA_SHARE, PUBLISHED
from omni_mj.studies.slip.record import Record

# Name -> what it is called, unit, digits behind the point.
QUANTITIES = {
    "gain_forward": ("gain K forward", "", 3),
    "gain_sideways": ("gain K sideways", "", 3),
    "gain_turning": ("gain K turning", "", 3),
    "time_forward": ("T forward", "s²/m", 4),
    "time_sideways": ("T sideways", "s²/m", 4),
    "time_turning": ("T turning", "s²/m", 4),
    "drag_forward": ("roll-out drag forward", "N", 2),
    "drag_turning": ("roll-out drag turning", "N m", 3),
    "efficiency": ("efficiency", "", 3),
    "efficiency_turning": ("efficiency turning", "", 3),
}
FITTED = ("gain", "time", "deceleration", "efficiency")


@dataclass(frozen=True)
class Robot:
    """What came out of one robot.

    Attributes:
        name: of the robot.
        moves: that it drove, n of them.
        fitted: by the names of `FITTED`, (n,) each; not a number where a move does not tell.
        measured: by the names of `QUANTITIES`; not a number where nothing tells.
        law: the same, of what the law of creep says in closed form.
        wheels, body: speed along each move by the encoders, and of the body, (F, n).
    """

    name: str
    moves: Sequence[Move]
    fitted: Mapping[str, Array]
    measured: Mapping[str, float]
    law: Mapping[str, float]
    wheels: Array
    body: Array

    @property
    def published(self) -> Mapping[str, float]:
        """What its team measured, by the names of `QUANTITIES`."""
        return PUBLISHED[self.name].values if self.name in PUBLISHED else {}

    def deviation(self, quantity: str) -> float:
        """Return by how much what was measured differs from what was published, %."""
        return 100 * (self.measured[quantity] / self.published.get(quantity, float("nan")) - 1)

    def report(self) -> dict[str, Any]:
        """Return its figures in plain values, None for what there is none of."""
        quantities = {
            name: {
                "unit": unit,
                "measured": plain(self.measured[name]),
                "law": plain(self.law.get(name, float("nan"))),
                "published": self.published.get(name),
                "deviation_percent": plain(self.deviation(name)),
            }
            for name, (_, unit, _) in QUANTITIES.items()
        }
        return {"source": PUBLISHED[self.name].source if self.name in PUBLISHED else None, "quantities": quantities}


def figures(name: str, settings: Settings, moves: Sequence[Move], record: Record) -> Robot:
    """Fit everything that the record tells.

    Decelerations are turned into drag by the mass and inertia of the team's fit, where it has published one.
    """
    ways = np.array([np.copysign(1.0, move.speed) * move.direction for move in moves])
    wheels, body, force = ((values * ways).sum(-1) for values in (record.wheels, record.body, record.force))
    arm, frames, kinds = settings.wheels.arm_m, len(wheels), np.array([move.kind for move in moves])
    mass, inertia = settings.body.mass_kg, settings.body.yaw_inertia_kg_m2
    if name in PUBLISHED:
        mass, inertia = PUBLISHED[name].mass_kg, INERTIA_SHARE * PUBLISHED[name].mass_kg * arm**2
    fitted = {quantity: np.full(len(moves), np.nan) for quantity in FITTED}
    failed, turning = {failure.row for failure in record.simulation.failures}, kinds == "turning"
    living = [(i, move) for i, move in enumerate(moves) if i not in failed]
    rolling = np.where(turning, body, np.hypot(record.body[..., 0], record.body[..., 1]))  # a robot let go may turn
    for i, move in living:
        used, lever = slice(move.frames), arm if turning[i] else 1.0
        if move.rolls_out:
            fitted["deceleration"][i] = fit_drag(rolling[used, i], move.free(frames)[used], PERIOD_S, AT_REST / lever)
        if turning[i] or not move.rolls_out:
            along = np.hypot(*record.wheels[used, i, :2].T) + arm * np.abs(record.wheels[used, i, 2]) * turning[i]
            law = fit_law(wheels[used, i], along, body[used, i], PERIOD_S)
            fitted["gain"][i], fitted["time"][i] = law.gain, law.time
    measured = {f"{what}_{axis}": _mean(fitted[what][kinds == axis]) for what in ("gain", "time") for axis in AXES}
    for kind, weight in (("forward", mass), ("turning", inertia)):
        drag = measured[f"drag_{kind}"] = weight * _mean(fitted["deceleration"][kinds == kind])
        for i, move in living:
            if move.rolls_out and move.kind == kind:
                spans = move.holding(frames), move.accelerating(frames)
                pull = np.abs(force[:, i])
                fitted["efficiency"][i] = efficiency(body[:, i], pull, *spans, drag, weight, PERIOD_S)
    measured["efficiency"] = _mean(fitted["efficiency"][~turning])
    measured["efficiency_turning"] = _mean(fitted["efficiency"][turning])
    law_of, closed = expected(settings), dict[str, float]()
    for axis, i in AXES.items():
        drag = (inertia if axis == "turning" else mass) * law_of.deceleration[i]
        closed |= {f"gain_{axis}": law_of.gain[i], f"time_{axis}": law_of.time[i], f"drag_{axis}": float(drag)}
    return Robot(name, list(moves), fitted, measured, closed, wheels, body)


def _mean(values: Array) -> float:
    known = values[~np.isnan(values)]
    return float(known.mean()) if known.size else float("nan")
