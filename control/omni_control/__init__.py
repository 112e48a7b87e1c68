"""Control of omnidirectional robots: kinematics, reference, fuzzy control, delay compensation; a team's computer.

Needs numpy and scipy only and knows neither a simulator nor files: `Team` is what a simulated loop runs and what a
robot's owner runs. All arrays have a leading axis of robots.
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
        TimedReference,
    )
    from omni_control.team import Team
    from omni_control.traction import WheelLimits

_HOME = {
    "CURVES": "reference",
    "CommandHistory": "delay_compensation",
    "Controller": "controllers.base",
    "ControllerError": "errors",
    "CurveReference": "reference",
    "IteratedReference": "reference",
    "Kinematics": "kinematics",
    "MotionLimits": "reference",
    "OmniError": "errors",
    "Reference": "reference",
    "SampledReference": "reference",
    "Observation": "controllers.base",
    "Team": "team",
    "TimedReference": "reference",
    "TeamModel": "controllers.base",
    "WheelLimits": "traction",
}

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
    "Team",
    "TeamModel",
    "TimedReference",
    "WheelLimits",
]


def __getattr__(name: str) -> object:
    """A public name, loaded when it is asked for."""
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_HOME[name]}"), name)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
