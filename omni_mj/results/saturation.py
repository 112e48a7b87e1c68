"""Why a robot strays: in which frames its wheels slide, and its motors, their drivers or its commands are at a limit.

A wheel that pulls creeps: the rim's speed differs from the carpet's in proportion to the force, up to Coulomb's limit.
Slip beyond what it creeps there is sliding, in which the carpet gives no more however fast the wheel turns.
"""

import numpy as np

from omni_control.kinematics import Array, world_to_body
from omni_mj.config.settings import PERIOD_S, ControlSettings, Settings
from omni_mj.simulation.log import Log

SLIDING, VOLTAGE_SATURATED, CURRENT_LIMITED, COMMAND_LIMITED = (
    "sliding",
    "voltage_saturated",
    "current_limited",
    "command_limited",
)
# As tables and figures call them.
LIMIT_LABELS = {
    SLIDING: "wheels slide",
    VOLTAGE_SATURATED: "full voltage",
    CURRENT_LIMITED: "current limited",
    COMMAND_LIMITED: "held back",
}
DUTY = "duty_mean"
METRIC_LABELS = {f"{cause}_fraction": name for cause, name in LIMIT_LABELS.items()} | {DUTY: "duty"}
SLIDES_M_S = 0.02  # slip above what is creep at Coulomb's limit, which is known to about 2 %
ROUNDING = 1e-9  # relative, of a command that was scaled to a limit
DEFINITIONS = {
    "saturation": (
        "sliding_fraction: share of the frames in which a wheel's slip_*_m_s is above 0.98 |v| carpet.friction /"
        f" drivetrain.creep_stiffness + {SLIDES_M_S:g} m/s, v being the velocity of the wheel's centre; voltage_saturated_fraction:"
        " in which peak_duty is 1; current_limited_fraction: in which current_limited_fraction_* of a motor is above 0;"
        " command_limited_fraction: in which the command is at a limit of [control], of speed or acceleration, translational or"
        " turning; duty_mean: mean of duty_peak over the frames. Statistics leave out seeds that failed"
    )
}


def excess_slip(pose: Array, slip: Array, settings: Settings) -> Array:
    """By how much each wheel slips faster than it can creep, (frames - 1, W) m/s; positive where it slides.

    Args:
        pose: (frames, 3) m, rad.
        slip: of the wheels' contact points, (frames, W) m/s.
        settings: of the robot and carpet.
    """
    wheels = settings.wheels.kinematics
    twist = world_to_body(np.diff(pose, axis=0) / PERIOD_S, pose[1:, 2])
    centre = (twist[:, 0] + 1j * twist[:, 1])[:, None]
    centre = centre + 1j * twist[:, 2, None] * wheels.arm * np.exp(1j * wheels.azimuths)
    creep = 0.98 * np.abs(centre) * settings.carpet.friction / settings.drivetrain.creep_stiffness
    beyond: Array = slip[1:] - creep - SLIDES_M_S
    return beyond


def is_command_limited(command: Array, control: ControlSettings) -> np.ndarray:
    """Return in which frames a command (frames, 3) is at a limit of speed or acceleration, (frames,)."""
    step = np.diff(command, axis=0, prepend=np.zeros((1, 3))) / PERIOD_S
    speed, acceleration = (np.stack([np.hypot(x, y), np.abs(w)]) for x, y, w in (command.T, step.T))
    speeds = np.array([control.max_speed_m_s, control.max_turn_rate_rad_s])[:, None]
    accelerations = np.array([control.max_acceleration_m_s2, control.max_turn_acceleration_rad_s2])[
        :, None
    ]
    tolerance = 1 - ROUNDING
    return np.asarray(
        ((speed >= speeds * tolerance) | (acceleration >= accelerations * tolerance)).any(0)
    )


def saturated_frames(log: Log, row: int) -> dict[str, np.ndarray]:
    """In which of its frames each of `LIMIT_LABELS` is there for a row, (frames,); without those that its plant lacks."""
    frames, settings = slice(log.lengths[row]), log.rows[row].settings
    channel = {
        name: log.channel(name)[frames, row]
        for name in ("pose", "slip", "duty_peak", "current_limited")
    }
    found: dict[str, np.ndarray] = {}
    if not np.isnan(channel["slip"]).all():
        slides = (excess_slip(channel["pose"], channel["slip"], settings) > 0).any(-1)
        found[SLIDING] = np.concatenate(
            [[False], slides]
        )  # in the first frame nobody knows how fast it drives
    if not np.isnan(channel["duty_peak"]).all():
        found[VOLTAGE_SATURATED] = channel["duty_peak"][:, 0] >= 1
        found[CURRENT_LIMITED] = np.asarray((channel["current_limited"] > 0).any(-1))
    found[COMMAND_LIMITED] = is_command_limited(
        log.channel("command")[frames, row], settings.control
    )
    return found


def saturation_metrics(log: Log) -> dict[str, Array]:
    """Return each row's `sliding_fraction` and so on, and `duty_mean`, (n,); NaN where its plant has no such."""
    found = {name: np.full(len(log.rows), np.nan) for name in METRIC_LABELS}
    for row in np.flatnonzero(log.lengths):
        for cause, frames in saturated_frames(log, int(row)).items():
            found[f"{cause}_fraction"][row] = frames.mean()
        found[DUTY][row] = log.channel("duty_peak")[: log.lengths[row], row, 0].mean()
    return found
