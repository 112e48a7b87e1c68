"""What is possible on a plant: the least error of robots that have learned the way, without noise and with it.

    result = limit("rect")

Without noise, iterative learning finds the limit of actuators and traction (`learning`); with noise, feedback on the
best prediction along what was learned finds that of information (`practice`). docs/limit.md says what both are worth.
"""

from omni_mj.studies.limit.study import LIMIT, WITHOUT_NOISE, LimitResult, check, limit

__all__ = ["LIMIT", "WITHOUT_NOISE", "LimitResult", "check", "limit"]
