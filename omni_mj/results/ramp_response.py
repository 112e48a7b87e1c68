"""Response of a robot to a velocity that ramps up, stays constant and ramps down: gain and lag.

Let u be the commanded and v the achieved speed along the drive, and U the cruising speed.

**Steady gain** g: v / u in the last half second of the cruise, from displacements. If a robot lacks
the traction for the ramp, it may still accelerate then, and the result holds for this drive only.

**Lag**: computed from D_up, the displacement that is missing after the ramp up, and D_down, the
excess displacement after the ramp down. Both are relative to g times the commanded displacement:

    lag = (D_up + D_down) / (2 g U)
    D_up   = integral of g u - v from the start to the cruise
    D_down = integral of v - g u from the end of the cruise to the end

For a linear response of gain g, both terms give the first moment of the impulse response, for every
shape of the ramp: a dead time is its own lag, a first-order lag its time constant, and lags in
series add. A constant loss of speed by dry friction has no lag: it adds to D_up what it takes from
D_down. Creep, T |v| v' = u - v / g (`omni_mj.config.nominal_model`), is a lag that grows with the
speed. Its g u - v = g T v v' integrates on either ramp to g T (g U)^2 / 2, so that its lag is
T g^2 U / 2.

**Gain while accelerating**: slope of v over u in the second half of the ramp up. Lag and dry
friction shift v by a constant there and leave the slope unchanged. A linear response keeps its gain
g. A robot that creeps, or lacks traction or voltage, accelerates more slowly than commanded. With
creep, v = s u with T a s^2 + s / g = 1, so that s is about g (1 - g^2 T a).
"""

from typing import NamedTuple

import numpy as np

from omni_control.kinematics import Array
from omni_mj.config import FRAME_RATE_HZ, PERIOD_S

# Cruise before the steady gain is measured: four time constants T |v| of a robot with
# T = 0.16 s^2/m at 1.5 m/s.
SETTLING_S = 1.0
STEADY_S = 0.5
REST_S = 0.75  # after the ramp down, for the lagging response


class RampProfile(NamedTuple):
    """Drive from rest to a speed, at that speed, and back to rest.

    Attributes:
        speed_m_s: Cruising speed U, m/s.
        acceleration_m_s2: Acceleration a of both ramps, m/s^2.
    """

    speed_m_s: float
    acceleration_m_s2: float

    def command(self) -> Array:
        """Return the commanded speed of each frame, shape (frames,), m/s."""
        step = self.acceleration_m_s2 * PERIOD_S
        ramp = np.arange(step, self.speed_m_s, step)
        cruise = np.full(round((SETTLING_S + STEADY_S) * FRAME_RATE_HZ), self.speed_m_s)
        rest = np.zeros(round(REST_S * FRAME_RATE_HZ))
        return np.concatenate([ramp, cruise, ramp[::-1], rest])

    @property
    def ramp(self) -> slice:
        """Frames of the second half of the ramp up, in which its slope is measured."""
        end = int(np.argmax(self.command()))
        return slice(end // 2, end)

    @property
    def steady(self) -> slice:
        """Frames in which the steady gain is measured."""
        end = int(np.argmax(self.command())) + round((SETTLING_S + STEADY_S) * FRAME_RATE_HZ)
        return slice(end - round(STEADY_S * FRAME_RATE_HZ), end)


class RampResponse(NamedTuple):
    """Measured responses. All arrays have the same shape.

    Attributes:
        steady_gain: Gain while cruising.
        acceleration_gain: Gain while accelerating.
        lag_s: Lag, s.
    """

    steady_gain: Array
    acceleration_gain: Array
    lag_s: Array

    def at(self, index: int | slice | tuple[int, ...]) -> "RampResponse":
        """Return the responses at an index of the arrays."""
        return RampResponse(*(values[index] for values in self))


def measure_ramp_response(profile: RampProfile, displacement: Array) -> RampResponse:
    """Return the responses of n robots that drove one profile.

    Args:
        profile: The commanded profile.
        displacement: Position of each robot along the drive at the start of each frame and at the
            end of the last, shape (frames + 1, n), m. NaN where a robot failed.
    """
    command, steady, ramp = profile.command(), profile.steady, profile.ramp
    commanded = np.concatenate([[0.0], np.cumsum(command) * PERIOD_S])
    achieved = displacement - displacement[0]
    gain = (achieved[steady.stop] - achieved[steady.start]) / (
        commanded[steady.stop] - commanded[steady.start]
    )
    missing_m = gain * commanded[steady.start] - achieved[steady.start]
    excess_m = (
        achieved[-1] - achieved[steady.stop] - gain * (commanded[-1] - commanded[steady.stop])
    )
    ramp_command = command[ramp] - command[ramp].mean()
    speeds = np.diff(achieved, axis=0)[ramp] / PERIOD_S
    slope = np.einsum("f,fn->n", ramp_command, speeds) / (ramp_command @ ramp_command)
    return RampResponse(gain, slope, (missing_m + excess_m) / (2 * gain * profile.speed_m_s))
