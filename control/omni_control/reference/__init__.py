"""References: desired poses and twists of robots over time.

A reference is known in advance (`timed`, `curves`) or planned anew in each frame (`iterated`).
"""

from omni_control.reference.curves import CURVES, CurveReference
from omni_control.reference.iterated import IteratedReference
from omni_control.reference.motion_limits import MotionLimits
from omni_control.reference.sampled import PerRobotReference, Reference, SampledReference
from omni_control.reference.timed import TimedReference

__all__ = [
    "CURVES",
    "CurveReference",
    "IteratedReference",
    "MotionLimits",
    "PerRobotReference",
    "Reference",
    "SampledReference",
    "TimedReference",
]
