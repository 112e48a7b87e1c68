"""How robots slip: the identification that TIGERs Mannheim publish, done on simulated robots.

`moves` are what is driven, `record` is what a robot logs of it, `fits` are their fits, `figures` what comes out of a
robot, `law` what must come out in closed form, `published` what came out of real ones.
"""

from omni_mj.studies.slip.study import SlipResult, slip

__all__ = ["SlipResult", "slip"]
