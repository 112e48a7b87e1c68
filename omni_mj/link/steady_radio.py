"""A radio on which packets take equally long and none is lost, which is most of them: what is sent comes in turn."""

from collections import deque
from collections.abc import Sequence

import numpy as np

from omni_control.kinematics import Array
from omni_mj.link.noise import Seed
from omni_mj.link.radio import Radio, Received
from omni_mj.link.radio_faults import Mishaps
from omni_mj.scenarios.faults import Delay, Fault
from omni_mj.scenarios.settings import RadioSettings


def radio(
    settings: Sequence[RadioSettings], seeds: Sequence[Seed], faults: Sequence[Sequence[Fault]]
) -> "SteadyRadio | Radio":
    """The radio of n rows, over which all of them are sent something once a frame; see `Radio`.

    Args:
        settings: one per row.
        seeds: one per row.
        faults: of each row.
    """
    steady = not any(each.jitter_frames or each.loss_probability for each in settings)
    alike = len({each.delay_frames for each in settings}) == 1
    if steady and alike and not any(isinstance(fault, (Delay, *Mishaps.kinds)) for own in faults for fault in own):
        return SteadyRadio(len(settings), settings[0].delay_frames)
    return Radio(settings, seeds, faults)


class SteadyRadio:
    """Packets to n robots that all arrive after `delay` frames; see `Radio`, which does the same for any."""

    def __init__(self, n: int, delay: int) -> None:
        self._delay, self._flying, self._waited = delay, deque[tuple[Array, Array]](), 0
        self._none, self._age = np.zeros(n, bool), np.full(n, delay)
        self._none.flags.writeable = self._age.flags.writeable = False  # handed out in every frame

    def exchange(self, command: Array, heading: Array) -> Received:
        """See `Radio.exchange`."""
        self._flying.append((command.copy(), heading.copy()))
        if len(self._flying) > self._delay:
            return Received(*self._flying.popleft(), self._age)
        self._waited += 1
        n = len(command)
        return Received(np.zeros((n, 3)), np.full(n, np.nan), np.full(n, self._waited), self._none)
