"""The slip study: gain, slip and drag of robots, identified as TIGERs Mannheim do."""

from omni_mj.studies.slip.slip_study import (
    PUBLISHED,
    SlipResult,
    measure_slip,
    prepare_slip_scenario,
)

__all__ = ["PUBLISHED", "SlipResult", "measure_slip", "prepare_slip_scenario"]
