"""What alpha is studied under: conditions one by one, and causes in all combinations."""

import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from omni_control.errors import OmniError, suggest_names
from omni_control.kinematics import Array
from omni_mj.config.motor_settings import RAD_S
from omni_mj.config.settings import Settings
from omni_mj.results.ramp_response import Profile

Conditions = Mapping[str, Sequence[float]]
PROFILE = Profile(
    speed_m_s=1.5, acceleration_m_s2=2.0
)  # the fastest with which TIGERs Mannheim identify their robots
CONDITIONS: Conditions = {
    "speed_m_s": (0.5, 1.0, 1.5, 2.0),
    "acceleration_m_s2": (1.0, 2.0, 3.0, 4.0),
    "friction": (0.5, 0.6, 0.8, 1.0),
    "creep_stiffness": (1.5, 2.5, 5.0, 1000.0),
    "pile": (0.0, 0.05, 0.1, 0.15),
    "winding_c": (25.0, 75.0, 120.0),
    "charge": (1.0, 0.5, 0.15),
}
LABELS = {
    "speed_m_s": "speed, m/s",
    "acceleration_m_s2": "acceleration, m/s²",
    "friction": "carpet friction",
    "creep_stiffness": "creep stiffness",
    "pile": "pile, share of load",
    "winding_c": "winding, °C",
    "charge": "battery charge",
}
SECTIONS = {  # of settings, in which conditions are that are no part of the profile
    "friction": "carpet",
    "creep_stiffness": "drive",
    "pile": "carpet",
    "winding_c": "motor",
    "charge": "battery",
}
DRIVE_TEXT = f"{PROFILE.speed_m_s:g} m/s at {PROFILE.acceleration_m_s2:g} m/s²"
AXES = ("forward", "sideways")
DIRECTIONS = {
    "forward": (1.0, 0.0),
    "sideways": (0.0, 1.0),
    "diagonal": (0.5**0.5, 0.5**0.5),
}  # of drives
WORN = {"winding_c": 120.0, "charge": 0.15}  # at the end of a game; the rest as the scenario has it
WORN_TEXT = f"windings at {WORN['winding_c']:g} °C, battery at {100 * WORN['charge']:g} %"

CAUSES: dict[str, Callable[[Settings], Settings]] = {  # and how a robot is freed of each
    "creep": lambda s: s.replace(drive={"creep_stiffness": 1000.0}),
    "drag": lambda s: s.replace(
        carpet={"pile": 0.0},
        drive={"roller_friction": 0.0, "gear_friction_nm": 0.0},
        motor=_without_friction(s),
    ),
    "heat": lambda s: changed(s, "winding_c", 25.0)[0],
    "battery": lambda s: s.replace(battery={"charge": 0.5, "resistance_ohm": 0.0}),
}


def changed(settings: Settings, condition: str, value: float) -> tuple[Settings, Profile]:
    """Return settings, and the profile to drive, with another value of one condition.

    Hot windings come with a housing as warm as it gets in equilibrium with them.

    Raises:
        OmniError: there is no such condition.
    """
    if condition in vars(PROFILE):
        return settings, replace(PROFILE, **{condition: value})
    if condition not in SECTIONS:
        raise OmniError(
            f"unknown condition {condition!r}; {suggest_names(condition, [*vars(PROFILE), *SECTIONS])}"
        )
    fields = {condition: value}
    if condition == "winding_c":
        motor = settings.motor
        share = motor.housing_ambient_k_w / (motor.housing_ambient_k_w + motor.winding_housing_k_w)
        fields["housing_c"] = motor.ambient_c + share * (value - motor.ambient_c)
    return settings.replace(**{SECTIONS[condition]: fields}), PROFILE


def combinations(settings: Settings) -> list[Settings]:
    """Return a worn robot with every combination of `CAUSES`, from none to all; the last of them changes first."""
    worn, combined = settings, []
    for condition, value in WORN.items():
        worn, _ = changed(worn, condition, value)
    for present in itertools.product((False, True), repeat=len(CAUSES)):
        robot = worn
        for free, stays in zip(CAUSES.values(), present, strict=True):
            robot = robot if stays else free(robot)
        combined.append(robot)
    return combined


def shares(values: Array) -> dict[str, Array]:
    """Return how much of what all causes do together is each one's.

    A cause's share is the mean of what adding it changes, over all orders in which causes could be
    added one by one (L. S. Shapley, A Value for n-Person Games, 1953). Shares add up to what all do
    together.

    Args:
        values: With every combination of causes, an axis of two for each (without, with), then any
            others.
    """
    result = {cause: np.zeros(values.shape[len(CAUSES) :]) for cause in CAUSES}
    for order in itertools.permutations(CAUSES):
        present = dict.fromkeys(CAUSES, 0)
        for cause in order:
            before = values[tuple(present.values())]
            present[cause] = 1
            result[cause] += (values[tuple(present.values())] - before) / math.factorial(
                len(CAUSES)
            )
    return result


def _without_friction(settings: Settings) -> dict[str, float]:
    """A motor's no-load row, had it no friction: as fast as its back-EMF lets it."""
    motor = settings.motor
    return {
        "no_load_current_a": 0.0,
        "no_load_rpm": motor.nominal_voltage_v / motor.constant_nm_a / RAD_S,
    }
