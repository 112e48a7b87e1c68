"""A bench for the alpha study: its conditions and causes, and the names of what it measures."""

from omni_mj.measure.response import NAMES as NAMES
from omni_mj.studies import conditions as conditions
from omni_mj.studies.alpha import AlphaResult as AlphaResult
from omni_mj.studies.alpha_findings import Study as Study
