"""Who is served: the scenario of the robots, and where they stand at the start."""

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

# Without a scenario there is no dead time, and robots that receive nothing stop as in the league's
# simulators.
ALONE = "radio.delay_frames=0", "firmware.timeout_s=0.1"
SPACING_M, COLUMN = 0.5, 6  # of robots of a team, which stand in columns


def load(name: str | None, overrides: Iterable[str], head: Mapping[str, Any]) -> Scenario:
    """Load a scenario as `run` does.

    Args:
        name: Of a scenario or its file; without one, the robot's settings and the defaults count,
            and `ALONE`.
        overrides: `section.field=value`.
        head: Fields of `Scenario` in place of the scenario's.

    Raises:
        OmniError: See `scenario.load`.
    """
    if name is None:
        overrides, head = [*ALONE, *overrides], {"name": "serve", **head}
    chosen = scenario.load(name, overrides, head)
    distributions.refuse(chosen.distributions, "serve")
    if chosen.plant != "mujoco":
        raise OmniError(f"serve simulates the mujoco plant, not {chosen.plant}")
    return chosen


def numbers(text: str, option: str) -> list[int]:
    """Parse an option that says how many robots there are, or their numbers with commas between.

    Raises:
        OmniError: It says neither.
    """
    words = [word.strip() for word in text.split(",") if word.strip()]
    if all(word.isdecimal() for word in words):
        values = [min(int(word), MAX_NUMBER + 2) for word in words]
        chosen = sorted(set(values)) if "," in text else list(range(sum(values)))
        if max(chosen, default=0) <= MAX_NUMBER:
            return chosen
    raise OmniError(
        f"{option} takes how many robots, such as 3, or their numbers, such as 0,4,7, which are from 0 to "
        f"{MAX_NUMBER}, not {text!r}"
    )


def poses(blue: Iterable[int], yellow: Iterable[int]) -> dict[RobotName, Array]:
    """Return where robots stand at the start: in columns on their halves, facing each other.

    Args:
        blue: Numbers of its robots.
        yellow: Numbers of its robots.

    Raises:
        OmniError: There are none, or too many.
    """
    result = dict[RobotName, Array]()
    for team, team_numbers, side in ((Team.BLUE, blue, -1.0), (Team.YELLOW, yellow, 1.0)):
        for k, number in enumerate(team_numbers):
            x, y = SPACING_M * (1 + k // COLUMN), SPACING_M * ((COLUMN - 1) / 2 - k % COLUMN)
            result[team, number] = np.array([side * x, -side * y, 0.0 if side < 0 else np.pi])
    if not 1 <= len(result) <= MAX_ROBOTS:
        limits = f"a world has 1 to {MAX_ROBOTS} robots"
        raise OmniError(f"{limits}, --blue and --yellow together, not {len(result)}")
    return result
