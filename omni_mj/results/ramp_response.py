"""How a robot follows a velocity that is ramped up, held and ramped down: its gain and its lag, apart.

With u the speed commanded along the drive and v that achieved, three numbers say what is missing of the way:

**Steady gain** g: v / u in the last half second of the cruise, from displacements. A robot that does not find
the traction for the ramp may still be on its way then, and what is measured belongs to this drive alone.

**Lag**: from the way that is missing after the ramp up, D_up, and that run too far after the ramp down, D_down, beside
g times the way commanded:

    lag = (D_up + D_down) / (2 g U),    D_up = integral of g u - v from the start to the cruise,
                                        D_down = integral of v - g u from there to the end.

A linear response of gain g delays its input in the mean, that is by the first moment of its impulse response, which is
what both terms are, whatever the shape of the ramp: a dead time is its own lag, a lag of first order its time constant,
those in series add. A speed that dry friction costs while driving, whatever the speed, has no lag: it adds to D_up what
it takes from D_down. Creep, T |v| v' = u - v / g (`omni_mj.config.nominal_model`), is a lag that grows with speed: its
g u - v = g T v v' integrates on either ramp to g T (g U)^2 / 2, so that its lag is T g^2 U / 2.

**Gain while speeding up**: the slope of v over u in the second half of the ramp up. Lag and dry friction shift v by a
constant there, and leave the slope alone; a linear response keeps its gain g. What creeps, or does not find the
traction or voltage, gains speed more slowly than it is told to: creeping, v = s u with T a s^2 + s / g = 1, so that s
is about g (1 - g^2 T a).
"""

from dataclasses import dataclass

import numpy as np

from omni_control.kinematics import Array
from omni_mj.config.settings import FRAME_RATE_HZ, PERIOD_S

# Of the cruise, before it counts: four time constants T |v| of a robot with T = 0.16 s^2/m at 1.5
# m/s
SETTLING_S = 1.0
STEADY_S = 0.5
REST_S = 0.75  # after the drive, for what is late


@dataclass(frozen=True)
class RampProfile:
    """A drive: from rest to a speed, on at that speed, and back to rest.

    Args:
        speed_m_s: of the cruise, U.
        acceleration_m_s2: of both ramps, a.
    """

    speed_m_s: float
    acceleration_m_s2: float

    def command(self) -> Array:
        """The speed commanded in each frame (frames,), m/s."""
        step = self.acceleration_m_s2 * PERIOD_S
        up = np.arange(step, self.speed_m_s, step)
        cruise = np.full(round((SETTLING_S + STEADY_S) * FRAME_RATE_HZ), self.speed_m_s)
        return np.concatenate([up, cruise, up[::-1], np.zeros(round(REST_S * FRAME_RATE_HZ))])

    @property
    def ramp(self) -> slice:
        """The frames of the ramp up in which its slope is measured: the second half."""
        end = int(np.argmax(self.command()))
        return slice(end // 2, end)

    @property
    def steady(self) -> slice:
        """The frames in which the steady gain is measured."""
        end = int(np.argmax(self.command())) + round((SETTLING_S + STEADY_S) * FRAME_RATE_HZ)
        return slice(end - round(STEADY_S * FRAME_RATE_HZ), end)


@dataclass(frozen=True)
class RampResponse:
    """What was measured of drives, each an array of the same shape.

    Attributes:
        steady_gain: gain while cruising.
        acceleration_gain: gain while speeding up.
        lag_s: s.
    """

    steady_gain: Array
    acceleration_gain: Array
    lag_s: Array

    def at(self, index: int | slice | tuple[int, ...]) -> "RampResponse":
        """A part of it."""
        return RampResponse(
            self.steady_gain[index], self.acceleration_gain[index], self.lag_s[index]
        )


RESPONSE_FIELDS = tuple(RampResponse.__dataclass_fields__)


def measure_ramp_response(profile: RampProfile, travelled: Array) -> RampResponse:
    """Find the response of n robots that drove one profile.

    Args:
        profile: as commanded.
        travelled: way of each robot along the drive at the start of each frame and at the end of
            the last, (frames + 1, n) m; not a number where a robot failed.
    """
    command, steady, ramp = profile.command(), profile.steady, profile.ramp
    told = np.concatenate([[0.0], np.cumsum(command) * PERIOD_S])
    way = travelled - travelled[0]
    gain = (way[steady.stop] - way[steady.start]) / (told[steady.stop] - told[steady.start])
    late = gain * told[steady.start] - way[steady.start]
    over = way[-1] - way[steady.stop] - gain * (told[-1] - told[steady.stop])
    wanted = command[ramp] - command[ramp].mean()
    speeds = np.diff(way, axis=0)[ramp] / PERIOD_S
    slope = np.einsum("f,fn->n", wanted, speeds) / (wanted @ wanted)
    return RampResponse(gain, slope, (late + over) / (2 * gain * profile.speed_m_s))
