"""What is possible on a plant: the least error of robots that have learned the path, without noise and with it.

Without noise, iterative learning finds the limit of actuators and traction (`learning`); with noise, feedback on the
best estimate along what was learned finds that of information (`tracking`). docs/limit.md says what both are worth.
"""

from omni_mj.studies.limit.study import LIMIT, WITHOUT_NOISE, LimitResult, check, find_limit

__all__ = ["LIMIT", "WITHOUT_NOISE", "LimitResult", "check", "find_limit"]
