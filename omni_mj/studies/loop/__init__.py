"""The loop study: step response and stability margins of control loops."""

from omni_mj.studies.loop.loop_study import LoopMeasurement, LoopResult, measure_loop

__all__ = ["LoopMeasurement", "LoopResult", "measure_loop"]
