"""Plants: simulated robots that move when commanded, all with one interface (`Plant`)."""

from typing import Protocol

from omni_control.kinematics import Array, Kinematics
from omni_mj.network.radio import ReceivedCommand
from omni_mj.plants.telemetry import Telemetry


class Plant(Protocol):
    """n robots, constructed from their rows and start poses (n, 3): `MujocoPlant(rows, poses)`.

    Attributes:
        geometry: Geometry of the wheels, or None for a plant without wheels.
    """

    geometry: Kinematics | None

    def pose(self) -> Array:
        """Return true poses, world frame, (n, 3) m, m, rad; headings count full turns."""
        ...

    def twist(self) -> Array:
        """Return true twists, world frame, (n, 3) m/s, m/s, rad/s."""
        ...

    def advance(self, received: ReceivedCommand) -> dict[int, str]:
        """Advance by one frame in which the robots apply the commands that they `received`.

        Returns:
            Rows that failed in this frame, each with the cause in words. A failed row stays where
            it is and does not influence others. Its pose is no longer meaningful.
        """
        ...

    def telemetry(self) -> Telemetry:
        """Return the telemetry of wheels and motors."""
        ...
