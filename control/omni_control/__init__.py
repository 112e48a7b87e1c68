"""Motion control of omnidirectional robots: a team's computer without simulator and files.

It contains kinematics, references, fuzzy control, delay compensation and estimation, and needs
numpy and scipy only. `Team` runs in the simulated loop and on real robots. Arrays of robots have
the shape (n, ...).

"The paper", its equations and its sections refer to Sheikhlar, Zarghami, Fakharian and Menhaj:
Delay Compensation on Fuzzy Trajectory Tracking Control of Omni-Directional Mobile Robots.
"""

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from omni_control.controllers.base import Controller, Observation, TeamModel
    from omni_control.delay_compensation import CommandHistory
    from omni_control.errors import ControllerError, OmniError
    from omni_control.kinematics import Kinematics
    from omni_control.reference import (
        CURVES,
        CurveReference,
        IteratedReference,
        MotionLimits,
        Reference,
        SampledReference,
        TargetReference,
        TimedReference,
    )
    from omni_control.team_computer import Team
    from omni_control.traction_limits import WheelLimits

# Modules with public names, in the order of their imports.
_MODULES = (
    "errors",
    "kinematics",
    "traction_limits",
    "reference",
    "delay_compensation",
    "controllers.base",
    "team_computer",
)

__all__ = [
    "CURVES",
    "CommandHistory",
    "Controller",
    "ControllerError",
    "CurveReference",
    "IteratedReference",
    "Kinematics",
    "MotionLimits",
    "Observation",
    "OmniError",
    "Reference",
    "SampledReference",
    "TargetReference",
    "Team",
    "TeamModel",
    "TimedReference",
    "WheelLimits",
]


def __getattr__(name: str) -> object:
    """Import a public name when it is used."""
    if name in __all__:
        for module_name in _MODULES:
            module = import_module(f"{__name__}.{module_name}")
            if hasattr(module, name):
                return getattr(module, name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
