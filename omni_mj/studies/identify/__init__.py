"""Identification of a user's robot from its logs.

`logs` reads them, `axes` and `wheels` check that inputs and motion are of the same robot and axes, `segments` cuts them
into stretches, `law` predicts these, `loops` what is late in them, `fit` is the least squares of what `projected`
leaves of them, `errors` how sure it is, `residuals` what it lacks, `motion` what is fitted to what, `suspects` and
`windings` which part is odd, `numbers` what parameters mean, `findings` what the data tell and what not, `predict` how
well what was found predicts, `study` all of it, `robot_file` what it writes, `plan` what to drive.
"""

from omni_mj.studies.identify.findings import Estimate
from omni_mj.studies.identify.study import Identified, identify

__all__ = ["Estimate", "Identified", "identify"]
