"""Who is served: the scenario of each team's robots, and where they stand at the start."""

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from omni_control.errors import OmniError
from omni_control.kinematics import Array
from omni_mj.live.serve.cameras import Name
from omni_mj.live.serve.control import HIGHEST
from omni_mj.live.serve.pitch import MOST
from omni_mj.live.wire.simulation import Team
from omni_mj.scenarios import distributions, references, scenario
from omni_mj.scenarios.scenario import Scenario

TIMEOUT_S = 0.1  # after which robots stop, as in the league's simulators
APART_M, COLUMN = 0.5, 6  # robots of a team that stand in a column


def load(name: str | None, overrides: Iterable[str], head: Mapping[str, Any]) -> Scenario:
    """A scenario as `run` reads it, with robots that stop when they hear nothing, unless it says after how long.

    Args:
        name: of a scenario or its file; without one, settings are the robot's and the defaults, without dead time.
        overrides: `section.field=value`.
        head: fields of `Scenario` in place of the scenario's.

    Raises:
        OmniError: see `scenario.load`.
    """
    overrides = tuple(overrides)
    first = ["radio.delay_frames=0"] if name is None else []
    chosen = scenario.load(name, [*first, *overrides], {"name": "serve"} | dict(head) if name is None else head)
    distributions.refuse(chosen.distributions, "serve")
    if chosen.plant != "mujoco":
        raise OmniError(f"serve simulates the mujoco plant, not {chosen.plant}")
    said, settings = {each.split("=")[0].strip() for each in overrides}, chosen.settings
    if "firmware.timeout_s" not in said and not settings.firmware.timeout_s:
        settings = settings.replace(firmware={"timeout_s": TIMEOUT_S})
    return chosen.replace(settings=settings)


def check_together(ours: Scenario, theirs: Scenario) -> None:
    """See that one world can hold the robots of both teams.

    Raises:
        OmniError: the wheels of one team creep and the other's do not, or they need other steps of physics.
    """
    one, other = ({"wheels.creep": s.wheels.creep, "physics": s.physics} for s in (ours.settings, theirs.settings))
    if differ := [name for name in one if one[name] != other[name]]:
        raise OmniError(
            f"--yellow-robot {theirs.robot}: robots of one world have the same {' and '.join(differ)}, and it differs "
            f"from {ours.robot}; all else may differ"
        )


def numbers(text: str, option: str) -> list[int]:
    """Robots as an option has them: how many, counted from 0, or their numbers with commas between.

    Raises:
        OmniError: they are neither, or one is named twice.
    """
    words = [word.strip() for word in text.split(",") if word.strip()]
    if not all(word.isdecimal() for word in words) or not (words or not text):
        raise OmniError(f"{option} takes how many robots, such as 3, or their numbers, such as 0,4,7, not {text!r}")
    found = [int(word) for word in words]
    if "," not in text:
        found = list(range(found[0])) if found else []
    if len(set(found)) < len(found) or (found and max(found) > HIGHEST):
        raise OmniError(f"{option}: robots have different numbers from 0 to {HIGHEST}, not {text!r}")
    return found


def poses(blue: Iterable[int], yellow: Iterable[int], follows: Scenario | None) -> dict[Name, Array]:
    """Where robots stand at the start: in columns on their halves, facing each other.

    Args:
        blue: numbers of its robots.
        yellow: same.
        follows: the scenario at whose places the first blue robots begin; none if all stand in columns.

    Raises:
        OmniError: there are none, or too many.
    """
    found = dict[Name, Array]()
    for team, own, side in ((Team.BLUE, blue, -1.0), (Team.YELLOW, yellow, 1.0)):
        for k, number in enumerate(own):
            x, y = APART_M * (1 + k // COLUMN), APART_M * ((COLUMN - 1) / 2 - k % COLUMN)
            found[team, number] = np.array([side * x, -side * y, 0.0 if side < 0 else np.pi])
    if not 1 <= len(found) <= MOST:
        raise OmniError(f"a world has 1 to {MOST} robots, --blue and --yellow together, not {len(found)}")
    if follows is not None:
        for name, (x, y, heading) in zip(found, follows.settings.world.places, strict=False):
            if name[0] == Team.BLUE:
                found[name] = references.timed(follows.settings, (x, y, heading)).poses[0]
    return found
