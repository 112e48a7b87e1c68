"""A bench for the loop study: its drive, its motion, and the figures that are read from the record."""

from omni_mj.studies.loop import LoopResult as LoopResult
from omni_mj.studies.loop import loop as loop
from omni_mj.studies.loop import motion as motion
from omni_mj.studies.loop import study as study
from omni_mj.studies.loop.drive import STEP as STEP
from omni_mj.studies.loop.drive import STEP_M as STEP_M
from omni_mj.studies.loop.drive import WARM_UP as WARM_UP
from omni_mj.studies.loop.drive import Drive as Drive
from omni_mj.studies.loop.response import margins as margins
from omni_mj.studies.loop.response import measure as measure
