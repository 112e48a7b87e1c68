"""How often does it fail, and where: a scenario under many settings and seeds, in shards that a kill does not lose."""

from omni_mj.studies.sweep.plan import Plan, axes, parse_axis
from omni_mj.studies.sweep.study import Sweep, run, sweep

__all__ = ["Plan", "Sweep", "axes", "parse_axis", "run", "sweep"]
