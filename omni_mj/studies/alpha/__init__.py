"""The alpha study: how far and how late robots follow their commands, and why."""

from omni_mj.studies.alpha.alpha_study import AlphaResult, AlphaStudy, measure_alpha

__all__ = ["AlphaResult", "AlphaStudy", "measure_alpha"]
