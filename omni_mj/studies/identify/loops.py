"""What wheel loops, which run at a rate, do later than the law in which they act at once.

A loop that runs every n cycles of the sensors sees speeds as differences of encoders since its run before, which are
those of half as long ago; sensors are a cycle late; and its duty is held until its next run, on average for half of
that. So it answers to what wheels did n + 1 cycles ago, and a loop on the gyro to what the body did n/2 + 1 cycles ago.
To first order of such a delay d, speeds that are fed back are v - d v': the lag is shorter by d, while commands, which
are not fed back, are no earlier. Of a wheel's stiffness its back-EMF is not fed back. A derivative part takes after the
change of both: lags are longer by k_d over the gain, and commands as much earlier.

A command waits for the next run: cameras' frames, at which commands come, need not be a multiple of n.
"""

from dataclasses import dataclass
from typing import Self

import numpy as np

from omni_mj.robot.motors import Motor
from omni_mj.scenarios.settings import CYCLE_RATE_HZ, FRAME_RATE_HZ, Settings


@dataclass(frozen=True)
class Loops:
    """Delays of a robot's loops.

    Attributes:
        wait: of commands until loops act on them, the mean, s.
        seen: by how much loops see wheels late, times the share of a wheel's stiffness that is theirs, s.
        turned: by how much the loop on the gyro sees the turn rate late, s.
    """

    wait: float
    seen: float
    turned: float

    @classmethod
    def of(cls, settings: Settings) -> Self:
        """Those of a robot under its settings."""
        firmware, cycle = settings.firmware, 1 / CYCLE_RATE_HZ
        every = round(CYCLE_RATE_HZ / firmware.rate_hz)
        gain = firmware.kp + Motor.of(settings.motor).speed_constant
        frame, rate = CYCLE_RATE_HZ // FRAME_RATE_HZ, firmware.kd / gain
        wait = float(np.mean(-frame * np.arange(every) % every))  # of as many frames in a row, after which it repeats
        return cls(wait * cycle - rate, (every + 1) * cycle * firmware.kp / gain - rate, (every / 2 + 1) * cycle)
