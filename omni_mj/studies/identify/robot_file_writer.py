"""Write a robot's file with identified values, each with its standard error in a comment."""

import re
import tomllib
from collections.abc import Collection, Mapping, Sequence

from omni_mj.config import PERIOD_S
from omni_mj.config.settings import find_setting
from omni_mj.studies.identify.derived_parameters import Estimate

# Estimate -> setting. Assumptions in [control] are those of the team's model.
FIELDS = {
    "wheels.radius_m": "wheels.radius_m",
    "wheels.arm_m": "wheels.arm_m",
    "wheels.creep_stiffness": "drivetrain.creep_stiffness",
    "wheels.rolling_resistance": "carpet.rolling_resistance",
    "wheels.roller_friction": "drivetrain.roller_friction",
    # The contacts by commands are written if there are none by wheels.
    "commands.creep_stiffness": "drivetrain.creep_stiffness",
    "commands.rolling_resistance": "carpet.rolling_resistance",
    "commands.roller_friction": "drivetrain.roller_friction",
    "commands.dead_time_s": "radio.delay_frames",
    "commands.loop_gain": "firmware.kp",
    "commands.lag_forward_s": "control.assumed_lag_s",
    "commands.friction_forward_m_s": "control.assumed_friction_loss_m_s",
    "commands.creep_forward_s2_m": "control.assumed_creep_s2_m",
    "commands.creep_sideways_s2_m": "control.assumed_creep_sideways_s2_m",
    "commands.gain_forward": "control.assumed_alpha_forward",
    "commands.gain_sideways": "control.assumed_alpha_sideways",
}
# Size and name of a setting's unit, where it is not that of the estimate
SETTING_UNITS = {"commands.dead_time_s": (PERIOD_S, "frames")}


def list_changes(
    estimates: Mapping[str, Estimate], trusted_sources: Collection[str]
) -> dict[str, str]:
    """Return the changes of a robot's file for all usable estimates.

    Estimates that the settings do not allow are left out.

    Args:
        estimates: Mapping from source and name, such as "wheels.arm_m", to estimate.
        trusted_sources: Sources whose weak estimates are used, because the fit predicts the motion
            better than the start robot does.

    Returns:
        Setting `section.field` -> value as TOML, with a comment.
    """
    allowed = {
        name
        for name, estimate in estimates.items()
        if _is_in_range(name, estimate.value)
        and (estimate.source in trusted_sources or not estimate.is_weak)
    }
    usable = {name for name in allowed if estimates[name].is_identified}
    # A log determines the sum of both better than each, so neither is written without the other.
    # Creep stiffness and gain imply the sum, even if a log tells little of each.
    for source in ("commands", "wheels"):
        pair = {f"{source}.rolling_resistance", f"{source}.roller_friction"}
        is_sum_known = {f"{source}.creep_stiffness", f"{source}.gain_forward"} <= usable
        candidates = allowed if is_sum_known else usable
        usable = usable | pair if pair <= candidates else usable - pair
    return {
        setting: _format_change(name, estimates[name])
        for name, setting in FIELDS.items()
        if name in usable
    }


def _is_in_range(name: str, value: float) -> bool:
    """Return whether the setting that an estimate is written into allows its value."""
    if name not in FIELDS:
        return True
    setting = find_setting(FIELDS[name])
    size, _ = SETTING_UNITS.get(name, (1.0, ""))
    return setting.low <= value / size <= setting.high


def _format_change(name: str, estimate: Estimate) -> str:
    """Return the value as TOML, with estimate and standard error in a comment."""
    size, unit = SETTING_UNITS.get(name, (1.0, estimate.info.unit))
    value = float(f"{estimate.value / size:.5g}")
    estimate_text = f"{estimate.value / size:.4g} +- {estimate.standard_error / size:.2g}"
    estimate_text = f"{estimate_text} {unit}".rstrip()
    weak = ", weak" if estimate.is_weak else ""
    return f"{value} # identified from {estimate.source}: {estimate_text} (standard error{weak})"


def apply_changes(start: str, changes: Mapping[str, str], logs: Sequence[str]) -> str:
    """Return the text of a robot's file with changes; replaced lines become comments.

    Args:
        start: Text of the start robot's file.
        changes: Setting `section.field` -> value as TOML.
        logs: Names of the logs, for the first line of the text.
    """
    section = ""
    names = " ".join(", ".join(logs).split())
    lines = [f"# omni-mj identify: numbers marked as identified are from {names}"]
    for line in start.splitlines():
        key = re.match(r"\s*([\w-]+)\s*=", line)
        if key and f"{section}.{key[1]}" in changes:
            line = f"# {line}"
        if not line.startswith("#:schema"):
            lines.append(line)
        if header := re.match(r"\s*\[\s*([\w.-]+)\s*\]", line):
            section = header[1]
            lines += _section_lines(changes, section)
    sections = {setting.split(".")[0] for setting in changes}
    for name in sorted(sections - set(tomllib.loads(start))):
        lines += ["", f"[{name}]", *_section_lines(changes, name)]
    return "\n".join([*lines, ""])


def _section_lines(changes: Mapping[str, str], name: str) -> list[str]:
    """Return the lines of a section's changes."""
    head = f"{name}."
    return [
        f"{setting.removeprefix(head)} = {value}"
        for setting, value in changes.items()
        if setting.startswith(head)
    ]
