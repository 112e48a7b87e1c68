"""What noise costs: the best controller at hand, with the truth in place of vision."""

from omni_control.controllers.adaptive import AdaptiveCompFlc
from omni_control.controllers.base import Told
from omni_control.reference import Reference


class Oracle(AdaptiveCompFlc):
    """oracle: no competitor: adaptive-comp-flc that knows the true state in every frame.

    What it loses to a perfect robot is the price of the dead time alone: of what has changed since, and of what it
    could not know before it had moved. From true poses it identifies what it is not told of the robot.
    """

    knows_truth = True

    def __init__(self, told: Told, reference: Reference, n: int) -> None:
        super().__init__(told, reference, n)
        self.noise = (0.0, 0.0, 0.0)  # vision's is what the rest of the team has to live with
