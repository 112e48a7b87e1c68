"""Limits that a robot reaches: sliding wheels, motor voltage and current, command limits.

A wheel that transmits a force creeps: its rim slips over the carpet, the faster the larger the
force. Coulomb's limit of the force is reached at the largest creep. At larger slip the wheel
slides, and its friction force does not increase further.
"""

import numpy as np

from omni_control.kinematics import Array, world_to_body
from omni_mj.config import PERIOD_S
from omni_mj.config.settings import Settings
from omni_mj.config.team_settings import ControlSettings
from omni_mj.simulation.log import Log

SLIDING, VOLTAGE_SATURATED = "sliding", "voltage_saturated"
CURRENT_LIMITED, COMMAND_LIMITED = "current_limited", "command_limited"
LIMIT_LABELS = {
    SLIDING: "sliding",
    VOLTAGE_SATURATED: "full voltage",
    CURRENT_LIMITED: "current limit",
    COMMAND_LIMITED: "command limit",
}
DUTY = "mean_duty"
METRIC_LABELS = {f"{limit}_fraction": label for limit, label in LIMIT_LABELS.items()}
METRIC_LABELS[DUTY] = "duty"
CREEP_FRACTION = 0.98  # the largest creep is known to about 2 %
SLIDING_MARGIN_M_S = 0.02  # a wheel slides if its slip exceeds the largest creep by this much
ROUNDING = 1e-9  # relative rounding error of a command that was scaled to a limit


def excess_slip(pose: Array, slip: Array, settings: Settings) -> Array:
    """Return by how much the slip of each wheel exceeds that from which on it slides.

    The largest creep is |v|_c 3 friction / creep_stiffness, with the contact speed |v|_c of the
    wheel (`omni_mj.robot.wheel_carpet_forces`).

    Args:
        pose: Shape (frames, 3), m and rad.
        slip: Slip of the wheels' contact points, shape (frames, wheels), m/s.
        settings: Settings of the robot and the carpet.

    Returns:
        Shape (frames - 1, wheels), m/s. Positive where a wheel slides.
    """
    wheels = settings.wheels.kinematics
    twist = world_to_body(np.diff(pose, axis=0) / PERIOD_S, pose[1:, 2])
    # Velocities of the wheels' centers, along the axle + i along the rim. Arrays of shape (n, 2)
    # would round differently.
    center = (twist[:, 0] + 1j * twist[:, 1])[:, None] * np.exp(-1j * wheels.azimuths)
    center = center + 1j * twist[:, 2, None] * wheels.arm
    contact_speed = np.hypot(settings.wheels.contact_ratio * center.real, center.imag)
    sliding_slip = 3 * settings.carpet.friction / settings.drivetrain.creep_stiffness
    return slip[1:] - CREEP_FRACTION * contact_speed * sliding_slip - SLIDING_MARGIN_M_S


def is_command_limited(command: Array, control: ControlSettings) -> np.ndarray:
    """Return in which frames a command is at a limit of speed or acceleration.

    Args:
        command: Shape (frames, 3), m/s and rad/s.
        control: Limits.

    Returns:
        Shape (frames,).
    """
    rate = np.diff(command, axis=0, prepend=np.zeros((1, 3))) / PERIOD_S
    tolerance = 1 - ROUNDING
    speed, acceleration = (np.hypot(values[:, 0], values[:, 1]) for values in (command, rate))
    return (
        (speed >= control.max_speed_m_s * tolerance)
        | (np.abs(command[:, 2]) >= control.max_turn_rate_rad_s * tolerance)
        | (acceleration >= control.max_acceleration_m_s2 * tolerance)
        | (np.abs(rate[:, 2]) >= control.max_turn_acceleration_rad_s2 * tolerance)
    )


def saturated_frames(log: Log, row: int) -> dict[str, np.ndarray]:
    """Return the frames in which a row reaches each limit.

    Returns:
        Key of `LIMIT_LABELS` -> shape (frames,). Limits that the plant does not simulate are
            absent.
    """
    settings = log.rows[row].settings
    names = ("pose", "slip", "duty_peak", "current_limited", "command")
    channels = {name: log.channel_of_row(name, row) for name in names}
    saturated: dict[str, np.ndarray] = {}
    if not np.isnan(channels["slip"]).all():
        is_sliding = (excess_slip(channels["pose"], channels["slip"], settings) > 0).any(-1)
        # The speed in the first frame is unknown.
        saturated[SLIDING] = np.concatenate([[False], is_sliding])
    if not np.isnan(channels["duty_peak"]).all():
        saturated[VOLTAGE_SATURATED] = channels["duty_peak"][:, 0] >= 1
        saturated[CURRENT_LIMITED] = np.asarray((channels["current_limited"] > 0).any(-1))
    saturated[COMMAND_LIMITED] = is_command_limited(channels["command"], settings.control)
    return saturated


def saturation_metrics(log: Log, row: int) -> dict[str, float]:
    """Return the fraction of frames at each limit, and the mean duty, of a row with frames.

    Returns:
        Key of `METRIC_LABELS` -> value. Limits that the plant does not simulate are absent.
    """
    metrics = {
        f"{limit}_fraction": frames.mean() for limit, frames in saturated_frames(log, row).items()
    }
    return metrics | {DUTY: log.channel_of_row("duty_peak", row)[:, 0].mean()}
