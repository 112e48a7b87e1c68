"""The limit study: the least error that is possible on a plant, with and without noise.

Without noise, iterative learning finds the limit of actuators and traction (`iterative_learning`).
With noise, LQR tracking of the learned run finds the limit of information (`lqr_tracking`).
docs/explanation/results.md discusses both.
"""

from omni_mj.studies.limit.limit_study import (
    LIMIT,
    WITHOUT_NOISE,
    LimitResult,
    check_limit,
    find_limit,
)

__all__ = ["LIMIT", "WITHOUT_NOISE", "LimitResult", "check_limit", "find_limit"]
