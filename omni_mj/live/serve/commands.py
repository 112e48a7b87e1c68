"""Commands of the simulation protocol as packets of the radio, and what robots hold of them."""

import numpy as np

from omni_control.kinematics import Array
from omni_mj.link.radio import Received
from omni_mj.live.serve.cameras import CYCLES_PER_FRAME
from omni_mj.live.serve.world import HEADING_MEMORY_FRAMES
from omni_mj.live.wire.simulation_pb2 import RobotCommand, SimulatorError

# Columns of a packet: velocities [vx, vy, w]; the heading that vision saw, and the cycle of its image; whether the
# velocities are in the robot's frame; rim speeds, NaN where there are none.
HEADING, IMAGE_CYCLE, IS_LOCAL, WHEELS = 3, 4, 5, 6
MAX_VELOCITY = 1e3  # m/s and rad/s


class Refusal(Exception):  # noqa: N818
    """A request that is not granted.

    Args:
        code: For programs.
        reason: For people.
    """

    def __init__(self, code: str, reason: str) -> None:
        super().__init__(reason)
        self.error = SimulatorError(code=code, message=reason)


def empty_packet(n_wheels: int) -> list[float]:
    """Return what a robot holds before the first command."""
    return [0.0, 0.0, 0.0, np.nan, 0.0, 0.0, *[np.nan] * n_wheels]


def encode_packet(command: RobotCommand, n_wheels: int) -> list[float] | None:
    """Return the packet for a robot, or None if the command does not say how to move.

    Rim speeds turn the robot counter-clockwise if they are positive. Wheels of the robot count from the front left,
    counter-clockwise; those of the protocol from the front right, clockwise.

    Raises:
        Refusal: The robot cannot obey.
    """
    move, packet = command.move_command, empty_packet(n_wheels)
    form = move.WhichOneof("command")
    if form is None:
        return None
    values = [value for _, value in getattr(move, form).ListFields()]
    if form == "wheel_velocity":
        if n_wheels != 4:
            raise Refusal("WHEELS", f"robot {command.id} has {n_wheels} wheels; rim speeds are for four")
        packet[WHEELS:] = reversed(values)
    else:
        packet[:3], packet[IS_LOCAL] = values, float(form == "local_velocity")
    if not all(abs(value) < MAX_VELOCITY for value in values):
        limit = f"velocities must be numbers below {MAX_VELOCITY:g} m/s and rad/s"
        raise Refusal("VELOCITY", f"robot {command.id}: {limit}, not {values}")
    return packet


def decode_packets(packets: Array, is_new: np.ndarray, cycle: int) -> Received:
    """Return what robots hold.

    Args:
        packets: Shape (n, k).
        is_new: Which arrived now, shape (n,).
        cycle: In which robots compare the headings that vision saw with their own.
    """
    age = np.rint((cycle - packets[:, IMAGE_CYCLE]) / CYCLES_PER_FRAME).astype(int)
    is_known = is_new & (age <= HEADING_MEMORY_FRAMES)
    is_local, rims = packets[:, IS_LOCAL] > 0, packets[:, WHEELS:]
    return Received(
        command=packets[:, :3],
        heading=np.where(is_known, packets[:, HEADING], np.nan),
        age=age * is_known,
        new=is_new,
        body=is_local if is_local.any() else None,
        wheels=None if np.isnan(rims).all() else rims,
    )
