"""What other teams tell of acceleration, tried on a simulated robot.

SSL-A-Team drives body accelerations open loop: wheel currents by a model of mass and drag, nothing fed back; A for half
a second, nothing, then -A; lines through the velocity of either ramp; how far their mean slope falls short of A.

ibis/crane (#649) reports from driving that accelerations of about 2 m/s^2 still kept positions. By the law of creep
wheels run ahead of the body by T0 (v^2 / 2 + D x / m), whatever the acceleration; what is beyond that is a limit's.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from omni_control.kinematics import Array
from omni_mj.measure.statistics import plain
from omni_mj.scenarios.scenario import Scenario
from omni_mj.scenarios.settings import PERIOD_S
from omni_mj.studies.outcome import AfterFrame, StoppedError, nothing
from omni_mj.studies.slip.figures import Robot, masses
from omni_mj.studies.slip.law import AXES, expected
from omni_mj.studies.slip.moves import REST_S, Move, longest
from omni_mj.studies.slip.published import A_TEAM
from omni_mj.studies.slip.record import drive, shares

RAMP = round(0.5 / PERIOD_S)  # frames
REST = round(REST_S / PERIOD_S)
ACCELERATIONS_M_S2 = (1.0, 2.0, 3.0, 4.0, 5.0)
SPEED_M_S, HELD_S = 1.5, 0.3
MOVES = [Move(kind, SPEED_M_S, a, HELD_S, False) for kind in ("forward", "sideways") for a in ACCELERATIONS_M_S2]
FRAMES = max(REST + 3 * RAMP, longest(MOVES))


@dataclass(frozen=True)
class Checks:
    """What came out.

    Attributes:
        shortfall: acceleration wanted, m/s^2 -> by which share the one reached open loop differs.
        ahead: "forward" and "sideways" -> acceleration in m/s^2 -> by how much wheels have run ahead of the body that
            speeds up to `SPEED_M_S`, and by how much the law says they should have for its speed and way, m.
    """

    shortfall: dict[float, float]
    ahead: dict[str, dict[float, tuple[float, float]]]

    def report(self) -> dict[str, Any]:
        """In plain values, None for what there is none of."""
        return {
            "open_loop": {
                f"{a:g}": {"differs_percent": plain(100 * share), "a_team_percent": 100 * A_TEAM[a]}
                for a, share in self.shortfall.items()
            },
            "wheels_ahead_m": {
                kind: {f"{a:g}": {"measured": plain(gap), "law": plain(law)} for a, (gap, law) in values.items()}
                for kind, values in self.ahead.items()
            },
        }

    def lines(self) -> Iterator[str]:
        """As text."""
        yield "open loop, acceleration reached against that wanted (SSL-A-Team's robot):"
        both = (f"{a:g} m/s²: {100 * s:+.1f} % ({100 * A_TEAM[a]:+.0f} %)" for a, s in self.shortfall.items())
        yield "  " + ", ".join(both)
        yield f"wheels ahead of the body at {SPEED_M_S:g} m/s (by the law), cm:"
        for kind, values in self.ahead.items():
            each = (f"{a:g} m/s²: {100 * gap:.1f} ({100 * law:.1f})" for a, (gap, law) in values.items())
            yield f"  {kind.ljust(8)}  " + ", ".join(each)


def checks(scenario: Scenario, robot: Robot, after_frame: AfterFrame = nothing) -> Checks:
    """Try them on a robot whose figures are known; the open loop's model is made of its drag and efficiency.

    Raises:
        StoppedError: as `after_frame` does.
    """
    commands = np.zeros((FRAMES, len(A_TEAM) + len(MOVES), 3))
    held = np.full((FRAMES, commands.shape[1], len(scenario.settings.wheels.azimuths_deg)), np.nan)
    mass, _ = masses(robot.name, scenario.settings)
    drag, efficiency = robot.measured["drag_forward"], robot.measured["efficiency_accelerating"]
    for i, wanted in enumerate(A_TEAM):
        for ramp, acceleration in enumerate((wanted, 0.0, -wanted)):
            force = (mass * acceleration + drag) / efficiency
            held[REST + ramp * RAMP : REST + (ramp + 1) * RAMP, i] = shares([force, 0, 0], scenario.settings)
        held[REST + 3 * RAMP :, i] = 0.0
    for i, move in enumerate(MOVES, len(A_TEAM)):
        commands[:, i] = move.commands(FRAMES)
    record = drive(scenario, commands, held, after_frame)
    if record.stopped:
        raise StoppedError(record.stopped)
    ahead: dict[str, dict[float, tuple[float, float]]] = {"forward": {}, "sideways": {}}
    known = expected(scenario.settings)
    for i, move in enumerate(MOVES, len(A_TEAM)):
        end, axis = round(move.times[1] / PERIOD_S), AXES[move.kind]
        wheels, body = record.wheels[:end, i, axis], record.body[:end, i, axis]
        softness = known.time[axis] / known.gain[axis] ** 2
        way, energy = PERIOD_S * body.sum(), body[-1] ** 2 / 2
        law = softness * (energy + known.drag[axis] / scenario.settings.body.mass_kg * way)
        ahead[move.kind][move.acceleration] = float(PERIOD_S * wheels.sum() - way), float(law)
    return Checks({a: _slope(record.body[:, i, 0]) / a - 1 for i, a in enumerate(A_TEAM)}, ahead)


def _slope(v: Array) -> float:
    """Mean magnitude of the slopes of lines through both ramps, m/s^2."""
    time = PERIOD_S * np.arange(RAMP)
    up, down = (np.polyfit(time, v[REST + ramp * RAMP :][:RAMP], 1)[0] for ramp in (0, 2))
    return float(abs(up) + abs(down)) / 2
