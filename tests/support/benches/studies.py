"""How a study that goes on is watched and stopped."""

from omni_mj.measure.result import Outcome as Outcome
from omni_mj.studies.compare import Watch as Watch
from omni_mj.studies.outcome import StoppedError as StoppedError
from omni_mj.studies.outcome import nothing as nothing
