"""Identification of a user's robot from its logs."""

from omni_mj.studies.identify.derived_parameters import Estimate
from omni_mj.studies.identify.identification import IdentificationResult, identify, identify_logs

__all__ = ["Estimate", "IdentificationResult", "identify", "identify_logs"]
