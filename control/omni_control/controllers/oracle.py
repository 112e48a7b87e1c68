"""What noise costs: the best controller at hand, with the truth in place of vision."""

from dataclasses import replace

from omni_control.controllers.adaptive import AdaptiveCompFlc
from omni_control.controllers.base import Told
from omni_control.reference import Reference


class Oracle(AdaptiveCompFlc):
    """oracle: no competitor: adaptive-comp-flc that knows the true state in every frame.

    What it loses to a perfect robot is the price of the dead time alone: of what has changed since, and of what it
    could not know before it had moved. From true poses it identifies the latency, alpha and drag that it is not told.
    """

    knows_truth = True

    def __init__(self, told: Told, reference: Reference, n: int) -> None:
        super().__init__(replace(told, position_noise_m=0.0, heading_noise_rad=0.0), reference, n)
        self.told = told  # vision's noise is what the rest of the team has to live with
