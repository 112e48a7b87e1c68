"""The loop as a control engineer looks at it: its step response and its margins, measured on the plant.

`motion` is what robots do meanwhile, `drive` runs it, `response` is what is read from the record, `findings` puts it
together for each controller.
"""

from omni_mj.studies.loop.study import LoopResult, loop

__all__ = ["LoopResult", "loop"]
