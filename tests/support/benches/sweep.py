"""Sweeps, and what they are made of."""

from omni_mj.studies.outcome import StoppedError as StoppedError
from omni_mj.studies.outcome import nothing as nothing
from omni_mj.studies.sweep import Axis as Axis
from omni_mj.studies.sweep import Plan as Plan
from omni_mj.studies.sweep import Sweep as Sweep
from omni_mj.studies.sweep import axes as axes
from omni_mj.studies.sweep import resume as resume
from omni_mj.studies.sweep import sensitivity as sensitivity
from omni_mj.studies.sweep import sweep as sweep
from omni_mj.studies.sweep import workers as workers
from omni_mj.studies.sweep.cells import median as median
from omni_mj.studies.sweep.sensitivity import Design as Design
from omni_mj.studies.sweep.sensitivity import indices as indices
