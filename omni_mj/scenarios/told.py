"""What a team is told of its robots if nobody says it: what follows from their own numbers."""

from typing import TYPE_CHECKING

import numpy as np

from omni_mj.scenarios import wheel_loops
from omni_mj.scenarios.creep_law import creep

if TYPE_CHECKING:
    from omni_mj.scenarios.settings import Settings

# Where a loop integrates there is no single lag, and nothing that friction costs for good: a guess. It overshoots, so
# that what it reaches is not known either.
INTEGRATING = {"lag_s": 0.02, "drag_m_s": 0.04, "alpha_forward": 0.0, "alpha_sideways": 0.0}
# Effort at 1 m/s beyond that of creep in closed form: viscous friction, rolling radius, battery. On six robots it is
# 0.013 to 0.023 ahead and 0.021 to 0.047 aside, where wheels give way more.
EFFORT_BESIDE = 0.02
FIELDS = ("lag_s", "drag_m_s", "creep_s2_m", "creep_sideways_s2_m", "alpha_forward", "alpha_sideways")  # of [control]


def follows(settings: "Settings", believed_creep: float | None = None) -> dict[str, float]:
    """Fields of `[control]`: lag and drag, means of both axes, to 0.1 ms and 1 mm/s; creep, and what robots reach.

    Args:
        settings: of the robot.
        believed_creep: what is told of the creep, s^2/m: a team that takes its robots not to creep takes them to reach
            what they are told. [the robot's own]
    """
    lags, drags, law = wheel_loops.lag(settings), wheel_loops.drag(settings), creep(settings)
    own = round(float(law.time[0]), 4)
    share = believed_creep / own if own and believed_creep is not None else 1.0
    effort = np.ones(2)
    if own:
        effort += share * (1 / law.gain[:2] - 1 + EFFORT_BESIDE * np.array([1.0, law.time[1] / own]))
    values = {
        "lag_s": round(float(lags.mean()), 4),
        "drag_m_s": round(float(drags.mean()), 3),
        "creep_s2_m": own,
        "creep_sideways_s2_m": round(share * float(law.time[1]), 4),
        "alpha_forward": round(float(1 / effort[0]), 3),
        "alpha_sideways": round(float(1 / effort[1]), 3),
    }
    if settings.firmware.ki:
        values |= INTEGRATING
    return {name: min(value, 1.0) for name, value in values.items()}
