"""Identification of a user's robot from its logs.

`logs` reads tables (`tables`) and game logs (`game_log`), `checks` refuses what cannot be of this robot, `stretches`
cuts logs, `law` predicts the motion and `fit` fits it, `motion` says what is fitted to wheels and to commands, `motors`
what currents and voltages tell, `findings` what the data tell and what not, `study` is all of it, `robot_file` what it
writes, `plan` what to drive.
"""

from omni_mj.studies.identify.findings import Estimate
from omni_mj.studies.identify.study import Identified, identify

__all__ = ["Estimate", "Identified", "identify"]
