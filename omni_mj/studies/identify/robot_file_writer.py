"""The start robot's file with identified numbers in place of its own, each with its standard error in a comment."""

import re
import tomllib
from collections.abc import Mapping, Sequence

from omni_mj.config.settings import PERIOD_S
from omni_mj.studies.identify.derived_parameters import Estimate

Changes = dict[tuple[str, str], str]  # section and field -> value as TOML has it, and a comment
# Estimate -> section and field of settings; commands tell what the team's computer believes.
FIELDS = {
    "wheels.radius_m": ("wheels", "radius_m"),
    "wheels.arm_m": ("wheels", "arm_m"),
    "wheels.creep_stiffness": ("drivetrain", "creep_stiffness"),
    "wheels.rolling_resistance": ("carpet", "rolling_resistance"),
    "wheels.roller_friction": ("drivetrain", "roller_friction"),
    "commands.latency_s": ("radio", "delay_frames"),
    "commands.lag_forward_s": ("control", "assumed_lag_s"),
    "commands.friction_forward_m_s": ("control", "assumed_drag_m_s"),
    "commands.creep_forward_s2_m": ("control", "assumed_creep_s2_m"),
    "commands.creep_sideways_s2_m": ("control", "assumed_creep_sideways_s2_m"),
    "commands.gain_forward": ("control", "assumed_alpha_forward"),
    "commands.gain_sideways": ("control", "assumed_alpha_sideways"),
}
DRAG = ("wheels.rolling_resistance", "wheels.roller_friction")
LEAST = {
    "radius_m": 0.01,
    "arm_m": 0.02,
    "creep_stiffness": 0.1,
}  # that settings allow; of all else 0


def changes(estimates: Mapping[str, Estimate]) -> Changes:
    """Return which of all estimates, by name, change the file: as far as the data tell them and settings allow them."""
    told = {
        name
        for name, e in estimates.items()
        if e.is_identified and e.value >= LEAST.get(e.name, 0.0)
    }
    if not told >= set(DRAG):  # a log tells the sum of pile and rollers better than each
        told -= set(DRAG)
    made = {}
    for name, place in FIELDS.items():
        if name in told:
            e = estimates[name]
            value, size, unit = f"{float(f'{e.value:.5g}')}", 1.0, e.unit
            if name == "commands.latency_s":
                value, size, unit = str(round(e.value / PERIOD_S)), PERIOD_S, "frames"
            shown = f"{e.value / size:.4g} +- {e.error / size:.2g} {unit}".rstrip()
            made[place] = f"{value} # identified from {e.source}: {shown} (standard error)"
    return made


def write_changes(start: str, made: Mapping[tuple[str, str], str], logs: Sequence[str]) -> str:
    """Return the text of a robot's file with changes; all else, comments included, stays.

    Args:
        start: The start robot's file.
        made: By section and field.
        logs: Named in the first line.
    """
    present, section = tomllib.loads(start), ""
    lines = [
        f"# omni-mj identify: numbers marked as identified are from {' '.join(', '.join(logs).split())}"
    ]
    for line in start.splitlines():
        key = re.match(r"\s*([\w-]+)\s*=", line)
        if key and (change := made.get((section, key[1]))):
            line = f"{key[1]} = {change}; was {line.split('#')[0].split('=')[1].strip()}"
        if not line.startswith("#:schema"):
            lines.append(line)
        if head := re.match(r"\s*\[\s*([\w.-]+)\s*\]", line):
            section = head[1]
            lines += [
                f"{k} = {v}"
                for (of, k), v in made.items()
                if of == section and k not in present[section]
            ]
    for name in sorted({of for of, _ in made} - set(present)):
        lines += [
            "",
            f"[{name}]",
            *(f"{key} = {value}" for (of, key), value in made.items() if of == name),
        ]
    return "\n".join([*lines, ""])
