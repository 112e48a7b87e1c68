"""The loop as a control engineer looks at it: its step response and its margins, measured on the plant.

`motion` is what robots do meanwhile, `excitation` what is added to their commands, `drive` runs both, `step` and
`transfer` are what is read from the records, `findings` puts it together for each controller.
"""

from omni_mj.studies.loop.study import LoopResult, loop

__all__ = ["LoopResult", "loop"]
