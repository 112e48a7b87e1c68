"""The comparison: the same controllers and seeds on many scenarios."""

from omni_mj.studies.compare.compare_study import check_scenarios, compare, default_scenarios

__all__ = ["check_scenarios", "compare", "default_scenarios"]
