"""Operating conditions of the alpha study, and the causes of lost gain and of lag.

Conditions are varied one by one. Causes are removed in all combinations (an ablation). Shapley
values are the contributions of the causes.
"""

import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from omni_control.errors import OmniError, suggest_names
from omni_control.kinematics import Array
from omni_mj.config.motor_settings import RAD_S_PER_RPM
from omni_mj.config.settings import Settings
from omni_mj.results.ramp_response import RampProfile

ConditionValues = Mapping[str, Sequence[float]]
# The fastest profile with which TIGERs Mannheim identify their robots
PROFILE = RampProfile(speed_m_s=1.5, acceleration_m_s2=2.0)
CONDITION_VALUES: ConditionValues = {
    "speed_m_s": (0.5, 1.0, 1.5, 2.0),
    "acceleration_m_s2": (1.0, 2.0, 3.0, 4.0),
    "friction": (0.5, 0.6, 0.8, 1.0),
    "creep_stiffness": (1.5, 2.5, 5.0, 1000.0),
    "rolling_resistance": (0.0, 0.05, 0.1, 0.15),
    "winding_c": (25.0, 75.0, 120.0),
    "charge": (1.0, 0.5, 0.15),
}
CONDITION_LABELS = {
    "speed_m_s": "speed in m/s",
    "acceleration_m_s2": "acceleration in m/s²",
    "friction": "carpet friction",
    "creep_stiffness": "creep stiffness",
    "rolling_resistance": "rolling resistance",
    "winding_c": "winding in °C",
    "charge": "battery charge",
}
# Section of settings of each condition that is not part of the profile
CONDITION_SECTIONS = {
    "friction": "carpet",
    "creep_stiffness": "drivetrain",
    "rolling_resistance": "carpet",
    "winding_c": "motor",
    "charge": "battery",
}
PROFILE_TEXT = f"{PROFILE.speed_m_s:g} m/s at {PROFILE.acceleration_m_s2:g} m/s²"
AXES = ("forward", "sideways")
DIRECTIONS = {  # of motion, unit vectors in the body frame
    "forward": (1.0, 0.0),
    "sideways": (0.0, 1.0),
    "diagonal": (0.5**0.5, 0.5**0.5),
}
# A robot at the end of a game; its other settings are the scenario's
WORN = {"winding_c": 120.0, "charge": 0.15}
WORN_TEXT = f"windings at {WORN['winding_c']:g} °C, battery at {100 * WORN['charge']:g} %"

# Cause -> function that removes it from settings
CAUSES: dict[str, Callable[[Settings], Settings]] = {
    "creep": lambda s: s.replace(drivetrain={"creep_stiffness": 1000.0}),
    "drag": lambda s: s.replace(
        carpet={"rolling_resistance": 0.0},
        drivetrain={"roller_friction": 0.0, "gear_friction_nm": 0.0},
        motor=_frictionless_no_load(s),
    ),
    "heat": lambda s: apply_condition(s, "winding_c", 25.0)[0],
    "battery": lambda s: s.replace(battery={"charge": 0.5, "resistance_ohm": 0.0}),
}


def apply_condition(
    settings: Settings, condition: str, value: float
) -> tuple[Settings, RampProfile]:
    """Return settings and profile with another value of one condition.

    If the windings are hot, the housing gets the temperature of their thermal equilibrium.

    Args:
        settings: All other settings.
        condition: A key of `CONDITION_SECTIONS`, or a field of the profile.
        value: Value in the unit of that setting.

    Raises:
        OmniError: The condition does not exist.
    """
    if condition in vars(PROFILE):
        return settings, replace(PROFILE, **{condition: value})
    if condition not in CONDITION_SECTIONS:
        choices = suggest_names(condition, [*vars(PROFILE), *CONDITION_SECTIONS])
        raise OmniError(f"unknown condition {condition!r}; {choices}")
    fields = {condition: value}
    if condition == "winding_c":
        motor = settings.motor
        ratio = motor.housing_ambient_k_w / (motor.housing_ambient_k_w + motor.winding_housing_k_w)
        fields["housing_c"] = motor.ambient_c + ratio * (value - motor.ambient_c)
    return settings.replace(**{CONDITION_SECTIONS[condition]: fields}), PROFILE


def ablate_causes(settings: Settings) -> list[Settings]:
    """Return the settings of a worn robot with every combination of `CAUSES`.

    The first settings have no cause, the last ones have all. The last cause changes fastest.
    """
    worn, ablated = settings, []
    for condition, value in WORN.items():
        worn, _ = apply_condition(worn, condition, value)
    for is_present in itertools.product((False, True), repeat=len(CAUSES)):
        robot = worn
        for remove, stays in zip(CAUSES.values(), is_present, strict=True):
            robot = robot if stays else remove(robot)
        ablated.append(robot)
    return ablated


def shapley_values(values: Array) -> dict[str, Array]:
    """Return the contribution of each cause to the effect of all causes together.

    The Shapley value of a cause is the mean change when it is added, over all orders in which the
    causes can be added one by one (L. S. Shapley, A Value for n-Person Games, 1953). Shapley values
    add up to the effect of all causes.

    Args:
        values: A quantity under every combination of causes. The leading axes, one per cause, have
            two entries: without and with the cause. Further axes are kept.
    """
    contributions = {cause: np.zeros(values.shape[len(CAUSES) :]) for cause in CAUSES}
    for order in itertools.permutations(CAUSES):
        present = dict.fromkeys(CAUSES, 0)
        for cause in order:
            without = values[tuple(present.values())]
            present[cause] = 1
            change = values[tuple(present.values())] - without
            contributions[cause] += change / math.factorial(len(CAUSES))
    return contributions


def _frictionless_no_load(settings: Settings) -> dict[str, float]:
    """Return the no-load data of a motor without friction, whose speed only back-EMF limits."""
    motor = settings.motor
    return {
        "no_load_current_a": 0.0,
        "no_load_rpm": motor.nominal_voltage_v / motor.torque_constant_nm_a / RAD_S_PER_RPM,
    }
