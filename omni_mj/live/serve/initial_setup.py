"""Initial state of `serve`: the scenario of the robots, their numbers and their poses."""

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from omni_control.errors import OmniError
from omni_control.kinematics import Array
from omni_mj.config import distributions, scenario
from omni_mj.config.scenario import Scenario
from omni_mj.live.serve.detections import RobotName
from omni_mj.live.serve.served_world import MAX_ROBOTS
from omni_mj.live.serve.simulation_requests import MAX_NUMBER
from omni_mj.live.wire.league_pb2 import Team

# Without a scenario there is no dead time, and a robot stops soon after its last command, as in the
# league's simulators.
DEFAULT_OVERRIDES = "radio.delay_frames=0", "firmware.timeout_s=0.1"
SPACING_M = 0.5  # between robots of a team
ROBOTS_PER_COLUMN = 6


def load_served_scenario(
    name: str | None, overrides: Iterable[str], head: Mapping[str, Any]
) -> Scenario:
    """Load a scenario as `run` does.

    Args:
        name: Name or file of a scenario. None: the robot's settings, and `DEFAULT_OVERRIDES`.
        overrides: Settings, `section.field=value`.
        head: Fields of `Scenario` that replace the scenario's.

    Raises:
        OmniError: See `scenario.load_with_overrides`.
    """
    if name is None:
        overrides, head = [*DEFAULT_OVERRIDES, *overrides], {"name": "serve", **head}
    chosen = scenario.load_with_overrides(name, overrides, head)
    distributions.require_fixed_settings(chosen.distributions, "serve")
    if chosen.plant != "mujoco":
        raise OmniError(f"serve needs the plant mujoco, got {chosen.plant}")
    return chosen


def parse_robot_ids(text: str, option: str) -> list[int]:
    """Parse the number of robots (`3`) or a comma-separated list of robot numbers (`0,4,7`).

    Raises:
        OmniError: The text is neither.
    """
    words = [word.strip() for word in text.split(",") if word.strip()]
    if all(word.isdecimal() for word in words):
        values = [min(int(word), MAX_NUMBER + 2) for word in words]
        chosen = sorted(set(values)) if "," in text else list(range(sum(values)))
        if max(chosen, default=0) <= MAX_NUMBER:
            return chosen
    raise OmniError(
        f"{option} must be the number of robots, such as 3, or their numbers from 0 to "
        f"{MAX_NUMBER}, such as 0,4,7, got {text!r}"
    )


def starting_poses(blue: Iterable[int], yellow: Iterable[int]) -> dict[RobotName, Array]:
    """Return start poses: each team in columns on its half, facing the other team.

    Args:
        blue: Numbers of the blue robots.
        yellow: Numbers of the yellow robots.

    Raises:
        OmniError: There are none, or too many.
    """
    result = dict[RobotName, Array]()
    for team, team_numbers, side in ((Team.BLUE, blue, -1.0), (Team.YELLOW, yellow, 1.0)):
        for k, number in enumerate(team_numbers):
            x = SPACING_M * (1 + k // ROBOTS_PER_COLUMN)
            y = SPACING_M * ((ROBOTS_PER_COLUMN - 1) / 2 - k % ROBOTS_PER_COLUMN)
            result[team, number] = np.array([side * x, -side * y, 0.0 if side < 0 else np.pi])
    if not 1 <= len(result) <= MAX_ROBOTS:
        raise OmniError(
            f"--blue and --yellow together must be 1 to {MAX_ROBOTS} robots, got {len(result)}"
        )
    return result
