"""What to drive so that logs tell everything: moves forward, sideways, diagonal and turning, at several speeds."""

import math
from dataclasses import dataclass

import numpy as np

from omni_mj.measure.table import Table, text
from omni_mj.scenarios.references import timed
from omni_mj.scenarios.robots import DEFAULT
from omni_mj.scenarios.scenario import Scenario, scenario
from omni_mj.scenarios.settings import PERIOD_S

# Within traction, with room for what the controller adds: wheels that slide tell less of how they creep.
AHEAD_M_S2, ASIDE_M_S2, TURN_RAD_S2 = 2.0, 1.6, 20.0
LENGTHS_M = (0.1, 0.4, 0.9, 1.6)  # of which moves reach 0.4, 0.9, 1.3 and 1.8 m/s at 2 m/s^2
ANGLES_RAD = (0.8, 1.8, 3.0, 3.1)
TOP_M_S, TOP_RAD_S = 2.5, 8.0
LAPS = 1
JITTER = "jitter of the delay is in none of these moves: log received_s, when the robot got each command"
DIRECTIONS = {"forward": 0.0, "sideways": 0.5 * math.pi, "diagonal": 0.25 * math.pi}


@dataclass(frozen=True)
class Plan:
    """Moves to drive.

    Attributes:
        scenario: that drives them, within what the robot's wheels can push.
        moves: direction, way in m or rad, and speed that is reached, in m/s or rad/s.
    """

    scenario: Scenario
    moves: list[tuple[str, float, float]]

    def table(self) -> str:
        """The moves as lines of text."""
        rows = [
            [way, f"{length:.2f} {'rad' if way == 'turning' else 'm'}", f"{top:.2f}"] for way, length, top in self.moves
        ]
        seconds = len(timed(self.scenario.settings).poses) * PERIOD_S
        title = (
            f"moves there and back, {seconds:.0f} s, more by reference.laps, 2 x 2 m of carpet; speeds in m/s, rad/s"
        )
        return text(Table(title, ["move", "way", "reaches"], rows, 1)) + f"\n{JITTER}"


def plan(robot: str = DEFAULT, model: str | None = None) -> Plan:
    """Moves for a robot.

    Args:
        robot: name or file.
        model: its MJCF, if it is a user's own.

    Raises:
        OmniError: there is no such robot, or its wheels cannot drive them.
    """
    points, ends = [(0.0, 0.0, 0.0)], list[tuple[str, float]]()
    for length, angle in zip(LENGTHS_M, ANGLES_RAD, strict=True):
        for way, direction in DIRECTIONS.items():
            points += [(length * math.cos(direction), length * math.sin(direction), 0.0), points[0]]
            ends.append((way, length))
        points += [(0.0, 0.0, angle), points[0]]
        ends.append(("turning", angle))
    reference = {
        "waypoints": [[round(x, 4) for x in point] for point in points],
        "laps": LAPS,
        "dwell_s": 0.15,
        "max_speed_m_s": TOP_M_S,
        "max_acceleration_m_s2": AHEAD_M_S2,
        "max_side_acceleration_m_s2": ASIDE_M_S2,
        "max_turn_rate_rad_s": TOP_RAD_S,
        "max_turn_acceleration_rad_s2": TURN_RAD_S2,
    }
    chosen = scenario("rect", robot=robot, model=model or {}, reference=reference, controllers=["comp-flc"], seeds=1)
    chosen = chosen.replace(
        name="plan", description="moves that identify a robot: omni-mj identify --plan", paper_table=0
    )
    poses = timed(chosen.settings).poses
    twist = np.diff(poses, axis=0) / PERIOD_S
    moves = []
    for way, length in ends:  # the reference passes each way's end once in the first lap, in order
        target = length * np.exp(1j * DIRECTIONS.get(way, 0.0))
        goal = [0.0, 0.0, length] if way == "turning" else [target.real, target.imag, 0.0]
        at = int(np.argmin(np.abs(poses - goal).sum(1)))
        speed = np.abs(twist[:, 2]) if way == "turning" else np.hypot(*twist[:, :2].T)
        before = at - int(np.argmax(speed[at - 2 :: -1] <= 1e-6)) - 2
        moves.append((way, length, float(speed[max(before, 0) : at].max())))
    return Plan(chosen, moves)
