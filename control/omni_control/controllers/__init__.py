"""The trackers by the names that users call them."""

from omni_control.controllers.adaptive import AdaptiveCompFlc
from omni_control.controllers.base import CompFlc, Controller, Flc
from omni_control.controllers.classic import Proportional, Smith
from omni_control.controllers.lqr import Lqr
from omni_control.controllers.oracle import Oracle

CONTROLLERS: dict[str, type[Controller]] = {
    "flc": Flc,
    "comp-flc": CompFlc,
    "adaptive-comp-flc": AdaptiveCompFlc,
    "p": Proportional,
    "smith": Smith,
    "lqr": Lqr,
    "oracle": Oracle,
}
