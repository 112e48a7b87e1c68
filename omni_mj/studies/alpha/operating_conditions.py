"""Operating conditions of the alpha study, and the causes of lost gain and of lag.

A condition is a setting, `section.field`, or a field of the velocity profile. Conditions are varied
one by one. Causes are removed in all combinations (an ablation). From the responses,
`shapley_values` computes the contribution of each cause.
"""

import itertools
import math
from collections.abc import Callable, Mapping, Sequence

import numpy as np

from omni_control.kinematics import Array
from omni_mj.config.distributions import replace_values
from omni_mj.config.motor_settings import RAD_S_PER_RPM
from omni_mj.config.settings import Settings, find_setting
from omni_mj.results.ramp_response import RampProfile

ConditionValues = Mapping[str, Sequence[float]]
# The fastest profile with which TIGERs Mannheim identify their robots
PROFILE = RampProfile(speed_m_s=1.5, acceleration_m_s2=2.0)
PROFILE_TEXT = f"{PROFILE.speed_m_s:g} m/s at {PROFILE.acceleration_m_s2:g} m/s²"
CONDITION_VALUES: ConditionValues = {
    "speed_m_s": (0.5, 1.0, 1.5, 2.0),
    "acceleration_m_s2": (1.0, 2.0, 3.0, 4.0),
    "carpet.friction": (0.5, 0.6, 0.8, 1.0),
    "drivetrain.creep_stiffness": (1.5, 2.5, 5.0, 1000.0),
    "carpet.rolling_resistance": (0.0, 0.05, 0.1, 0.15),
    "motor.winding_c": (25.0, 75.0, 120.0),
    "battery.charge": (1.0, 0.5, 0.15),
}
DIRECTIONS = {  # of motion, unit vectors in the body frame
    "forward": (1.0, 0.0),
    "sideways": (0.0, 1.0),
    "diagonal": (0.5**0.5, 0.5**0.5),
}
UNIT_VECTORS = np.array(list(DIRECTIONS.values()))
WORN = {"motor.winding_c": 120.0, "battery.charge": 0.15}  # a robot at the end of a game
WORN_TEXT = (
    f"windings at {WORN['motor.winding_c']:g} °C, battery at {100 * WORN['battery.charge']:g} %"
)


def apply_condition(
    settings: Settings, condition: str, value: float
) -> tuple[Settings, RampProfile]:
    """Return settings and profile with another value of one condition.

    Args:
        settings: Settings without the condition.
        condition: A field of `RampProfile`, or a setting `section.field`.
        value: Value in the unit of that field.

    Raises:
        OmniError: The condition does not exist, or its value is not allowed.
    """
    if condition in PROFILE._fields:
        return settings, PROFILE._replace(**{condition: value})
    find_setting(condition)
    return _replace_settings(settings, {condition: value}), PROFILE


def ablate_causes(settings: Settings) -> list[Settings]:
    """Return the settings of a worn robot with every combination of `CAUSES`.

    The first settings have no cause, the last ones have all. The last cause changes fastest.
    """
    ablated = []
    for has_causes in itertools.product((False, True), repeat=len(CAUSES)):
        robot = _replace_settings(settings, WORN)
        for remove_cause, has_cause in zip(CAUSES.values(), has_causes, strict=True):
            if not has_cause:
                robot = remove_cause(robot)
        ablated.append(robot)
    return ablated


def shapley_values(values: Array) -> dict[str, Array]:
    """Return the contribution of each cause to the effect of all causes together.

    The Shapley value of a cause is the mean change when it is added, over all orders in which the
    causes can be added one by one (L. S. Shapley, A Value for n-Person Games, 1953). Shapley values
    add up to the effect of all causes.

    Args:
        values: A quantity under every combination of causes. The leading axes, one per cause, have
            two entries: without and with the cause. The contributions have the remaining axes.
    """
    contributions = {cause: np.zeros(values.shape[len(CAUSES) :]) for cause in CAUSES}
    for order in itertools.permutations(CAUSES):
        has_cause = dict.fromkeys(CAUSES, 0)
        for cause in order:
            value_without = values[tuple(has_cause.values())]
            has_cause[cause] = 1
            change = values[tuple(has_cause.values())] - value_without
            contributions[cause] += change / math.factorial(len(CAUSES))
    return contributions


def _replace_settings(settings: Settings, values: Mapping[str, float]) -> Settings:
    """Return settings with other values, given by `section.field`.

    If they contain the temperature of the windings, the housings get their temperature in thermal
    equilibrium: as much heat flows from the windings to the housings as from these to the air.
    """
    values = dict(values)
    if "motor.winding_c" in values:
        motor = settings.motor
        air_resistance = motor.housing_ambient_resistance_k_w
        ratio = air_resistance / (air_resistance + motor.winding_housing_resistance_k_w)
        winding_rise = values["motor.winding_c"] - motor.ambient_c
        values["motor.housing_c"] = motor.ambient_c + ratio * winding_rise
    return replace_values(settings, values)


def _remove_drag(settings: Settings) -> Settings:
    """Return settings without rolling resistance and friction of rollers, gears and motors.

    The no-load speed of a motor without friction is limited by back-EMF alone.
    """
    motor = settings.motor
    no_load_speed = motor.nominal_voltage_v / motor.torque_constant_nm_a
    return settings.replace(
        carpet={"rolling_resistance": 0.0},
        drivetrain={"roller_friction": 0.0, "gear_friction_nm": 0.0},
        motor={"no_load_current_a": 0.0, "no_load_rpm": no_load_speed / RAD_S_PER_RPM},
    )


# Cause -> function that removes it from settings
CAUSES: dict[str, Callable[[Settings], Settings]] = {
    "creep": lambda settings: settings.replace(drivetrain={"creep_stiffness": 1000.0}),
    "drag": _remove_drag,
    "heat": lambda settings: _replace_settings(settings, {"motor.winding_c": 25.0}),
    "battery": lambda settings: settings.replace(battery={"charge": 0.5, "resistance_ohm": 0.0}),
}
