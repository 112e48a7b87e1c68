"""Plants: simulated robots that carry out commands, all with one interface (`Plant`)."""

from typing import Protocol

from omni_control.kinematics import Array, Kinematics
from omni_mj.network.radio import ReceivedCommand
from omni_mj.plants.telemetry import Telemetry


class Plant(Protocol):
    """Interface of n simulated robots, constructed as `MujocoPlant(rows, start_poses)`.

    Attributes:
        geometry: Geometry of the wheels, or None for a plant without wheels.
    """

    geometry: Kinematics | None

    def pose(self) -> Array:
        """Return true poses, world frame, (n, 3) m, m, rad; headings are unwrapped."""
        ...

    def twist(self) -> Array:
        """Return true twists, world frame, (n, 3) m/s, m/s, rad/s."""
        ...

    def advance(self, received: ReceivedCommand) -> dict[int, str]:
        """Advance by one frame of 1/60 s.

        Args:
            received: Commands that apply in this frame. If some arrive within the frame,
                `received.command` is the mean over the frame, and `received.split()` yields them.

        Returns:
            Mapping from each row that failed in this frame to the cause in words. A failed row
            stops and does not influence others. Its pose is no longer meaningful.
        """
        ...

    def telemetry(self) -> Telemetry:
        """Return the telemetry of wheels and motors."""
        ...
