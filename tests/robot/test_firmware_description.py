"""The firmware against a second one of a single robot, written from its description."""

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pytest
from benches.robot import CYCLES, Firmware
from numpy.typing import NDArray

from omni_mj.config.resolve import resolve_settings
from omni_mj.config.settings import Settings

CYCLE_S = 1 / 960
FRAMES = 150
GAINS: dict[str, dict[str, Any]] = {
    "proportional": {},
    "pid": {"ki": 40.0, "kd": 2e-4, "kp": 0.5},
    "slow, derating": {"rate_hz": 240, "ki": 20.0, "thermal_derating": True},
    "no timeout": {"timeout_s": 0.0, "feedforward": 0.0},
}


@dataclass
class DescribedFirmware:
    """Firmware of one robot that starts at heading 0; arrays are of its four wheels."""

    settings: Settings
    heading: float = 0.0
    bias: float = 0.0
    past_headings: list[float] = field(default_factory=list)
    command: tuple[str, NDArray] = ("world", np.zeros(3))
    deadline: float = 0.0  # cycle in which the robot halts
    integral: Any = 0.0
    last_error: Any = 0.0
    count: Any = 0.0
    duty: Any = 0.0
    is_off: bool = False
    waits_for_heading: bool = False

    def __post_init__(self) -> None:
        """Wait for the first command as for a later one."""
        self.deadline = self.settings.firmware.timeout_s * 960 or math.inf

    def begin_frame(self, cycle: int, vision: float, age: int, is_off: bool, angle: Any) -> None:
        gains = self.settings.firmware
        if self.is_off and not is_off:
            self.waits_for_heading = True
            self.bias, self.integral, self.last_error = 0.0, 0.0, 0.0
            self.count = self.count_edges(angle)
        self.is_off = is_off
        if is_off:
            self.duty = 0.0
        if self.is_off or self.waits_for_heading:
            self.deadline = min(self.deadline, cycle)
        self.past_headings.append(self.heading)
        if math.isnan(vision) or is_off:
            return
        if self.waits_for_heading:
            self.waits_for_heading = False
            self.heading, self.past_headings = vision, [vision] * len(self.past_headings)
            return
        error = math.remainder(vision - self.past_headings[-1 - age], 2 * math.pi)
        self.heading += gains.heading_gain / 60 * error
        self.past_headings = [past + gains.heading_gain / 60 * error for past in self.past_headings]
        self.bias -= gains.gyro_bias_gain / 60 * error

    def accept(self, cycle: int, kind: str, values: NDArray, is_new: bool) -> None:
        self.command = kind, values
        if is_new and not (self.is_off or self.waits_for_heading):
            self.deadline = cycle + (self.settings.firmware.timeout_s * 960 or math.inf)

    def count_edges(self, angle: Any) -> Any:
        per_turn = self.settings.sensors.encoder_counts * self.settings.motor.gear_ratio
        return np.floor(angle * per_turn / (2 * math.pi))

    def run(self, cycle: int, gyro: float, angle: NDArray, winding: float) -> None:
        gains, motor, wheels = self.settings.firmware, self.settings.motor, self.settings.wheels
        cycles_per_run = 960 // gains.rate_hz
        if self.is_off or cycle % cycles_per_run:
            return
        period = cycles_per_run * CYCLE_S
        turn_rate = gyro - self.bias
        self.heading += turn_rate * period
        kind, command = self.command
        if cycle >= self.deadline:
            kind, command = "body", np.zeros(3)
        twist = command.copy()
        if kind == "world":
            cosine, sine = math.cos(self.heading), math.sin(self.heading)
            twist[:2] = [
                cosine * command[0] + sine * command[1],
                cosine * command[1] - sine * command[0],
            ]
        if kind == "wheels":
            desired = command
        else:
            twist[2] += gains.turn_rate_gain * (twist[2] - turn_rate)
            desired = wheels.kinematics.matrix @ twist / wheels.radius_m
        count, back_emf = self.count_edges(angle), motor.wheel_back_emf_v_s
        per_turn = self.settings.sensors.encoder_counts * motor.gear_ratio
        speed = (count - self.count) * 2 * math.pi / per_turn / period
        error = desired - speed
        integral = self.integral + error * period
        volts = gains.feedforward * back_emf * desired + gains.kp * error + gains.ki * integral
        volts += gains.kd * (error - self.last_error) / period
        drives_on = np.sign(volts) == np.sign(error)
        is_frozen = (np.abs(volts) > gains.nominal_voltage_v) & drives_on
        self.integral = np.where(is_frozen, self.integral, integral)
        self.last_error, self.count = error, count
        below_limit = motor.max_winding_c - winding
        if gains.thermal_derating and below_limit < 10:
            current = 2 * motor.nominal_current_a * max(below_limit, 0) / 10
            margin = motor.resistance_ohm * current
            volts = np.clip(volts, back_emf * speed - margin, back_emf * speed + margin)
        self.duty = np.clip(volts / gains.nominal_voltage_v, -1, 1)


@pytest.mark.parametrize("seed", [0, 1])
@pytest.mark.parametrize("name", GAINS)
def test_duties_and_headings_are_those_of_the_description(name: str, seed: int) -> None:
    """Random commands, packets, sensors, heat and reboots; equal up to rounding in every cycle."""
    rng = np.random.default_rng(seed)
    settings = resolve_settings({"firmware": {"timeout_s": 0.1} | GAINS[name]})
    firmware, described = Firmware([settings], has_faults=True), DescribedFirmware(settings)
    angle, speed, duties, commands = np.zeros(4), np.zeros(4), np.zeros(4), 0
    is_saturated = []
    back_emf = settings.motor.wheel_back_emf_v_s
    is_off_from = rng.integers(30, 60)
    for frame in range(FRAMES):
        is_off = is_off_from <= frame < is_off_from + 5
        is_blind = is_off_from + 5 <= frame < is_off_from + 10 or rng.random() < 0.3
        vision = np.nan if is_blind else rng.uniform(-9, 9)
        age = int(rng.integers(0, min(frame, 29) + 1))
        winding = rng.uniform(100, 130)
        firmware.winding = np.full((4, 1), winding)
        described.begin_frame(frame * CYCLES, vision, age, is_off, angle)
        firmware.begin_frame(vision, age, is_off, angle)
        if rng.random() < (0.05 if 90 < frame < 120 else 0.5):
            commands += 1
            kind = ("world", "body", "wheels")[commands % 3]
            values = rng.uniform(-3, 3, 3) if kind != "wheels" else rng.uniform(-99, 99, 4)
            is_new = bool(rng.random() < 0.8)
            described.accept(frame * CYCLES, kind, values, is_new)
            is_wheels = kind == "wheels"
            firmware.accept(
                velocity=np.zeros((3, 1)) if is_wheels else values[:, None],
                is_new=np.array([is_new]),
                in_body_frame=np.array([kind == "body"]),
                wheel_speeds=(values if is_wheels else np.full(4, np.nan))[:, None],
            )
        for cycle in range(frame * CYCLES, (frame + 1) * CYCLES):
            gyro = rng.uniform(-3, 3)
            no_load_speed = duties * settings.firmware.nominal_voltage_v / back_emf
            speed = speed + 0.05 * (no_load_speed - speed) + rng.uniform(-0.3, 0.3, 4)
            angle = angle + speed * CYCLE_S
            described.run(cycle, gyro, angle, winding)
            duties = firmware.run(gyro, angle[:, None])[:, 0]
            np.testing.assert_allclose(duties, described.duty * np.ones(4), atol=1e-9)
            is_saturated.append(np.abs(duties) == 1)
        assert firmware.heading[0] == pytest.approx(described.heading, abs=1e-9)
    assert 0.001 < np.mean(is_saturated) < 0.5
