"""References: desired poses and twists of robots over time.

A reference is known in advance (`waypoint_reference`, `curve_reference`, `sampled_reference`) or
planned anew in each frame: towards way-points (`replanned_reference`, the paper's "iteratively
updated") or towards targets that move (`target_reference`).
"""

from omni_control.reference.curve_reference import CURVES, CurveReference
from omni_control.reference.motion_limits import MotionLimits
from omni_control.reference.replanned_reference import IteratedReference, ReplannedReference
from omni_control.reference.sampled_reference import (
    Reference,
    SampledReference,
    combine_references,
)
from omni_control.reference.target_reference import TargetReference
from omni_control.reference.waypoint_reference import TimedReference

__all__ = [
    "CURVES",
    "CurveReference",
    "IteratedReference",
    "MotionLimits",
    "Reference",
    "ReplannedReference",
    "SampledReference",
    "TargetReference",
    "TimedReference",
    "combine_references",
]
