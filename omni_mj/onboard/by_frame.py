"""What happens once a frame by loops over robots, for compilers: what the classes of this room do by numpy.

See `by_robot`, which goes through the cycles of a frame.
"""

import numpy as np

from omni_control.kinematics import Array, wrapped
from omni_mj.onboard import laws
from omni_mj.onboard.arrays import BatteryArrays, FirmwareArrays, HeatArrays
from omni_mj.onboard.laws import Some, each


def obey(some: Some, f: FirmwareArrays, cycle: int) -> None:
    """Take over the commands that are noted (see `Firmware.obey`), after so many cycles."""
    for i in each(some):
        f.turn_rate[i] = laws.told_turn(f.told_turn[i], f.turn_gain[i])
        stops = laws.where(f.new[i] != 0, cycle + f.patience[i], f.stops[i])
        f.stops[i] = laws.where(f.ignores[i] != 0, np.minimum(stops, cycle), stops)
        for w in range(f.turn.shape[0]):
            speeds = laws.along(f.told_x[i], f.told_y[i], f.forward[w, i], f.left[w, i])
            f.along_x[w, i], f.along_y[w, i] = speeds


def correct(some: Some, f: FirmwareArrays, h: HeatArrays, past: Array, frame: int) -> None:
    """Begin a frame (see `Firmware.correct`), after so many, with the headings that are noted."""
    for i in each(some):
        past[frame % len(past), i] = f.heading[i]
        then = past[int((frame - f.age[i]) % len(past)), i]
        error = wrapped(f.seen[i] - then)
        error = laws.where(np.isnan(error), 0.0, error)
        correction = f.heading_share[i] * error
        f.heading[i] += correction
        for k in range(len(past)):
            past[k, i] += correction
        f.bias[i] -= f.bias_share[i] * error
        for w in range(f.swing.shape[0]):
            f.swing[w, i] = laws.swing(h.winding[w, i], f.hot[i], f.derated[i], f.resistance[i])


def tell(
    some: Some,
    out: Array,
    wheels: tuple[Array, Array, Array],
    recorded: tuple[Array, Array, Array],
    h: HeatArrays,
    b: BatteryArrays,
) -> None:
    """Write telemetry (see `Telemetry.of_wheels`).

    Args:
        some: robots.
        out: written: its columns, (n, 10 W + 4).
        wheels: their angles, rad, speeds, rad/s, and slips, m/s, (W, n) each.
        recorded: voltages and currents of a frame's cycles (cycles, W, n), V and A, and the battery's voltage
            (cycles, n) V.
        h: motors.
        b: batteries.
    """
    angle, speed, slip = wheels
    voltages, currents, supplies = recorded
    count, many = voltages.shape[:2]
    for i in each(some):
        duty, volts, amperes = 0.0, 0.0, 0.0
        for w in range(many):
            mean_voltage, mean_current = voltages[0, w, i], currents[0, w, i]
            for k in range(1, count):
                mean_voltage += voltages[k, w, i]
                mean_current += currents[k, w, i]
            for k in range(count):
                size, supply = np.abs(voltages[k, w, i]), supplies[k, i]
                duty = np.maximum(duty, laws.where(supply > 0, size / supply, 0.0))
                volts, amperes = np.maximum(volts, size), np.maximum(amperes, np.abs(currents[k, w, i]))
            out[i, w], out[i, many + w] = angle[w, i], speed[w, i]
            out[i, 2 * many + w], out[i, 3 * many + w] = voltages[-1, w, i], currents[-1, w, i]
            out[i, 4 * many + w], out[i, 5 * many + w] = mean_voltage / count, mean_current / count
            out[i, 6 * many + 3 + w], out[i, 7 * many + 3 + w] = h.limited[w, i], h.winding[w, i]
            out[i, 8 * many + 3 + w], out[i, 9 * many + 4 + w] = h.housing[w, i], slip[w, i]
        out[i, 6 * many], out[i, 6 * many + 1] = np.minimum(duty, 1.0), volts
        out[i, 6 * many + 2], out[i, 9 * many + 3] = amperes, b.voltage[i]
