"""What runs on the robot: the rate and gains of its loops."""

from pydantic import field_validator

from omni_mj.scenarios.checking import Checked, setting
from omni_mj.scenarios.clock import CYCLE_RATE_HZ
from omni_mj.scenarios.robots import of_robot


class FirmwareSettings(Checked):
    """What runs on the robot: wheel loops, one PID per wheel, with gains at the wheel, and heading.

    By default the wheel loops are proportional with feed-forward, as in the firmware of TIGERs (k_i = 0) and
    RoboJackets.
    """

    rate_hz: int = setting(
        CYCLE_RATE_HZ, "Hz", "rate of the wheel and turn-rate loops: 960 divided by a whole number", 60, CYCLE_RATE_HZ
    )
    kp: float = setting(0.3, "V s/rad", "voltage per error of the wheel speed", 0, 100)
    ki: float = setting(0.0, "V/rad", "voltage per integrated error", 0, 1000)
    kd: float = setting(0.0, "V s^2/rad", "voltage per rate of the error", 0, 1)
    feed_forward: float = setting(1.0, "", "share of the wanted speed's back-EMF that is fed forward", 0, 2)
    nominal_voltage_v: float = setting(
        of_robot("firmware.nominal_voltage_v"), "V", "battery voltage that it reckons with", 1, 60
    )
    turn_gain: float = setting(1.0, "", "turn rate added per error of the turn rate that the gyro shows", 0, 10)
    heading_gain: float = setting(2.0, "1/s", "heading corrected per difference to vision's", 0, 30)
    bias_gain: float = setting(0.5, "1/s^2", "gyro bias corrected per difference to vision's heading", 0, 100)
    current_limit_a: float = setting(
        of_robot("firmware.current_limit_a"), "A", "highest current that a motor's driver lets through", 0.1, 1e3
    )
    timeout_s: float = setting(
        0.0, "s", "a robot stops when no command has come for so long (simulators of the league: 0.1); 0: never", 0, 60
    )
    derate: bool = setting(False, "", "limit the current of a motor that nears its highest winding temperature")

    @field_validator("rate_hz")
    @classmethod
    def _divides_the_clock(cls, rate: int) -> int:
        if CYCLE_RATE_HZ % rate:
            rates = [CYCLE_RATE_HZ // n for n in range(1, 17) if CYCLE_RATE_HZ % n == 0]
            nearest = min(rates, key=lambda each: abs(each - rate))
            raise ValueError(
                f"firmware.rate_hz must divide the {CYCLE_RATE_HZ} Hz of the physics ({', '.join(map(str, rates))}), "
                f"not {rate}; the nearest is {nearest}"
            )
        return rate
