"""A bench for logs of robots: what is read of a file."""

from omni_mj.studies.identify.logs import Log, read

__all__ = ["Log", "read"]
