"""Identification of a user's robot from its logs.

`logs` reads them, `axes` checks that inputs and motion are of the same axes, `segments` cuts them into stretches, `law`
predicts these, `fit` is the least squares, `findings` what the data tell and what not, `wheels` what scales say of
wheels, `predict` how well what was found predicts, `study` all of it, `robot_file` what it writes, `plan` what to
drive.
"""

from omni_mj.studies.identify.study import Identified, identify

__all__ = ["Identified", "identify"]
