"""Who is served: the scenario of each team's robots, and where they stand at the start."""

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from omni_control.errors import OmniError
from omni_control.kinematics import Array
from omni_mj.live.serve.cameras import RobotName
from omni_mj.live.serve.control import MAX_NUMBER
from omni_mj.live.serve.pitch import MAX_ROBOTS
from omni_mj.live.wire.simulation_pb2 import Team
from omni_mj.scenarios import distributions, references, scenario
from omni_mj.scenarios.scenario import Scenario

TIMEOUT_S = 0.1  # after which robots stop, as in the league's simulators
SPACING_M, COLUMN = 0.5, 6  # of robots of a team, which stand in columns


def load(name: str | None, overrides: Iterable[str], head: Mapping[str, Any]) -> Scenario:
    """Load a scenario as `run` does, with robots that stop when they receive nothing.

    Args:
        name: Of a scenario or its file; without one, the robot's settings and the defaults count, without dead time.
        overrides: `section.field=value`.
        head: Fields of `Scenario` in place of the scenario's.

    Raises:
        OmniError: See `scenario.load`.
    """
    overrides = tuple(overrides)
    if name is None:
        chosen = scenario.load(name, ["radio.delay_frames=0", *overrides], {"name": "serve"} | dict(head))
    else:
        chosen = scenario.load(name, overrides, head)
    distributions.refuse(chosen.distributions, "serve")
    if chosen.plant != "mujoco":
        raise OmniError(f"serve simulates the mujoco plant, not {chosen.plant}")
    settings = chosen.settings
    is_timeout_set = any(override.split("=")[0].strip() == "firmware.timeout_s" for override in overrides)
    if not is_timeout_set and not settings.firmware.timeout_s:
        settings = settings.replace(firmware={"timeout_s": TIMEOUT_S})
    return chosen.replace(settings=settings)


def check_together(blue: Scenario, yellow: Scenario) -> None:
    """Check that one world can hold the robots of both teams.

    Raises:
        OmniError: The wheels of one team creep and the other's do not, or they need other physics.
    """
    one, other = ({"wheels.creep": s.wheels.creep, "physics": s.physics} for s in (blue.settings, yellow.settings))
    if differing := [name for name in one if one[name] != other[name]]:
        raise OmniError(
            f"--yellow-robot {yellow.robot}: robots of one world have the same {' and '.join(differing)}, and it "
            f"differs from {blue.robot}; all else may differ"
        )


def numbers(text: str, option: str) -> list[int]:
    """Parse an option that says how many robots there are, or their numbers with commas between.

    Raises:
        OmniError: It says neither, or names a robot twice.
    """
    words = [word.strip() for word in text.split(",") if word.strip()]
    values = [int(word) if word.isdecimal() else -1 for word in words]
    result = values if "," in text or values == [-1] else list(range(sum(values)))
    if len(set(result)) < len(result) or not set(result) <= set(range(MAX_NUMBER + 1)):
        raise OmniError(
            f"{option} takes how many robots, such as 3, or their numbers, such as 0,4,7, which differ and are from 0 "
            f"to {MAX_NUMBER}, not {text!r}"
        )
    return result


def poses(blue: Iterable[int], yellow: Iterable[int], leading: Scenario | None) -> dict[RobotName, Array]:
    """Return where robots stand at the start: in columns on their halves, facing each other.

    Args:
        blue: Numbers of its robots.
        yellow: Numbers of its robots.
        leading: Scenario at whose places the first blue robots start; None if all stand in columns.

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
    if leading is not None:
        for name, (x, y, heading) in zip(result, leading.settings.world.places, strict=False):
            if name[0] == Team.BLUE:
                result[name] = references.timed(leading.settings, (x, y, heading)).poses[0]
    return result
