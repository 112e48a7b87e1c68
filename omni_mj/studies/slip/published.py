"""What teams published of how their robots slip: for comparison only, no robot is made of it here.

TIGERs Mannheim identified three robots with `matlab/identification/identifyBotModelV2.m` of their Sumatra; the numbers
stand in `robot_impl.c` of their Firmware (`src/main2016` until 2023, `src/main2019`; TIGERs-Mannheim/Firmware at
2177659 and ef794dd). Their x is our y: K and T of their y are ours forward. Drag and efficiency were measured in
roll-outs forward. Their firmware takes the drag for that sideways, 1.28 to 1.30 times that forward, which was not
measured; if they entered it so, forward drag is 3.41, 2.07 and 4.14 N. The current of the v2016 was not measured but
reckoned from voltage and speed, which is in its efficiency.
"""

from collections.abc import Mapping
from dataclasses import dataclass


@dataclass(frozen=True)
class Published:
    """Figures of one robot.

    Attributes:
        source: where they stand.
        mass_kg: with which a deceleration was turned into a force.
        values: by the names of `QUANTITIES` in `omni_mj.studies.slip.figures`.
    """

    source: str
    mass_kg: float
    values: Mapping[str, float]


INERTIA_SHARE = 0.55  # yaw inertia over mass and arm squared, with which decelerations were turned into torques
_FIRMWARE = "TIGERs Mannheim, Firmware, robot_impl.c"

PUBLISHED = {
    "tigers-v2016": Published(
        f"{_FIRMWARE} (2016)",
        2.65,
        {
            "gain_forward": 0.90, "gain_sideways": 0.79, "time_forward": 0.060, "time_sideways": 0.155,
            "drag_forward": 4.44, "drag_turning": 0.14, "efficiency": 0.37, "efficiency_turning": 0.29,
        },
    ),
    "tigers-v2020": Published(
        f"{_FIRMWARE} (2020, direct drive)",
        2.46,
        {
            "gain_forward": 1.00, "gain_sideways": 0.95, "time_forward": 0.050, "time_sideways": 0.095,
            "drag_forward": 2.65, "drag_turning": 0.097, "efficiency": 0.72, "efficiency_turning": 0.72,
        },
    ),
    "tigers-v2020-planetary": Published(
        f"{_FIRMWARE} (2020, planetary gear)",
        2.46,
        {
            "gain_forward": 0.95, "gain_sideways": 0.91, "time_forward": 0.038, "time_sideways": 0.082,
            "drag_forward": 5.3, "drag_turning": 0.2, "efficiency": 0.54, "efficiency_turning": 0.44,
        },
    ),
}  # fmt: skip
