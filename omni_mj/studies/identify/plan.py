"""What to drive so that logs tell everything: moves forward, sideways, diagonal and turning, at several speeds."""

import math
from dataclasses import dataclass

from omni_mj.measure.table import Table, text
from omni_mj.scenarios.references import timed
from omni_mj.scenarios.robots import DEFAULT
from omni_mj.scenarios.scenario import Scenario, scenario
from omni_mj.scenarios.settings import PERIOD_S

LENGTHS_M = (0.1, 0.4, 0.9, 1.6)  # of which moves reach 0.4, 0.9, 1.3 and 1.8 m/s at 2 m/s^2
ANGLES_RAD = (0.8, 1.8, 3.0, 3.1)
DIRECTIONS = {"forward": 0.0, "sideways": 0.5 * math.pi, "diagonal": 0.25 * math.pi}
LIMITS = {  # within traction, with room for what the controller adds: wheels that slide tell less of their creep
    "max_speed_m_s": 2.5,
    "max_acceleration_m_s2": 2.0,
    "max_side_acceleration_m_s2": 1.6,
    "max_turn_rate_rad_s": 8.0,
    "max_turn_acceleration_rad_s2": 20.0,
}
JITTER = "jitter of the delay is in none of these moves: log received_s, when the robot got each command"


@dataclass(frozen=True)
class Plan:
    """Moves to drive.

    Attributes:
        scenario: that drives them.
        moves: direction, and way in m or rad.
    """

    scenario: Scenario
    moves: list[tuple[str, float]]

    def table(self) -> str:
        """Return the moves as lines of text."""
        rows = [[way, f"{length:.2f} {'rad' if way == 'turning' else 'm'}"] for way, length in self.moves]
        seconds = len(timed(self.scenario.settings).poses) * PERIOD_S
        title = f"moves there and back, {seconds:.0f} s, more by reference.laps, 2 x 2 m of carpet"
        return text(Table(title, ["move", "way"], rows, 1)) + f"\n{JITTER}"


def plan(robot: str = DEFAULT, model: str | None = None) -> Plan:
    """Return moves for a robot.

    Args:
        robot: name or file.
        model: its MJCF, if it is a user's own.

    Raises:
        OmniError: there is no such robot, or its wheels cannot drive them.
    """
    points, moves = [[0.0, 0.0, 0.0]], list[tuple[str, float]]()
    for length, angle in zip(LENGTHS_M, ANGLES_RAD, strict=True):
        for way, direction in DIRECTIONS.items():
            points += [[round(length * math.cos(direction), 4), round(length * math.sin(direction), 4), 0.0], points[0]]
            moves.append((way, length))
        points += [[0.0, 0.0, angle], points[0]]
        moves.append(("turning", angle))
    reference = {"waypoints": points, "laps": 1, "dwell_s": 0.15, **LIMITS}
    chosen = scenario("rect", robot=robot, model=model or {}, reference=reference, controllers=["comp-flc"], seeds=1)
    says = "moves that identify a robot: omni-mj identify --plan"
    return Plan(chosen.replace(name="plan", description=says, paper_table=0), moves)
