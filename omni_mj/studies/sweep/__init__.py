"""The sweep: one scenario under many settings and seeds, in shards that survive a kill."""

from omni_mj.studies.sweep.sweep_plan import SweepPlan, check_axes, parse_axis
from omni_mj.studies.sweep.sweep_study import SweepResult, run_sweep, sweep

__all__ = ["SweepPlan", "SweepResult", "check_axes", "parse_axis", "run_sweep", "sweep"]
