"""Initial state of `serve`: the scenario of the robots, their numbers and their poses."""

import time
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from omni_control.errors import OmniError
from omni_control.kinematics import Array
from omni_mj.config import CYCLE_RATE_HZ, CYCLES_PER_FRAME, distributions, scenario
from omni_mj.config.scenario import Scenario
from omni_mj.live.serve.detections import RobotName
from omni_mj.live.serve.served_world import MAX_ROBOTS, ServedWorld
from omni_mj.live.serve.simulation_requests import MAX_NUMBER
from omni_mj.live.sockets import MessageCounter
from omni_mj.live.wire.league_pb2 import LocalVelocity, MoveCommand, RobotCommand, Team

# Without a scenario there is no dead time, and a robot stops soon after its last command, as in the
# league's simulators.
DEFAULT_OVERRIDES = "radio.delay_frames=0", "firmware.timeout_s=0.1"
SPACING_M = 0.5  # between robots of a team, less on a small field
ROBOTS_PER_COLUMN = 6  # a team has at most three columns
WARM_UP_CYCLES, MEASURED_CYCLES = 32, 192  # to measure the load


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
    if chosen.plant not in MAX_ROBOTS:
        raise OmniError(f"serve needs the plant {' or '.join(MAX_ROBOTS)}, got {chosen.plant}")
    if chosen.settings.physics.backend == "jax":
        raise OmniError("serve needs physics.backend = numpy or auto, got jax")
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


def starting_poses(
    blue: Iterable[int], yellow: Iterable[int], chosen: Scenario
) -> dict[RobotName, Array]:
    """Return start poses: each team in columns on its half, facing the other team.

    Args:
        blue: Numbers of the blue robots.
        yellow: Numbers of the yellow robots.
        chosen: Scenario with the plant and the size of the field.

    Raises:
        OmniError: There are none, or too many.
    """
    result, world = dict[RobotName, Array](), chosen.settings.world
    spacing = min(SPACING_M, world.field_length_m / 8, world.field_width_m / ROBOTS_PER_COLUMN)
    for team, team_numbers, side in ((Team.BLUE, blue, -1.0), (Team.YELLOW, yellow, 1.0)):
        for k, number in enumerate(team_numbers):
            x = spacing * (1 + k // ROBOTS_PER_COLUMN)
            y = spacing * ((ROBOTS_PER_COLUMN - 1) / 2 - k % ROBOTS_PER_COLUMN)
            result[team, number] = np.array([side * x, -side * y, 0.0 if side < 0 else np.pi])
    limit = MAX_ROBOTS[chosen.plant]
    if not 1 <= len(result) <= limit:
        hint = "" if chosen.plant == "planar" else f" (--plant planar: {MAX_ROBOTS['planar']})"
        raise OmniError(
            f"--blue and --yellow together must be 1 to {limit} robots, got {len(result)}{hint}"
        )
    return result


def measure_load(chosen: Scenario, poses: Mapping[RobotName, Array]) -> float:
    """Measure the CPU time of a simulated second while all robots drive, s.

    Args:
        chosen: Scenario, as for `ServedWorld`.
        poses: Robot name -> start pose, shape (3,), m and rad.
    """
    world = ServedWorld(chosen, poses, MessageCounter())
    move = MoveCommand(local_velocity=LocalVelocity(forward=0.1, left=0.1, angular=1.0))
    began_s = 0.0
    for cycle in range(WARM_UP_CYCLES + MEASURED_CYCLES):
        if cycle == WARM_UP_CYCLES:
            began_s = time.process_time()
        for team, number in poses:
            if cycle % CYCLES_PER_FRAME == 0:
                world.command(team, [RobotCommand(id=number, move_command=move)])
        world.take_images()
        world.advance()
    return (time.process_time() - began_s) * CYCLE_RATE_HZ / MEASURED_CYCLES
