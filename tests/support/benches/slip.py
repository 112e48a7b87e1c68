"""A bench for the slip study: its moves, its fits, and the closed form that they must find."""

from omni_mj.scenarios.settings import PERIOD_S as PERIOD_S
from omni_mj.scenarios.settings import Settings as Settings
from omni_mj.scenarios.told import loads as loads
from omni_mj.studies.slip import fits as fits
from omni_mj.studies.slip import law as law
from omni_mj.studies.slip import moves as moves
from omni_mj.studies.slip.moves import Move as Move
from omni_mj.studies.slip.moves import straight as straight
from omni_mj.studies.slip.published import PUBLISHED as PUBLISHED
